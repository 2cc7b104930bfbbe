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
    form::{BrickForm, Form, OrthoNode, halved},
    layer::{Layer, LayerNode},
    mask::Area,
    traversal::{PerspectiveNode, Traversal},
};

/// Cells whose edge is longer, in pixels, are drawn each as a whole.
const WHOLE_PX: f32 = 8.0;

/// A node with a fine form.
struct FineForm {
    form: Form,
    root: OrthoNode,
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
    pub(super) fn draw_orthogonal(&mut self, cube: &PerspectiveNode) {
        let middle = Vec2::new(cube.projected.x, cube.projected.y) / cube.projected.z;
        let centre = cube.centre.extend(cube.projected.z);
        let (coarse, root) = Form::new(self.view, cube.level, cube.index, middle, centre);
        let mut fine = None;
        self.stacks.orthogonal.clear();
        self.stacks.orthogonal.push(OrthoNode { unoccluded: cube.unoccluded, ..root });
        while let Some(mut node) = self.stacks.orthogonal.pop() {
            let form =
                fine.as_ref().filter(|_| node.fine).map_or(&coarse, |fine: &FineForm| &fine.form);
            let level = form.level + node.below as u8;
            if self.classes.is_hidden(node.index, level) {
                continue;
            }
            node.unoccluded |= self.classes.is_unoccluded(node.index, level);
            self.counters.nodes += 1;
            let Some(area) = self.band.clip(form.span(&node)) else { continue };
            if !self.is_open(&area, node.unoccluded) {
                continue;
            }
            if !node.fine {
                if self.has_ratio(node.centre.w, level, self.view.ratio_min) {
                    node = fine.insert(self.fine(level, &node, coarse.middle(&node))).root;
                } else if level == self.octree.depth {
                    self.draw_cell(&node, level, &area);
                    continue;
                } else if self.draw_near_layer(node.index, level, node.centre, &area) {
                    continue;
                }
            }
            match fine.as_mut().filter(|_| node.fine) {
                Some(fine) => self.draw_fine(fine, &node, &area),
                None => self.halve(&coarse, &node),
            }
        }
    }

    /// A node with a form of its own.
    #[inline(always)]
    fn fine(&self, level: u8, node: &OrthoNode, middle: Vec2) -> FineForm {
        let (form, root) = Form::new(self.view, level, node.index, middle, node.centre);
        let last = self.last_level(node.centre.w, level);
        let levels = u32::from(last - level);
        let whole = levels < 2 || form.cell_px(levels) > WHOLE_PX;
        FineForm {
            beside_eye: is_beside_eye(node.centre, form.half),
            form,
            root: OrthoNode { fine: true, unoccluded: node.unoccluded, ..root },
            last,
            levels,
            drawn_at: if whole { levels } else { levels - 2 },
            whole,
            bricks: None,
        }
    }

    /// Draws a node with a fine form, or puts its octants on the stack.
    #[inline(always)]
    fn draw_fine(&mut self, fine: &mut FineForm, node: &OrthoNode, area: &Area) {
        let level = fine.last - (fine.levels - node.below) as u8;
        let is_cell = node.below == fine.levels;
        let is_leaves = fine.last == self.octree.depth;
        if is_leaves && !is_cell && self.draw_layer(node.index, level, node.centre, area) {
            return;
        }
        if node.below != fine.drawn_at {
            self.halve(&fine.form, node);
        } else if fine.whole {
            self.draw_cell(node, fine.last, area);
        } else {
            self.draw_brick(fine, node, area);
        }
    }

    /// Puts the octants on the stack, so that the nearest comes off first.
    #[inline(always)]
    fn halve(&mut self, form: &Form, parent: &OrthoNode) {
        let node = &self.octree.inner[parent.index as usize];
        let nearest = Vec3A::from_vec4(parent.centre).cmplt(Vec3A::ZERO).bitmask() as u8;
        for octant in (0..8).rev().map(|order| order ^ nearest) {
            if let Some(index) = node.child(octant) {
                self.stacks.orthogonal.push(form.octant(parent, usize::from(octant), index));
            }
        }
    }

    /// Draws a cell as a whole.
    #[inline(always)]
    fn draw_cell(&mut self, node: &OrthoNode, level: u8, area: &Area) {
        let material_id = self.material_id(node.index, level);
        self.fill(node.centre, level, material_id, area);
    }

    /// Draws a brick.
    #[inline(always)]
    fn draw_brick(&mut self, fine: &mut FineForm, node: &OrthoNode, area: &Area) {
        let (octree, view, glass_from) = (self.octree, self.view, self.glass_from);
        let half = fine.form.half * halved(node.below);
        let middle = fine.form.middle(node);
        if fine.beside_eye {
            fine.bricks = Some(BrickForm::new(view, half, node.centre, middle, 2));
        }
        let FineForm { form, root, levels, bricks, .. } = fine;
        let form = bricks.get_or_insert_with(|| {
            BrickForm::new(view, form.half, root.centre, form.middle(root), *levels)
        });
        let brick = Brick::new(&octree.inner, view, node, form, middle, half);
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
        let whole = LayerNode {
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
