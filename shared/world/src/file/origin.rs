//! The section of a Quake map's own data.

use super::{
    ReadError, list,
    reader::SectionReader,
    writer::{put_aabb, put_count, put_u32, put_vec3},
};
use crate::origin::{Origin, OriginLeaf, OriginNode, OriginPlane, OriginSide, OriginTree, Solid};

/// The greatest number of clusters: eight times as many as the game takes.
const CLUSTERS_MAX: usize = 1 << 18;
/// The greatest number of sides of a brush.
const SIDES_MAX: usize = 128;

/// A byte tells whether there is map data; its planes and solids follow. Another byte tells whether
/// there is a tree, which follows.
pub(super) fn to_bytes(origin: Option<&Origin>) -> Vec<u8> {
    let Some(origin) = origin else { return vec![0] };
    let mut out = vec![1];
    put_count(&mut out, origin.planes.len());
    for plane in &origin.planes {
        put_vec3(&mut out, plane.normal);
        out.extend_from_slice(&plane.distance.to_le_bytes());
    }
    put_count(&mut out, origin.solids.len());
    for solid in &origin.solids {
        put_aabb(&mut out, &solid.bounds);
        put_count(&mut out, solid.sides.len());
        solid.sides.iter().for_each(|&side| put_u32(&mut out, side));
    }
    out.push(u8::from(origin.tree.is_some()));
    if let Some(tree) = &origin.tree {
        put_tree(&mut out, tree);
    }
    out
}

fn put_tree(out: &mut Vec<u8>, tree: &OriginTree) {
    put_count(out, tree.leafs.len());
    put_u32(out, tree.clusters);
    for leaf in &tree.leafs {
        put_aabb(out, &leaf.bounds);
        put_u32(out, leaf.cluster.unwrap_or(u32::MAX));
    }
    put_count(out, tree.nodes.len());
    for node in &tree.nodes {
        put_u32(out, node.plane);
        for side in node.sides {
            // As in the map's own format: leafs are complements.
            put_u32(
                out,
                match side {
                    OriginSide::Node(node) => node,
                    OriginSide::Leaf(leaf) => !leaf,
                },
            );
        }
    }
    put_count(out, tree.visible.len());
    out.extend_from_slice(&tree.visible);
}

pub(super) fn read(input: &mut SectionReader<'_>) -> Result<Option<Origin>, ReadError> {
    const BAD: ReadError = ReadError::Malformed("the original map");
    let origin = match input.u8()? {
        0 => None,
        1 => {
            let planes = read_planes(input)?;
            let solids = read_solids(input, planes.len())?;
            let tree = match input.u8()? {
                0 => None,
                1 => Some(read_tree(input, planes.len())?),
                _ => return Err(BAD),
            };
            Some(Origin { planes, solids, tree })
        }
        _ => return Err(BAD),
    };
    if input.is_empty() { Ok(origin) } else { Err(BAD) }
}

fn read_planes(input: &mut SectionReader<'_>) -> Result<Vec<OriginPlane>, ReadError> {
    let count = input.count(20)?;
    (0..count)
        .map(|_| {
            let (normal, distance) = (input.vec3()?, input.f64()?);
            // Heights stay far from infinity.
            if normal.abs().max_element() > 2.0 {
                return Err(ReadError::Malformed("a plane of the original map"));
            }
            Ok(OriginPlane { normal, distance })
        })
        .collect()
}

fn read_solids(input: &mut SectionReader<'_>, planes: usize) -> Result<Vec<Solid>, ReadError> {
    let count = input.count(28)?;
    let mut solids = list(count)?;
    for _ in 0..count {
        let bounds = input.aabb()?;
        let sides = input.count(4)?;
        if sides > SIDES_MAX {
            return Err(ReadError::Malformed("a solid of the original map"));
        }
        let sides = (0..sides).map(|_| index(input, planes)).collect::<Result<_, _>>()?;
        solids.push(Solid { bounds, sides });
    }
    Ok(solids)
}

fn read_tree(input: &mut SectionReader<'_>, planes: usize) -> Result<OriginTree, ReadError> {
    const BAD: ReadError = ReadError::Malformed("the original map's tree");
    let leaf_count = input.u32()? as usize;
    let clusters = input.u32()?;
    if leaf_count > input.len() / 28 || clusters as usize > CLUSTERS_MAX {
        return Err(BAD);
    }
    let mut leafs = list(leaf_count)?;
    for _ in 0..leaf_count {
        let (bounds, cluster) = (input.aabb()?, input.u32()?);
        let cluster = (cluster != u32::MAX).then_some(cluster);
        if cluster.is_some_and(|cluster| cluster >= clusters) {
            return Err(BAD);
        }
        leafs.push(OriginLeaf { bounds, cluster });
    }
    let count = input.count(12)?;
    let mut nodes = list(count)?;
    for own in 0..count as u32 {
        let plane = index(input, planes)?;
        let mut side = || match input.u32()? {
            node if (node as usize) < count && node > own => Ok(OriginSide::Node(node)),
            leaf if ((!leaf) as usize) < leaf_count => Ok(OriginSide::Leaf(!leaf)),
            _ => Err(BAD),
        };
        nodes.push(OriginNode { plane, sides: [side()?, side()?] });
    }
    let visible = input.count(1)?;
    let visible = input.take(visible)?.to_vec();
    let tree = OriginTree { nodes, leafs, clusters, visible };
    let whole = tree.row_bytes() * clusters as usize;
    if tree.nodes.is_empty() || !(tree.visible.is_empty() || tree.visible.len() == whole) {
        return Err(BAD);
    }
    Ok(tree)
}

fn index(input: &mut SectionReader<'_>, within: usize) -> Result<u32, ReadError> {
    let index = input.u32()?;
    if (index as usize) < within {
        Ok(index)
    } else {
        Err(ReadError::Malformed("an index of the original map"))
    }
}
