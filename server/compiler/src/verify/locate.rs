//! The leaf of a map's tree that contains a point: the same answer as [`Origin::leaf_at`], several
//! times as fast.

use glam::{Vec3, Vec4};
use sightline_world::tolerance::UNSURE_SIDE_M;
use sightline_world::{Origin, OriginSide, OriginTree};

/// The tree of a map, packed for single precision.
pub(super) struct Locator<'a> {
    origin: &'a Origin,
    nodes: Vec<Node>,
}

struct Node {
    /// The normal of the plane, and its negated distance.
    plane: Vec4,
    /// Indices of nodes, or complements of indices of leafs.
    sides: [i32; 2],
    /// The index of the plane in double precision.
    exact: u32,
}

impl<'a> Locator<'a> {
    pub(super) fn new(origin: &'a Origin, tree: &OriginTree) -> Self {
        let side = |side| match side {
            OriginSide::Node(node) => node as i32,
            OriginSide::Leaf(leaf) => !(leaf as i32),
        };
        let nodes = tree.nodes.iter().map(|node| {
            let plane = &origin.planes[node.plane as usize];
            Node {
                plane: plane.normal.extend(-plane.distance as f32),
                sides: node.sides.map(side),
                exact: node.plane,
            }
        });
        Self { origin, nodes: nodes.collect() }
    }

    /// The leaf that contains a point.
    pub(super) fn leaf_at(&self, point: Vec3) -> u32 {
        let mut next = 0;
        while let Ok(node) = usize::try_from(next) {
            let Node { plane, sides, exact } = &self.nodes[node];
            let height = plane.dot(point.extend(1.0));
            let behind = if height.abs() > UNSURE_SIDE_M {
                height < 0.0
            } else {
                self.origin.planes[*exact as usize].height(point.as_dvec3()) < 0.0
            };
            next = sides[usize::from(behind)];
        }
        !next as u32
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand::{Rng, SeedableRng, rngs::SmallRng};
    use sightline_world::{OriginLeaf, OriginNode, OriginPlane, geometry::Aabb};

    use super::*;

    #[test]
    fn the_packed_tree_finds_the_same_leafs() {
        let mut rng = SmallRng::seed_from_u64(1);
        let bounds = Aabb::around(Vec3::ZERO, 50.0);
        let planes: Vec<OriginPlane> = (0..63)
            .map(|i| {
                let mut normal = Vec3::ZERO;
                normal[i % 3] = 1.0;
                if i % 4 == 0 {
                    normal = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
                }
                OriginPlane { normal: normal.normalize(), distance: rng.random_range(-40.0..40.0) }
            })
            .collect();
        // A complete binary tree in heap order.
        let side = |i: u32| if i < 63 { OriginSide::Node(i) } else { OriginSide::Leaf(i - 63) };
        let node = |i| OriginNode { plane: i, sides: [side(2 * i + 1), side(2 * i + 2)] };
        let tree = OriginTree {
            nodes: (0..63).map(node).collect(),
            leafs: vec![OriginLeaf { bounds, cluster: None }; 64],
            clusters: 0,
            visible: Vec::new(),
        };
        let mut origin = Origin { planes, solids: Vec::new(), tree: None };
        origin.tree = Some(tree.clone());
        let locator = Locator::new(&origin, &tree);
        for i in 0..20_000 {
            let mut point =
                Vec3::from_array(std::array::from_fn(|_| rng.random_range(-50.0..50.0)));
            // Every other point is as near to a plane as rounding allows.
            let plane = &origin.planes[i % 63];
            if i % 2 == 0 {
                let foot =
                    point.as_dvec3() - plane.normal.as_dvec3() * plane.height(point.as_dvec3());
                point = (foot + DVec3::splat(rng.random_range(-1e-6..1e-6))).as_vec3();
            }
            let slow = origin.leaf_at(point.as_dvec3());
            assert_eq!(Some(locator.leaf_at(point)), slow, "{point}");
        }
    }
}
