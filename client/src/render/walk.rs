//! The front-to-back walk through the octree: in perspective, and then by form patterns.
//!
//! The steps are those of the paper's Figs. 26 to 28 (seeds: orthogonal octree). A node is clipped
//! to the picture, tested against the mask buffer and halved; the octants come in the order of the
//! eye's sector, nearest first. In orthogonal mode the last two levels are drawn together, a
//! brick of 4 × 4 × 4 cells pixel by pixel: see [`lines`](super::lines).

use glam::{Vec3A, Vec4};
use sightline_shared::octree::{Inner, Octree};

use super::{
    Counters, Mode,
    band::Band,
    form::{BrickForm, Flat, Form},
    hull::Hull,
    layer::Layer,
    mask::{Area, BLOCK, bits, lines},
    view::{BandView, NEAR},
};

/// A voxel is drawn larger by so many pixels, so that no line of sight slips between two that
/// share a face.
const SEAM_PX: f32 = 1.0e-3;

/// No more octants wait to be drawn: seven on each level, and one.
const WAITING_MAX: usize = 128;

/// What a walk needs beside the picture, kept from one to the next.
pub(super) struct Walker {
    waiting: Vec<Cube>,
    flats: Vec<Flat>,
}

impl Default for Walker {
    fn default() -> Self {
        Self { waiting: Vec::with_capacity(WAITING_MAX), flats: Vec::with_capacity(WAITING_MAX) }
    }
}

/// Cells whose edge is longer, in pixels, are drawn each as a whole.
const WHOLE_PX: f32 = 8.0;

/// A node in perspective.
#[derive(Clone, Copy)]
struct Cube {
    /// In the leaves when the level is the tree's depth.
    index: u32,
    level: u8,
    /// The level at which nodes are drawn as a whole; [`UNDECIDED`] while the node is large.
    last: u8,
    /// Relative to the eye.
    centre: Vec3A,
    projected: Vec4,
}

const UNDECIDED: u8 = u8::MAX;

/// One walk.
pub(super) struct Walk<'a> {
    pub(super) octree: &'a Octree,
    pub(super) view: &'a BandView,
    pub(super) mode: Mode,
    /// The first look that is glass.
    pub(super) glass_from: usize,
    pub(super) band: &'a mut Band,
    pub(super) walker: &'a mut Walker,
    pub(super) counters: &'a mut Counters,
}

