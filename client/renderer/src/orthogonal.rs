//! Orthogonal mode: what is below a node, placed by form patterns.
//!
//! Two forms follow one another. The *coarse* one is that of a node that was projected; nodes below are placed by it, with
//! perspective put right in each place. Where a node is so small that perspective inside of it cannot be seen
//! it gets a *fine* form, from its place: it is decided at which level cells are no larger than a pixel, and the last two levels
//! are drawn together as bricks. Layers of voxels are drawn wherever they turn up.

use glam::{Vec2, Vec3A, Vec4};
use sightline_world::octree::InnerNode;

use super::{
    brick::{Brick, Bricks, is_beside_eye},
    form::{BrickForm, Flat, Form, halved},
    layer::{Layer, Whole},
    mask::Area,
    traversal::{Cube, Traversal},
};

/// Cells whose edge is longer, in pixels, are drawn each as a whole.
const WHOLE_PX: f32 = 8.0;

/// A node with a fine form.
struct Fine {
    form: Form,
    root: Flat,
    /// The level of the cells, and how many that is below.
    last: u8,
    levels: u32,
    /// How many levels below nodes are bricks, or cells that are drawn as a whole.
    drawn_at: u32,
    whole: bool,
    /// Whether lines of sight into it go both ways along an axis.
    beside_eye: bool,
    bricks: Option<BrickForm>,
}

