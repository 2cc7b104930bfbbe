//! The map's own subdivision and PVS, in our axes and units; see [`sightline_world::Origin`].

use glam::{DVec3, Vec3};
use sightline_world::{
    Origin, OriginLeaf, OriginNode, OriginPlane, OriginSide, OriginTree, geometry::Aabb,
};

use super::{
    error::BspError,
    map::{Map, Plane},
    tree::{Leaf, Tree},
    units::{UNIT, placed},
};

/// The original without its solids, which [`super::brushes`] adds.
pub(super) fn origin(map: &Map<'_>) -> Result<Origin, BspError> {
    let planes = map.planes.iter().map(plane).collect();
    Ok(Origin { planes, solids: Vec::new(), tree: tree(&map.tree)? })
}

/// The box around points in Quake units, which may be anywhere. Never empty.
pub(super) fn bounds(corners: impl IntoIterator<Item = DVec3>) -> Aabb {
    let limit = DVec3::splat(1e6);
    Aabb::from_points(corners.into_iter().map(|corner| placed(corner.clamp(-limit, limit))))
}

fn plane(plane: &Plane) -> OriginPlane {
    let Plane { normal, distance } = *plane;
    // An invalid plane belongs to no brush with faces. In a tree, all points are on one side of it.
    let is_sane = normal.abs().max_element() <= 1.01 && distance.abs() <= 1e7;
    let (normal, distance) = if is_sane { (normal, distance) } else { (DVec3::ZERO, 0.0) };
    let normal = Vec3::new(normal.x as f32, normal.z as f32, -normal.y as f32);
    OriginPlane { normal, distance: distance * UNIT }
}

/// The tree of the map, with its nodes in breadth-first order. None when the map has no clusters. A
/// graph that is not a tree is an error.
fn tree(tree: &Tree<'_>) -> Result<Option<OriginTree>, BspError> {
    if tree.nodes.is_empty() || tree.leafs.iter().all(|leaf| leaf.cluster.is_none()) {
        return Ok(None);
    }
    let fault = || BspError::Index { what: "node" };
    let mut order = vec![0];
    let mut new_index = vec![None; tree.nodes.len()];
    new_index[0] = Some(0);
    let mut next = 0;
    while next < order.len() {
        for side in tree.nodes[order[next] as usize].sides {
            if let OriginSide::Node(node) = side {
                let known = new_index.get_mut(node as usize).ok_or_else(fault)?;
                // A node with two parents would make an endless tree.
                if known.replace(order.len() as u32).is_some() {
                    return Err(fault());
                }
                order.push(node);
            }
        }
        next += 1;
    }
    assert!(order.len() <= tree.nodes.len(), "each node is visited once");
    let renamed = |side| match side {
        OriginSide::Node(node) => OriginSide::Node(new_index[node as usize].unwrap_or_default()),
        leaf @ OriginSide::Leaf(_) => leaf,
    };
    let node = |&old: &u32| {
        let OriginNode { plane, sides } = tree.nodes[old as usize];
        OriginNode { plane, sides: sides.map(renamed) }
    };
    let leaf =
        |leaf: &Leaf| OriginLeaf { bounds: bounds([leaf.min, leaf.max]), cluster: leaf.cluster };
    Ok(Some(OriginTree {
        nodes: order.iter().map(node).collect(),
        leafs: tree.leafs.iter().map(leaf).collect(),
        clusters: tree.clusters,
        visible: tree.visible(),
    }))
}