impl Walk<'_> {
    /// Draws all that is in view.
    #[inline(always)]
    pub(super) fn run(&mut self) {
        if self.octree.inner.is_empty() {
            return;
        }
        self.walker.waiting.clear();
        self.walker.waiting.push(Cube {
            index: 0,
            level: 0,
            last: UNDECIDED,
            centre: self.view.centre,
            projected: self.view.projected,
        });
        while let Some(cube) = self.walker.waiting.pop() {
            self.consider(cube);
            if self.band.mask.is_full() {
                return;
            }
        }
    }

    /// Draws a node, or puts its octants on the stack, unless it is out of view or covered.
    #[inline(always)]
    fn consider(&mut self, mut cube: Cube) {
        let Some(area) = self.area(&cube) else { return };
        self.counters.mask_tests += 1;
        if !self.band.mask.is_open(&area) {
            return;
        }
        let reach = self.view.patterns[usize::from(cube.level)].reach.z;
        let (nearest, farthest) = (cube.projected.z - reach, cube.projected.z + reach);
        if cube.last == UNDECIDED && nearest >= NEAR && nearest >= farthest * self.view.ratio_min {
            cube.last = self.last_level(&cube);
            if self.mode == Mode::Orthogonal && cube.last > cube.level {
                self.draw_flat(&cube);
                return;
            }
        }
        if cube.level == self.octree.depth || cube.level >= cube.last {
            self.fill(&cube, &area);
        } else {
            self.descend(&cube);
        }
    }

    /// The pixels that a node's bounding box meets; none when it is out of view.
    #[inline(always)]
    fn area(&mut self, cube: &Cube) -> Option<Area> {
        self.counters.nodes += 1;
        let pattern = &self.view.patterns[usize::from(cube.level)];
        let (z, reach) = (cube.projected.z, pattern.reach.z);
        if z + reach < NEAR {
            return None;
        }
        if z - reach >= NEAR {
            self.counters.projections += 1;
            let [left, right, top, bottom] = pattern.bounds(cube.projected);
            // Casts hold what is far outside to what fits.
            let span = |low: f32, high: f32| {
                [(low - SEAM_PX).ceil() as i32, ((high + SEAM_PX).floor() as i32).saturating_add(1)]
            };
            return self.band.clip([span(left, right), span(top, bottom)]);
        }
        let all = [[0, self.band.width as i32], [0, self.band.height as i32]];
        if self.is_beside(cube) { None } else { self.band.clip(all) }
    }

    /// Whether a node that is partly nearer than [`NEAR`] lies beside all lines of sight.
    #[inline(always)]
    fn is_beside(&self, cube: &Cube) -> bool {
        let reach = self.view.patterns[usize::from(cube.level)].reach;
        let [x, y, z, _] = cube.projected.to_array();
        let far = z + reach.z;
        x + reach.x < 0.0
            || y + reach.y < 0.0
            || x - reach.x > (self.band.width - 1) as f32 * far
            || y - reach.y > (self.band.height - 1) as f32 * far
    }

    /// The first level, from a node's on, at which nodes are no larger than a pixel where it is, or
    /// that of the leaves.
    #[inline(always)]
    fn last_level(&self, cube: &Cube) -> u8 {
        let is_small =
            |&level: &u8| cube.projected.z > self.view.patterns[usize::from(level)].small_from;
        (cube.level..self.octree.depth).find(is_small).unwrap_or(self.octree.depth)
    }

    /// Puts the octants on the stack so that the one towards the eye comes off first: among octants
    /// that differ in one axis only, the nearer one always comes before the other.
    #[inline(always)]
    fn descend(&mut self, cube: &Cube) {
        let pattern = &self.view.patterns[usize::from(cube.level)];
        let node = &self.octree.inner[cube.index as usize];
        let nearest = cube.centre.cmplt(Vec3A::ZERO).bitmask() as u8;
        for octant in (0..8).rev().map(|order| order ^ nearest) {
            let Some(index) = node.child(octant) else { continue };
            let octant = usize::from(octant);
            self.walker.waiting.push(Cube {
                index,
                level: cube.level + 1,
                last: cube.last,
                centre: cube.centre + pattern.octants[octant],
                projected: cube.projected + pattern.octants_projected[octant],
            });
        }
    }

    /// Writes the pixels whose lines of sight meet the node.
    #[inline(always)]
    fn fill(&mut self, cube: &Cube, area: &Area) {
        let half = self.view.patterns[usize::from(cube.level)].half;
        if cube.centre.abs().max_element() <= half {
            // The eye is inside: better to look out of it than to see nothing.
            return;
        }
        let hull = Hull::new(self.view, cube.centre - half, cube.centre + half, SEAM_PX);
        let look = self.look(cube.index, cube.level);
        let is_glass = usize::from(look) >= self.glass_from;
        self.band.fill(area, &hull, look, cube.projected.z.max(NEAR), is_glass);
    }

    #[inline(always)]
    fn look(&self, index: u32, level: u8) -> u16 {
        if level == self.octree.depth {
            self.octree.leaves[index as usize]
        } else {
            self.octree.inner[index as usize].look
        }
    }

    /// Draws a node in orthogonal mode, down to its last level, which is below.
    #[inline(always)]
    fn draw_flat(&mut self, cube: &Cube) {
        let pattern = &self.view.patterns[usize::from(cube.level)];
        let (form, root) =
            Form::new(self.view, cube.index, pattern.half * 2.0, cube.centre, cube.projected);
        let levels = u32::from(cube.last - cube.level);
        let whole = levels < 2 || form.cell_px(levels) > WHOLE_PX;
        let drawn_at = if whole { levels } else { levels - 2 };
        let mut drawn = None;
        let leaves = cube.last == self.octree.depth;
        let slack = form.slack_place();
        self.walker.flats.clear();
        self.walker.flats.push(root);
        while let Some(flat) = self.walker.flats.pop() {
            self.counters.nodes += 1;
            let Some(area) = self.band.clip(form.span(&flat, slack)) else { continue };
            self.counters.mask_tests += 1;
            if !self.band.mask.is_open(&area) {
                continue;
            }
            if leaves && flat.below < levels {
                let node = &self.octree.inner[flat.index as usize];
                if let Some((axis, place)) = node.flat()
                    && node.flags & Inner::SOME_GLASS == 0
                    && let Some(layer) = Layer::new(&form, &flat, levels - flat.below, axis, place)
                {
                    let first = self.first_leaf(node, levels - flat.below);
                    self.band.fill_layer(&area, &layer, &self.octree.leaves[first..]);
                    continue;
                }
            }
            if flat.below == drawn_at {
                let bricks = drawn.get_or_insert_with(|| BrickForm::new(&form, drawn_at + 2));
                if whole {
                    self.draw_cell(bricks, &flat, &area, cube.last);
                } else {
                    self.draw_brick(bricks, &flat, &area, form.flip, leaves);
                }
                continue;
            }
            let node = &self.octree.inner[flat.index as usize];
            for order in (0..8).rev() {
                if let Some(index) = node.child(order as u8 ^ form.flip) {
                    self.walker.flats.push(form.octant(&flat, order, index));
                }
            }
        }
    }

    /// The index of the first leaf below a node that is so many levels above the leaves.
    #[inline(always)]
    fn first_leaf(&self, node: &Inner, levels: u32) -> usize {
        let child = |first: u32, _| self.octree.inner[first as usize].first;
        (1..levels).fold(node.first, child) as usize
    }

    /// Draws a cell as a whole.
    #[inline(always)]
    fn draw_cell(&mut self, form: &BrickForm, flat: &Flat, area: &Area, level: u8) {
        let look = self.look(flat.index, level);
        let is_glass = usize::from(look) >= self.glass_from;
        let depth = flat.depth + form.middle_deeper();
        self.band.fill(area, &form.outline(flat), look, depth, is_glass);
    }

    /// Draws a brick.
    #[inline(always)]
    fn draw_brick(&mut self, form: &BrickForm, flat: &Flat, area: &Area, flip: u8, leaves: bool) {
        let node = &self.octree.inner[flat.index as usize];
        let brick = Brick::new(&self.octree.inner, node, flip);
        if node.flags & Inner::SOME_GLASS != 0 {
            self.draw_cells::<true>(form, flat, &brick, area, leaves);
        } else {
            self.draw_cells::<false>(form, flat, &brick, area, leaves);
        }
    }

    /// Draws the cells of a brick: each open pixel shows the first of its cells that the line of sight meets.
    #[inline(always)]
    fn draw_cells<const GLASS: bool>(
        &mut self,
        form: &BrickForm,
        flat: &Flat,
        brick: &Brick,
        area: &Area,
        leaves: bool,
    ) {
        let rows_met = form.rows();
        let band = &mut *self.band;
        let [columns, rows] = area.blocks();
        for row in rows {
            for column in columns.clone() {
                let block = row * band.mask.across() + column;
                let open = area.word(column, row) & !band.mask.word(block);
                if open == 0 {
                    continue;
                }
                let places = form.places(flat, [(column * BLOCK) as i32, (row * BLOCK) as i32]);
                let mut written = 0u64;
                for y in bits(lines(open)) {
                    let line = form.line(places, y);
                    for x in bits(open >> (BLOCK * y) & 0xff) {
                        let pixel = BLOCK * y + x;
                        let mut met = form.cells(&rows_met, line, x) & brick.cells;
                        while met != 0 {
                            let cell = met.trailing_zeros() as usize;
                            let look = brick.look(self.octree, cell, leaves);
                            if GLASS && usize::from(look) >= self.glass_from {
                                band.tint(block, 1 << pixel, look);
                                met &= met - 1;
                                continue;
                            }
                            band.looks[block][pixel] = look;
                            band.depths[block][pixel] = flat.depth + form.deeper(cell);
                            written |= 1 << pixel;
                            break;
                        }
                    }
                }
                if written != 0 {
                    band.pixels += u64::from(written.count_ones());
                    band.mask.cover(block, written);
                }
            }
        }
    }
}

