//! Bricks: the last two levels in orthogonal mode, 4 × 4 × 4 cells, drawn pixel by pixel.
//!
//! Look-ups give the cells that a line of sight may meet (see [`lines`](super::lines)). These are
//! some too many, because the look-ups are rounded and leave out perspective inside of the brick.
//! The first cell, in the order in which a line of sight meets them, is tested exactly, eight
//! pixels at a time. Where it is not met, the next ones are tested.

use glam::{Vec2, Vec3A, Vec3Swizzles, Vec4};
use sightline_world::octree::{InnerNode, Octree};

use super::{
    band::Band,
    form::{BrickForm, OrthoNode},
    lines::PLANES,
    mask::{Area, BLOCK, bits, lines},
    view::BandView,
};

/// What drawing a brick needs.
pub(super) struct Bricks<'a> {
    pub(super) octree: &'a Octree,
    pub(super) view: &'a BandView,
    pub(super) form: &'a BrickForm,
    /// The first material that is glass.
    pub(super) glass_from: usize,
    /// Whether cells are voxels, and not inner nodes.
    pub(super) leaves: bool,
}

impl Bricks<'_> {
    /// Draws the cells of a brick: each open pixel of an area shows the first cell that its line of
    /// sight meets.
    #[inline(always)]
    pub(super) fn draw<const GLASS: bool>(&self, band: &mut Band, brick: &Brick, area: &Area) {
        let [columns, rows] = area.blocks();
        for row in rows {
            for column in columns.clone() {
                let block = row * band.mask.across() + column;
                let open = area.word(column, row) & !band.mask.word(block);
                if open == 0 {
                    continue;
                }
                let places = self.form.places(brick.middle, [column * BLOCK, row * BLOCK]);
                let mut written = 0u64;
                for y in bits(lines(open)) {
                    let line = self.form.line(places, y);
                    let wanted = open >> (BLOCK * y) & 0xff;
                    let mut met = [0; BLOCK];
                    let mut any = 0;
                    for x in bits(wanted) {
                        met[x] = self.form.cells(line, x) & brick.cells;
                        any |= met[x];
                    }
                    if any == 0 {
                        continue;
                    }
                    let sight = RayRow::new(self.view, brick, column * BLOCK, row * BLOCK + y);
                    let first = met.map(|met| met.trailing_zeros());
                    let is_met = brick.meets(&sight, &first);
                    for x in bits(wanted) {
                        let pixel = BLOCK * y + x;
                        let mut met = met[x];
                        if brick.beside_eye {
                            let sorted = brick.sorted(&sight, x, met);
                            written |= self.draw_sorted(band, brick, [block, pixel], &sorted);
                            continue;
                        }
                        let mut is_met = is_met[x];
                        while met != 0 {
                            let cell = met.trailing_zeros() as usize;
                            met &= met - 1;
                            if !is_met {
                                is_met =
                                    met != 0 && brick.meets_one(&sight, x, met.trailing_zeros());
                                continue;
                            }
                            let material_id = brick.material_id(self.octree, cell, self.leaves);
                            if GLASS && usize::from(material_id) >= self.glass_from {
                                let depth = brick.depth + self.form.deeper(cell);
                                band.tint(block, 1 << pixel, material_id, depth);
                                is_met =
                                    met != 0 && brick.meets_one(&sight, x, met.trailing_zeros());
                                continue;
                            }
                            band.material_ids[block][pixel] = material_id;
                            band.depths[block][pixel] = brick.depth + self.form.deeper(cell);
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

    /// Draws a pixel whose line of sight meets these cells, nearest first. Returns the pixel's bit
    /// if it is written, else zero.
    fn draw_sorted(
        &self,
        band: &mut Band,
        brick: &Brick,
        [block, pixel]: [usize; 2],
        cells: &[(f32, u8)],
    ) -> u64 {
        for &(_, cell) in cells {
            let material_id = brick.material_id(self.octree, usize::from(cell), self.leaves);
            let depth = brick.depth + self.form.deeper(usize::from(cell));
            if usize::from(material_id) < self.glass_from {
                band.material_ids[block][pixel] = material_id;
                band.depths[block][pixel] = depth;
                return 1 << pixel;
            }
            band.tint(block, 1 << pixel, material_id, depth);
        }
        0
    }
}

/// The lines of sight of eight pixels in a row, mirrored like the cells of a brick.
struct RayRow {
    rays: [[f32; BLOCK]; 3],
}

impl RayRow {
    #[inline(always)]
    fn new(view: &BandView, brick: &Brick, x: usize, y: usize) -> Self {
        let (first, step) = (view.ray(x, y) * brick.sign, view.ray_step[0] * brick.sign);
        let mut rays = [[0.0; BLOCK]; 3];
        for (axis, rays) in rays.iter_mut().enumerate() {
            for (i, ray) in rays.iter_mut().enumerate() {
                *ray = first[axis] + step[axis] * i as f32;
            }
        }
        Self { rays }
    }

    #[inline(always)]
    fn ray(&self, x: usize) -> Vec3A {
        Vec3A::new(self.rays[0][x], self.rays[1][x], self.rays[2][x])
    }
}

/// The cells two levels below a node.
pub(super) struct Brick {
    /// Which cells are there: a bit for each, in mirrored order.
    cells: u64,
    /// The index of the first cell of each octant. The octants are in mirrored order.
    firsts: [u32; 8],
    /// Which cells each octant has. The octants are in mirrored order, the bits are not mirrored.
    masks: [u8; 8],
    /// Which axes are mirrored: a bit for each.
    flip: usize,
    /// Whether any cell is glass.
    pub(super) some_glass: bool,
    /// Whether the eye is between two opposite sides. Lines of sight then go both ways along an
    /// axis and do not meet cells in ascending order.
    beside_eye: bool,
    /// Where the brick's centre is seen, in pixels.
    middle: Vec2,
    /// The depth of the brick's centre, in metres.
    depth: f32,
    /// The factors that mirror coordinates.
    sign: Vec3A,
    /// The least corner of the first cell, relative to the eye and mirrored. No cell has a negative
    /// coordinate, unless the eye is beside the brick.
    low: Vec3A,
    /// The distance from a cell to the next, in metres.
    step: f32,
    /// The edge of a cell with its seam, in metres.
    edge: f32,
}

impl Brick {
    #[inline(always)]
    pub(super) fn new(
        inner: &[InnerNode],
        view: &BandView,
        flat: &OrthoNode,
        form: &BrickForm,
        middle: Vec2,
        half: f32,
    ) -> Self {
        let node = &inner[flat.index as usize];
        let cell = half * 0.5;
        let seam = view.seam(flat.centre.w);
        let sign = |axis: usize| if form.flip >> axis & 1 != 0 { -1.0 } else { 1.0 };
        let sign = Vec3A::new(sign(0), sign(1), sign(2));
        let mut brick = Self {
            cells: 0,
            firsts: [0; 8],
            masks: [0; 8],
            flip: usize::from(form.flip),
            some_glass: node.flags & InnerNode::SOME_GLASS != 0,
            beside_eye: is_beside_eye(flat.centre, half),
            middle,
            depth: flat.centre.w,
            sign,
            low: Vec3A::from_vec4(flat.centre) * sign - (half + seam),
            step: cell,
            edge: cell + 2.0 * seam,
        };
        let first = node.first as usize;
        let children = &inner[first..first + node.mask.count_ones() as usize];
        for (child, octant) in children.iter().zip(bits(u64::from(node.mask))) {
            let place = (octant ^ brick.flip) & 7;
            brick.firsts[place] = child.first;
            brick.masks[place] = child.mask;
        }
        brick.cells = mirrored(u64::from_le_bytes(brick.masks), form.flip);
        brick
    }

    /// Whether the line of sight of each pixel meets the cell that is given for it. Lines of sight
    /// go upwards along each axis, so two products tell whether two stretches between planes have a
    /// point in common.
    #[inline(always)]
    fn meets(&self, sight: &RayRow, cells: &[u32; BLOCK]) -> [bool; BLOCK] {
        let mut low = [[0.0; BLOCK]; 3];
        for (axis, low) in low.iter_mut().enumerate() {
            for (low, cell) in low.iter_mut().zip(cells) {
                *low = self.low[axis] + self.step * place(*cell, axis);
            }
        }
        let mut met = [true; BLOCK];
        for [a, b] in PLANES {
            let (ray_a, ray_b) = (&sight.rays[a], &sight.rays[b]);
            for i in 0..BLOCK {
                let (high_a, high_b) = (low[a][i] + self.edge, low[b][i] + self.edge);
                met[i] &= (low[a][i] * ray_b[i] <= high_b * ray_a[i])
                    & (low[b][i] * ray_a[i] <= high_a * ray_b[i]);
            }
        }
        met
    }

    /// Whether the line of sight of a pixel of the row meets a cell.
    #[inline(always)]
    fn meets_one(&self, sight: &RayRow, x: usize, cell: u32) -> bool {
        let (ray, low) = (sight.ray(x), self.corner(cell));
        let high = low + self.edge;
        let before = (low * ray.yzx()).cmple(high.yzx() * ray);
        (before & (low.yzx() * ray).cmple(high * ray.yzx())).all()
    }

    /// The least corner of a cell, mirrored.
    #[inline(always)]
    fn corner(&self, cell: u32) -> Vec3A {
        self.low + Vec3A::new(place(cell, 0), place(cell, 1), place(cell, 2)) * self.step
    }

    /// Those of the given cells that a line of sight meets, nearest first, each with the place
    /// where the line enters it.
    fn sorted(&self, sight: &RayRow, x: usize, met: u64) -> Vec<(f32, u8)> {
        // The summand changes nothing but a zero, whose inverse would be infinite.
        let inverse = (sight.ray(x) + 1.0e-20).recip();
        let met = bits(met).filter_map(|cell| {
            let low = self.corner(cell as u32);
            let (a, b) = (low * inverse, (low + self.edge) * inverse);
            let enters = a.min(b).max_element();
            (enters <= a.max(b).min_element()).then_some((enters, cell as u8))
        });
        let mut sorted: Vec<_> = met.collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        sorted
    }

    /// The material of a cell that is there.
    #[inline(always)]
    fn material_id(&self, octree: &Octree, cell: usize, leaves: bool) -> u16 {
        let index = self.index(cell);
        if leaves { octree.leaves[index] } else { octree.inner[index].material }
    }

    /// The index of a cell that is there, among the leaves or the inner nodes.
    #[inline(always)]
    fn index(&self, cell: usize) -> usize {
        debug_assert!(self.cells >> cell & 1 == 1, "cell {cell} is not there");
        let place = cell >> 3 & 7;
        let before = self.masks[place] & ((1u8 << ((cell ^ self.flip) & 7)) - 1);
        self.firsts[place] as usize + before.count_ones() as usize
    }
}

/// Whether the eye is between the planes of two opposite sides of a cube, whose centre is relative
/// to the eye.
#[inline(always)]
pub(super) fn is_beside_eye(centre: Vec4, half: f32) -> bool {
    Vec3A::from_vec4(centre).abs().cmple(Vec3A::splat(half)).any()
}

/// The place of a cell along an axis, from 0 to 3.
#[inline(always)]
fn place(cell: u32, axis: usize) -> f32 {
    ((cell >> axis & 1) + (cell >> (axis + 2) & 2)) as f32
}

/// Mirrors the order of the bits in each byte. A byte has the cells of an octant.
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