impl Traversal<'_> {
    /// Draws a node and all below.
    #[inline(always)]
    pub(super) fn draw_orthogonal(&mut self, cube: &Cube) {
        let middle = Vec2::new(cube.projected.x, cube.projected.y) / cube.projected.z;
        let centre = cube.centre.extend(cube.projected.z);
        let (coarse, root) = Form::new(self.view, cube.level, cube.index, middle, centre);
        let mut fine = None;
        self.walker.flats.clear();
        self.walker.flats.push(Flat { clear: cube.clear, ..root });
        while let Some(mut flat) = self.walker.flats.pop() {
            let form =
                fine.as_ref().filter(|_| flat.fine).map_or(&coarse, |fine: &Fine| &fine.form);
            let level = form.level + flat.below as u8;
            if self.known.is_hidden(flat.index, level) {
                continue;
            }
            flat.clear |= self.known.is_clear(flat.index, level);
            self.counters.nodes += 1;
            let Some(area) = self.band.clip(form.span(&flat)) else { continue };
            if !self.is_open(&area, flat.clear) {
                continue;
            }
            if !flat.fine {
                if self.has_ratio(flat.centre.w, level, self.view.ratio_min) {
                    flat = fine.insert(self.fine(level, &flat, coarse.middle(&flat))).root;
                } else if level == self.octree.depth {
                    self.draw_cell(&flat, level, &area);
                    continue;
                } else if self.draw_near_layer(flat.index, level, flat.centre, &area) {
                    continue;
                }
            }
            match fine.as_mut().filter(|_| flat.fine) {
                Some(fine) => self.draw_fine(fine, &flat, &area),
                None => self.halve(&coarse, &flat),
            }
        }
    }

    /// A node with a form of its own.
    #[inline(always)]
    fn fine(&self, level: u8, flat: &Flat, middle: Vec2) -> Fine {
        let (form, root) = Form::new(self.view, level, flat.index, middle, flat.centre);
        let last = self.last_level(flat.centre.w, level);
        let levels = u32::from(last - level);
        let whole = levels < 2 || form.cell_px(levels) > WHOLE_PX;
        Fine {
            beside_eye: is_beside_eye(flat.centre, form.half),
            form,
            root: Flat { fine: true, clear: flat.clear, ..root },
            last,
            levels,
            drawn_at: if whole { levels } else { levels - 2 },
            whole,
            bricks: None,
        }
    }

    /// Draws a node with a fine form, or puts its octants on the stack.
    #[inline(always)]
    fn draw_fine(&mut self, fine: &mut Fine, flat: &Flat, area: &Area) {
        let level = fine.last - (fine.levels - flat.below) as u8;
        let is_cell = flat.below == fine.levels;
        let is_leaves = fine.last == self.octree.depth;
        if is_leaves && !is_cell && self.draw_layer(flat.index, level, flat.centre, area) {
            return;
        }
        if flat.below != fine.drawn_at {
            self.halve(&fine.form, flat);
        } else if fine.whole {
            self.draw_cell(flat, fine.last, area);
        } else {
            self.draw_brick(fine, flat, area);
        }
    }

    /// Puts the octants on the stack, so that the nearest comes off first.
    #[inline(always)]
    fn halve(&mut self, form: &Form, flat: &Flat) {
        let node = &self.octree.inner[flat.index as usize];
        let nearest = Vec3A::from_vec4(flat.centre).cmplt(Vec3A::ZERO).bitmask() as u8;
        for octant in (0..8).rev().map(|order| order ^ nearest) {
            if let Some(index) = node.child(octant) {
                self.walker.flats.push(form.octant(flat, usize::from(octant), index));
            }
        }
    }

    /// Draws a cell as a whole.
    #[inline(always)]
    fn draw_cell(&mut self, flat: &Flat, level: u8, area: &Area) {
        let look = self.look(flat.index, level);
        self.fill(flat.centre, level, look, area);
    }

    /// Draws a brick.
    #[inline(always)]
    fn draw_brick(&mut self, fine: &mut Fine, flat: &Flat, area: &Area) {
        let (octree, view, glass_from) = (self.octree, self.view, self.glass_from);
        let half = fine.form.half * halved(flat.below);
        let middle = fine.form.middle(flat);
        if fine.beside_eye {
            fine.bricks = Some(BrickForm::new(view, half, flat.centre, middle, 2));
        }
        let Fine { form, root, levels, bricks, .. } = fine;
        let form = bricks.get_or_insert_with(|| {
            BrickForm::new(view, form.half, root.centre, form.middle(root), *levels)
        });
        let brick = Brick::new(&octree.inner, view, flat, form, middle, half);
        let leaves = fine.last == octree.depth;
        let bricks = Bricks { octree, view, form, glass_from, leaves };
        if brick.some_glass {
            bricks.draw::<true>(self.band, &brick, area);
        } else {
            bricks.draw::<false>(self.band, &brick, area);
        }
    }

    /// Draws a node that is a whole layer of voxels larger than pixels, and tells whether it is.
    #[inline(always)]
    pub(super) fn draw_near_layer(
        &mut self,
        index: u32,
        level: u8,
        centre: Vec4,
        area: &Area,
    ) -> bool {
        let patterns = &self.view.patterns;
        let farthest = centre.w + patterns[usize::from(level)].reach.z;
        farthest <= patterns[usize::from(self.octree.depth) - 1].small_from
            && self.has_ratio(centre.w, level, 0.0)
            && self.draw_layer(index, level, centre, area)
    }

    /// Draws a node that is a whole layer of voxels, and tells whether it is.
    #[inline(always)]
    fn draw_layer(&mut self, index: u32, level: u8, centre: Vec4, area: &Area) -> bool {
        let node = &self.octree.inner[index as usize];
        let Some((axis, place)) = node.flat() else { return false };
        let glass = node.flags & (InnerNode::SOME_GLASS | InnerNode::GLASS);
        if glass == InnerNode::SOME_GLASS {
            return false;
        }
        let whole = Whole {
            centre: Vec3A::from_vec4(centre),
            depth: centre.w,
            half: self.view.patterns[usize::from(level)].half,
            levels: u32::from(self.octree.depth - level),
        };
        let layer = Layer::new(self.view, &whole, axis, place);
        let first = self.first_leaf(node, whole.levels);
        let materials = &self.octree.leaves[first..];
        if glass == 0 {
            self.band.fill_layer::<false>(self.view, area, &layer, materials);
        } else {
            self.band.fill_layer::<true>(self.view, area, &layer, materials);
        }
        true
    }

    /// The index of the first leaf below a node that is so many levels above the leaves.
    #[inline(always)]
    fn first_leaf(&self, node: &InnerNode, levels: u32) -> usize {
        let child = |first: u32, _| self.octree.inner[first as usize].first;
        (1..levels).fold(node.first, child) as usize
    }
}
