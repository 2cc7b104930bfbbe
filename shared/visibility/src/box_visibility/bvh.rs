//! A bounding volume hierarchy, so that a line is compared with few of many boxes.

use std::ops::ControlFlow;

use glam::{Vec3A, Vec4};
use sightline_world::{geometry::Aabb, tolerance::TREE_MARGIN_M};

use super::sight_line::SightLine;

/// The most boxes in a leaf.
const LEAF_MAX: usize = 4;

/// A binary tree of boxes. It takes at most two nodes of 32 bytes for each box.
#[derive(Clone, Debug, Default)]
pub(super) struct Bvh {
    nodes: Vec<BvhNode>,
    /// The indices of the boxes, leaf by leaf.
    order: Vec<u32>,
}

/// The box around everything below a node. The last lanes hold the bits of two whole numbers.
#[derive(Clone, Copy, Debug)]
struct BvhNode {
    low: Vec4,
    high: Vec4,
}

impl BvhNode {
    fn new(bounds: &Aabb, at: u32, count: u32) -> Self {
        let number = f32::from_bits;
        Self { low: bounds.min.extend(number(at)), high: bounds.max.extend(number(count)) }
    }

    /// For a leaf, the place in `order` at which it begins. For any other node, the index of its
    /// second child; the first child is the next node.
    fn at(&self) -> u32 {
        self.low.w.to_bits()
    }

    /// The number of boxes in a leaf; 0 for any other node.
    fn count(&self) -> u32 {
        self.high.w.to_bits()
    }
}

impl Bvh {
    pub fn new(boxes: &[Aabb]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            let mut order = std::mem::take(&mut tree.order);
            tree.grow(boxes, &mut order, 0);
            tree.order = order;
        }
        debug_assert!(tree.nodes.len() <= 2 * boxes.len(), "two nodes for each box");
        tree
    }

    fn grow(&mut self, boxes: &[Aabb], order: &mut [u32], at: u32) {
        let of = |&index: &u32| &boxes[index as usize];
        let bounds = order.iter().map(of).fold(Aabb::EMPTY, |all, one| all.union(one));
        let node = self.nodes.len();
        let count = order.len();
        let bounds = bounds.grown(TREE_MARGIN_M);
        self.nodes.push(BvhNode::new(&bounds, at, count as u32));
        if count <= LEAF_MAX {
            return;
        }
        let middles = Aabb::from_points(order.iter().map(|index| of(index).centre()));
        let axis = middles.size().max_position();
        let middle = |index: &u32| of(index).centre()[axis];
        order.select_nth_unstable_by(count / 2, |a, b| {
            middle(a).total_cmp(&middle(b)).then(a.cmp(b))
        });
        let (low, high) = order.split_at_mut(count / 2);
        self.grow(boxes, low, at);
        let second = self.nodes.len() as u32;
        self.grow(boxes, high, at + (count / 2) as u32);
        self.nodes[node] = BvhNode::new(&bounds, second, 0);
    }

    /// Visits every box that a line meets or comes near to, until `visit` breaks. `visited` grows
    /// by the number of nodes visited.
    pub fn along<B>(
        &self,
        line: &SightLine,
        visited: &mut u32,
        mut visit: impl FnMut(u32, &mut u32) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let (from, to) = (Vec3A::from(line.from), Vec3A::from(line.to));
        let inverse = (to - from).recip();
        self.walk(
            |low, high| {
                let (a, b) = ((low - from) * inverse, (high - from) * inverse);
                // A line in the plane of a face may miss the box here. That only makes it free.
                let enter = a.min(b).max_element().max(0.0);
                let leave = a.max(b).min_element().min(1.0);
                enter <= leave * (1.0 + 1e-5)
            },
            visited,
            &mut visit,
        )
    }

    /// Visits every box that touches a region, until `visit` breaks.
    pub fn touching<B>(
        &self,
        region: &Aabb,
        mut visit: impl FnMut(u32) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let mut visit = |index: u32, _: &mut u32| visit(index);
        let (min, max) = (Vec3A::from(region.min), Vec3A::from(region.max));
        let touches = |low: Vec3A, high: Vec3A| (low.cmple(max) & high.cmpge(min)).all();
        self.walk(touches, &mut 0, &mut visit)
    }

    fn walk<B>(
        &self,
        enters: impl Fn(Vec3A, Vec3A) -> bool,
        visited: &mut u32,
        visit: &mut impl FnMut(u32, &mut u32) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        // Halving 2³² boxes takes 32 levels.
        let (mut stack, mut height) = ([0u32; 34], usize::from(!self.nodes.is_empty()));
        while height > 0 {
            height -= 1;
            let index = stack[height];
            let node = &self.nodes[index as usize];
            *visited += 1;
            if !enters(Vec3A::from_vec4(node.low), Vec3A::from_vec4(node.high)) {
                continue;
            }
            if node.count() == 0 {
                (stack[height], stack[height + 1]) = (node.at(), index + 1);
                height += 2;
                continue;
            }
            let (at, count) = (node.at() as usize, node.count() as usize);
            for &index in &self.order[at..at + count] {
                visit(index, visited)?;
            }
        }
        ControlFlow::Continue(())
    }

    /// Heap memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<BvhNode>() + self.order.len() * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;

    #[test]
    fn every_box_on_a_line_is_visited() {
        let mut rng = SmallRng::seed_from_u64(3);
        let mut point = || Vec3::new(rng.random(), rng.random(), rng.random()) * 30.0;
        let boxes: Vec<Aabb> = (0..300).map(|i| Aabb::around(point(), (i % 7) as f32)).collect();
        let tree = Bvh::new(&boxes);
        for _ in 0..300 {
            let line = SightLine { from: point(), to: point() };
            let (mut found, mut visited) = (vec![false; boxes.len()], 0);
            let flow = tree.along(&line, &mut visited, |index, _| {
                found[index as usize] = true;
                ControlFlow::<()>::Continue(())
            });
            assert!(flow.is_continue() && visited > 0);
            for (region, found) in boxes.iter().zip(found) {
                let is_on = (0..=1_000)
                    .any(|i| region.contains(line.from.lerp(line.to, i as f32 / 1_000.0)));
                assert!(found || !is_on);
            }
        }
    }
}
