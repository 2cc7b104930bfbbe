//! Boxes in a tree: of very many gates out of one space, a step finds the few that it may reach.

use std::ops::Range;

use super::daabb::DAabb;

/// The most boxes at a leaf.
const LEAF_MAX: usize = 4;

/// A few boxes with a number each, in a tree.
pub(super) struct BoxTree {
    /// In the order of a walk that visits each node before the nodes below it.
    nodes: Vec<BoxNode>,
    /// The numbers of the boxes, leaf by leaf.
    numbers: Vec<u32>,
}

struct BoxNode {
    /// The box around all boxes below.
    bounds: DAabb,
    /// The numbers at a leaf, as indices into [`BoxTree::numbers`]. Empty at other nodes.
    numbers: Range<u32>,
    /// The node after those below this one.
    next: u32,
}

impl BoxTree {
    /// Puts boxes with their numbers in a tree.
    pub(super) fn new(mut boxes: Vec<(DAabb, u32)>) -> Self {
        let mut tree = Self { nodes: Vec::new(), numbers: Vec::with_capacity(boxes.len()) };
        tree.add(&mut boxes);
        debug_assert_eq!(tree.numbers.len(), boxes.len(), "each box is at one leaf");
        tree
    }

    fn add(&mut self, boxes: &mut [(DAabb, u32)]) {
        let Some(&(first, _)) = boxes.first() else { return };
        let bounds = boxes.iter().fold(first, |all, (region, _)| all.union(region));
        let (node, start) = (self.nodes.len(), self.numbers.len() as u32);
        self.nodes.push(BoxNode { bounds, numbers: start..start, next: 0 });
        if boxes.len() <= LEAF_MAX {
            self.numbers.extend(boxes.iter().map(|&(_, number)| number));
            self.nodes[node].numbers.end = self.numbers.len() as u32;
        } else {
            let axis = (bounds.max - bounds.min).max_position();
            let middle = |region: &DAabb| region.min[axis] + region.max[axis];
            let half = boxes.len() / 2;
            boxes.select_nth_unstable_by(half, |(a, one), (b, other)| {
                middle(a).total_cmp(&middle(b)).then(one.cmp(other))
            });
            let (lesser, greater) = boxes.split_at_mut(half);
            self.add(lesser);
            self.add(greater);
        }
        self.nodes[node].next = self.nodes.len() as u32;
    }

    /// Finds the numbers of all boxes that may meet a convex region, and of a few others, in
    /// ascending order. `may_meet` tells whether some of a box may be in the region; where it
    /// denies a box, it denies all boxes inside.
    pub(super) fn find(&self, may_meet: impl Fn(&DAabb) -> bool, found: &mut Vec<u32>) {
        found.clear();
        let mut index = 0;
        while let Some(node) = self.nodes.get(index) {
            // With one node, the boxes themselves are tested as soon.
            if self.nodes.len() > 1 && !may_meet(&node.bounds) {
                index = node.next as usize;
                continue;
            }
            found.extend(&self.numbers[node.numbers.start as usize..node.numbers.end as usize]);
            index += 1;
        }
        found.sort_unstable();
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;
    use crate::{HalfSpace, portal_flow::separators::HalfSpaces};

    fn vector(rng: &mut SmallRng, size: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| rng.random_range(-size..size)))
    }

    /// The tree finds what a test of each box finds, in the same order, and leaves out most others.
    #[test]
    fn a_tree_finds_the_boxes_that_a_test_of_each_finds() {
        let (mut others, mut tested) = (0, 0);
        for seed in 0..200 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let count = rng.random_range(0..300);
            let boxes: Vec<(DAabb, u32)> = (0..count)
                .map(|number| {
                    let (centre, half) = (vector(&mut rng, 20.0), vector(&mut rng, 1.0).abs());
                    (DAabb { min: centre - half, max: centre + half }, number)
                })
                .collect();
            let mut halves = HalfSpaces::none();
            for _ in 0..rng.random_range(1..8) {
                let normal = vector(&mut rng, 1.0).normalize();
                halves.push(HalfSpace { normal, distance: rng.random_range(-10.0..10.0) });
            }
            let meets = |(region, number): &(DAabb, u32)| halves.meet(region).then_some(*number);
            let expected: Vec<u32> = boxes.iter().filter_map(meets).collect();
            let mut found = vec![7];
            BoxTree::new(boxes).find(|region| halves.meet(region), &mut found);
            assert!(found.is_sorted(), "seed {seed}");
            let is_found = |number: &&u32| found.binary_search(number).is_ok();
            assert_eq!(expected.iter().filter(is_found).count(), expected.len(), "seed {seed}");
            others += found.len() - expected.len();
            tested += count as usize - expected.len();
        }
        assert!(others * 5 < tested, "of {tested} boxes outside, {others} were found");
    }
}