/// The cells of a node, two levels below.
struct Brick {
    /// Which are there, in mirrored order.
    cells: u64,
    /// For each octant, in mirrored order, the index of its first cell.
    firsts: [u32; 8],
    /// Likewise which cells it has, not mirrored.
    masks: [u8; 8],
    flip: usize,
}

impl Brick {
    #[inline(always)]
    fn new(inner: &[Inner], node: &Inner, flip: u8) -> Self {
        let mut brick = Self { cells: 0, firsts: [0; 8], masks: [0; 8], flip: usize::from(flip) };
        let first = node.first as usize;
        let children = &inner[first..first + node.mask.count_ones() as usize];
        for (child, octant) in children.iter().zip(bits(u64::from(node.mask))) {
            let place = (octant ^ brick.flip) & 7;
            brick.firsts[place] = child.first;
            brick.masks[place] = child.mask;
        }
        brick.cells = mirrored(u64::from_le_bytes(brick.masks), flip);
        brick
    }

    /// The looks of a cell that is there.
    #[inline(always)]
    fn look(&self, octree: &Octree, cell: usize, leaves: bool) -> u16 {
        let index = self.index(cell);
        if leaves { octree.leaves[index] } else { octree.inner[index].look }
    }

    /// The index of a cell that is there.
    #[inline(always)]
    fn index(&self, cell: usize) -> usize {
        let place = cell >> 3 & 7;
        let before = self.masks[place] & ((1u8 << ((cell ^ self.flip) & 7)) - 1);
        self.firsts[place] as usize + before.count_ones() as usize
    }
}

/// Mirrors the order of the bits in each byte, which are cells of an octant.
#[inline(always)]
fn mirrored(mut cells: u64, flip: u8) -> u64 {
    if flip & 1 != 0 {
        cells = cells >> 1 & 0x5555_5555_5555_5555 | (cells & 0x5555_5555_5555_5555) << 1;
    }
    if flip & 2 != 0 {
        cells = cells >> 2 & 0x3333_3333_3333_3333 | (cells & 0x3333_3333_3333_3333) << 2;
    }
    if flip & 4 != 0 {
        cells = cells >> 4 & 0x0f0f_0f0f_0f0f_0f0f | (cells & 0x0f0f_0f0f_0f0f_0f0f) << 4;
    }
    cells
}
