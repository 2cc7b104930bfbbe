//! Nodes: the parts of patches between which light is exchanged. A node is a block of points with
//! nothing between them, so that no light passes through a wall inside a node.

use std::collections::BTreeMap;

use glam::Vec3;

use super::super::{
    patch::{Patch, Spread},
    shell::Shell,
    varying::Varying,
};

/// A node is this many points wide at most.
const WIDTH: i32 = 4;

/// The index of no node: that of points inside something solid.
pub(super) const NO_NODE: u32 = u32::MAX;

/// A part of a patch.
pub(super) struct Node {
    pub(super) patch: u32,
    /// In square metres.
    pub(super) area: f32,
    /// Its points, as indices into those of all patches.
    pub(super) points: Vec<u32>,
    /// The area that is nearest to each point or to one before it, as a share of the node's.
    ends: Vec<f32>,
}

impl Node {
    /// The point for a number from 0 to 1: each has as much of that range as of the area.
    pub(super) fn point(&self, number: f32) -> u32 {
        let at = self.ends.partition_point(|end| *end < number);
        self.points[at.min(self.points.len() - 1)]
    }

    /// The mean of a value over the area.
    pub(super) fn mean(&self, of: impl Fn(usize) -> Vec3) -> Vec3 {
        let mut before = 0.0;
        let mut sum = Vec3::ZERO;
        for (point, end) in self.points.iter().zip(&self.ends) {
            sum += of(*point as usize) * (end - before);
            before = *end;
        }
        sum
    }
}

/// All nodes, and all points of all patches, one patch after the other.
pub(super) struct Nodes {
    pub(super) list: Vec<Node>,
    /// The index of the first point of each patch, and the number of all points.
    pub(super) first: Vec<usize>,
    /// The patch and the node of each point.
    pub(super) patch_of: Vec<u32>,
    pub(super) node_of: Vec<u32>,
}

impl Nodes {
    /// The nodes of some patches. Patches that receive no light have none.
    pub(super) fn new(patches: &[Patch], receives: impl Fn(usize) -> bool) -> Self {
        let mut nodes =
            Self { list: Vec::new(), first: vec![0], patch_of: Vec::new(), node_of: Vec::new() };
        for (index, patch) in patches.iter().enumerate() {
            let first = nodes.patch_of.len();
            nodes.patch_of.resize(first + patch.len(), index as u32);
            nodes.node_of.resize(first + patch.len(), NO_NODE);
            nodes.first.push(first + patch.len());
            if !receives(index) {
                continue;
            }
            let blocks = match &patch.spread {
                Spread::Even { .. } => vec![vec![0]],
                Spread::Varying(varying) => blocks(varying),
            };
            for block in blocks {
                let open: Vec<u32> = block
                    .into_iter()
                    .filter(|&point| patch.point(point).is_some())
                    .map(|point| (first + point) as u32)
                    .collect();
                if open.is_empty() {
                    continue;
                }
                let number = nodes.list.len() as u32;
                open.iter().for_each(|&point| nodes.node_of[point as usize] = number);
                let mut all = 0.0;
                let mut ends: Vec<f32> = Vec::with_capacity(open.len());
                for &point in &open {
                    all += patch.share(point as usize - first);
                    ends.push(all);
                }
                if all <= 0.0 {
                    // Points beyond the edge of the patch: they count where light is blended.
                    ends = (1..=open.len()).map(|i| i as f32).collect();
                }
                let most = ends[ends.len() - 1];
                ends.iter_mut().for_each(|end| *end /= most);
                nodes.list.push(Node {
                    patch: index as u32,
                    area: patch.area * all,
                    points: open,
                    ends,
                });
            }
        }
        assert_eq!(nodes.first.len(), patches.len() + 1, "each patch has its points");
        nodes
    }

    /// The node at a place just off a patch.
    pub(super) fn at(
        &self,
        patch: usize,
        patches: &[Patch],
        place: Vec3,
        shell: &Shell,
    ) -> Option<usize> {
        let point = self.first[patch] + patches[patch].nearest(place, shell)?;
        let node = self.node_of[point];
        (node != NO_NODE).then_some(node as usize)
    }

    /// A point of a patch, by its index among all points. None inside something solid.
    pub(super) fn point(&self, patches: &[Patch], point: usize) -> Option<Vec3> {
        let patch = self.patch_of[point] as usize;
        patches[patch].point(point - self.first[patch])
    }
}

/// Points of a lattice in blocks, and each block in parts with nothing between their points.
fn blocks(varying: &Varying) -> Vec<Vec<usize>> {
    let places: Vec<(i32, i32)> = varying.places().collect();
    let block = |point: usize| {
        let (column, row) = places[point];
        (column.div_euclid(WIDTH), row.div_euclid(WIDTH))
    };
    let mut above: Vec<usize> = (0..places.len()).collect();
    for (point, &place) in places.iter().enumerate() {
        let next = [varying.next_along(point, place), varying.next_across(point, place)];
        for next in next.into_iter().flatten().filter(|next| block(*next) == block(point)) {
            let (a, b) = (root(&mut above, point), root(&mut above, next));
            above[a.max(b)] = a.min(b);
        }
    }
    let mut blocks: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for point in 0..places.len() {
        blocks.entry(root(&mut above, point)).or_default().push(point);
    }
    blocks.into_values().collect()
}

fn root(above: &mut [usize], mut at: usize) -> usize {
    while above[at] != at {
        above[at] = above[above[at]];
        at = above[at];
    }
    at
}
