//! Boxes from which random points are drawn.

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_world::{OriginLeaf, OriginTree, geometry::Aabb};

/// Boxes from which points are drawn. A box is as likely as its volume.
pub(super) struct Boxes {
    /// The owner of each box, and the box.
    boxes: Vec<(u32, Aabb)>,
    /// The volume of each box and all before it.
    volumes: Vec<f64>,
}

impl Boxes {
    pub(super) fn new(boxes: impl IntoIterator<Item = (u32, Aabb)>) -> Self {
        let boxes: Vec<_> = boxes.into_iter().collect();
        let mut sum = 0.0;
        let volumes = boxes.iter().map(|(_, b)| {
            sum += b.size().as_dvec3().element_product();
            sum
        });
        let volumes: Vec<f64> = volumes.collect();
        debug_assert!(volumes.is_sorted(), "volumes add up");
        Self { volumes, boxes }
    }

    /// The boxes of some leafs of a map, a Quake unit larger: the map rounds them down to whole
    /// units.
    pub(super) fn of_leafs(tree: &OriginTree, leafs: impl IntoIterator<Item = usize>) -> Self {
        let larger = |leaf: usize| tree.leafs[leaf].bounds.grown(0.0254);
        Self::new(leafs.into_iter().map(|leaf| (leaf as u32, larger(leaf))))
    }

    /// For each cluster of a map, the boxes of its leafs.
    pub(super) fn of_clusters(tree: &OriginTree) -> Vec<Self> {
        let mut leafs_of = vec![Vec::new(); tree.clusters as usize];
        for (leaf, OriginLeaf { cluster, .. }) in tree.leafs.iter().enumerate() {
            if let Some(cluster) = *cluster {
                leafs_of[cluster as usize].push(leaf);
            }
        }
        leafs_of.into_iter().map(|leafs| Self::of_leafs(tree, leafs)).collect()
    }

    /// A point of a random box, and the owner of the box. Where boxes overlap, the caller keeps a
    /// point only if it belongs to that owner: then all points are equally likely.
    pub(super) fn draw(&self, rng: &mut SmallRng) -> Option<(u32, Vec3)> {
        let at = rng.random::<f64>() * self.volumes.last()?;
        let index = self.volumes.partition_point(|&volume| volume <= at);
        let (owner, bounds) = self.boxes.get(index.min(self.boxes.len() - 1))?;
        Some((*owner, point_in(bounds, rng)))
    }
}

/// A uniform random point of a box.
pub(super) fn point_in(bounds: &Aabb, rng: &mut SmallRng) -> Vec3 {
    bounds.min + bounds.size() * Vec3::new(rng.random(), rng.random(), rng.random())
}
