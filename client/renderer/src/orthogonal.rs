//! Orthogonal mode: everything below a node is placed by form patterns (Dell 2012, Figs. 20 to 28).
//!
//! Two forms follow one another. The *coarse* form is that of a node that was projected. Nodes
//! below are placed by it, and each place is corrected for perspective. Where perspective inside of
//! a node cannot be seen, the node gets a *fine* form of its own. There the traversal decides at
//! which level cells are no larger than a pixel, and draws the last two levels together as bricks.
//! Layers of voxels are drawn wherever they turn up.

use glam::{Vec2, Vec3A, Vec4};
use sightline_world::octree::InnerNode;

use super::{
    brick::{Brick, Bricks, is_beside_eye},
    form::{BrickForm, Form, OrthoNode, halved},
    layer::{Layer, LayerNode},
    mask::Area,
    traversal::{PerspectiveNode, Traversal},
};

/// Cells with a longer edge, in pixels, are drawn one by one.
const WHOLE_PX: f32 = 8.0;

/// A node with a fine form.
struct FineForm {
    form: Form,
    root: OrthoNode,
    /// The level of the cells.
    last: u8,
    /// How many levels the cells are below the root.
    levels: u32,
    /// How many levels below the root nodes are drawn: bricks, or cells one by one.
    drawn_at: u32,
    /// Whether cells are drawn one by one.
    whole: bool,
    /// Whether lines of sight into the node go both ways along an axis.
    beside_eye: bool,
    bricks: Option<BrickForm>,
}

impl Traversal<'_> {
    /// Draws a node and everything below it.
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

    /// Gives a node a fine form.
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
        if is_leaves
            && !is_cell
            && node.centre.w >= self.view.ways.layers_from
            && self.draw_layer(node.index, level, node.centre, area)
        {
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

    /// Puts the octants of a node on the stack so that the nearest comes off first.
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

    /// Draws a cell by its outline.
    #[inline(always)]
    fn draw_cell(&mut self, node: &OrthoNode, level: u8, area: &Area) {
        let material_id = self.material_id(node.index, level);
        self.fill(node.centre, level, material_id, area);
    }

    /// Draws the cells two levels below a node.
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

    /// Draws a node that is one whole layer of voxels, each larger than a pixel. Returns whether it
    /// is.
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
        centre.w >= self.view.ways.layers_from
            && farthest <= patterns[usize::from(self.octree.depth) - 1].small_from
            && self.has_ratio(centre.w, level, 0.0)
            && self.draw_layer(index, level, centre, area)
    }

    /// Draws a node that is one whole layer of voxels. Returns whether it is.
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
        let material_ids = &self.octree.leaves[first..];
        if glass == 0 {
            self.band.fill_layer::<false>(self.view, area, &layer, material_ids);
        } else {
            self.band.fill_layer::<true>(self.view, area, &layer, material_ids);
        }
        true
    }

    /// The index of the first leaf below a node that is `levels` above the leaves.
    #[inline(always)]
    fn first_leaf(&self, node: &InnerNode, levels: u32) -> usize {
        let child = |first: u32, _| self.octree.inner[first as usize].first;
        (1..levels).fold(node.first, child) as usize
    }
}
