//! What a Quake map says of itself, kept in its world so that both can be verified: the brushes that
//! block sight as they were, without rounding to triangles, and the map's own subdivision and PVS.

use glam::{DVec3, Vec3};

use super::{
    ReadError,
    file::{SectionReader, put_aabb, put_u32, put_vec3},
};
use crate::geometry::Aabb;

/// The most clusters of a map: eight times what the game itself takes.
const CLUSTERS_MAX: usize = 1 << 18;
/// A brush has no more sides.
const SIDES_MAX: usize = 128;

/// The original of a world that comes from a Quake map.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Origin {
    /// The planes of solids and nodes.
    pub planes: Vec<OriginPlane>,
    /// The brushes that block sight. Patches block it too, but are only among the triangles.
    pub solids: Vec<Solid>,
    /// The map's own subdivision, for a map that has one.
    pub tree: Option<OriginTree>,
}

/// A plane: the points with `normal · p = distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginPlane {
    /// Of unit length as well as the map's author cared.
    pub normal: Vec3,
    /// In metres.
    pub distance: f64,
}

impl OriginPlane {
    /// How far a point is in front of the plane, in metres.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.as_dvec3().dot(point) - self.distance
    }
}

/// A convex solid: what is behind all its sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// All of it is inside, in metres.
    pub bounds: Aabb,
    /// Indices into [`Origin::planes`].
    pub sides: Vec<u32>,
}

/// The map's own BSP, and its vis lump.
#[derive(Clone, Debug, PartialEq)]
pub struct OriginTree {
    /// The root comes first. Never empty.
    pub nodes: Vec<OriginNode>,
    /// The leafs, none of them twice in the tree.
    pub leafs: Vec<OriginLeaf>,
    /// How many clusters there are.
    pub clusters: u32,
    /// A bit for each pair of clusters, whole bytes for each row; empty when the map was never vised.
    pub visible: Vec<u8>,
}

/// A node of the map's BSP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginNode {
    /// Index into [`Origin::planes`].
    pub plane: u32,
    /// What is in front of the plane, and what is behind it.
    pub sides: [OriginSide; 2],
}

/// Where a node leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OriginSide {
    /// Index into [`OriginTree::nodes`], greater than that of the node that leads there.
    Node(u32),
    /// Index into [`OriginTree::leafs`].
    Leaf(u32),
}

/// A leaf of the map's BSP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OriginLeaf {
    /// Its extent as the map tells it, in metres.
    pub bounds: Aabb,
    /// Which cluster it belongs to; none when it is solid or outside.
    pub cluster: Option<u32>,
}

impl Origin {
    /// The leaf of the map's own tree that contains a point, if there is a tree.
    pub fn leaf_at(&self, point: DVec3) -> Option<u32> {
        let tree = self.tree.as_ref()?;
        let mut node = 0;
        loop {
            let OriginNode { plane, sides } = tree.nodes[node];
            let behind = self.planes[plane as usize].height(point) < 0.0;
            match sides[usize::from(behind)] {
                OriginSide::Leaf(leaf) => return Some(leaf),
                OriginSide::Node(below) => node = below as usize,
            }
        }
    }

    /// The sides of a solid.
    pub fn sides<'a>(&'a self, solid: &'a Solid) -> impl Iterator<Item = &'a OriginPlane> {
        solid.sides.iter().map(|&side| &self.planes[side as usize])
    }
}

impl OriginTree {
    /// Whether the map's own PVS holds a pair of clusters; all, when it was never vised.
    pub fn sees(&self, from: u32, to: u32) -> bool {
        let byte = from as usize * self.row_bytes() + to as usize / 8;
        self.visible.get(byte).is_none_or(|byte| byte & 1 << (to % 8) != 0)
    }

    /// The bytes of one row of [`OriginTree::visible`].
    pub fn row_bytes(&self) -> usize {
        (self.clusters as usize).div_ceil(8)
    }
}

/// A section: a byte that says whether there is an original, then its parts, then likewise its tree.
pub(super) fn to_bytes(origin: Option<&Origin>) -> Vec<u8> {
    let Some(origin) = origin else { return vec![0] };
    let mut out = vec![1];
    put_u32(&mut out, origin.planes.len() as u32);
    for plane in &origin.planes {
        put_vec3(&mut out, plane.normal);
        out.extend_from_slice(&plane.distance.to_le_bytes());
    }
    put_u32(&mut out, origin.solids.len() as u32);
    for solid in &origin.solids {
        put_aabb(&mut out, &solid.bounds);
        put_u32(&mut out, solid.sides.len() as u32);
        solid.sides.iter().for_each(|&side| put_u32(&mut out, side));
    }
    out.push(u8::from(origin.tree.is_some()));
    if let Some(tree) = &origin.tree {
        put_tree(&mut out, tree);
    }
    out
}

fn put_tree(out: &mut Vec<u8>, tree: &OriginTree) {
    put_u32(out, tree.leafs.len() as u32);
    put_u32(out, tree.clusters);
    for leaf in &tree.leafs {
        put_aabb(out, &leaf.bounds);
        put_u32(out, leaf.cluster.unwrap_or(u32::MAX));
    }
    put_u32(out, tree.nodes.len() as u32);
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
    put_u32(out, tree.visible.len() as u32);
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
    let mut solids = Vec::with_capacity(count);
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
    let mut leafs = Vec::with_capacity(leaf_count);
    for _ in 0..leaf_count {
        let (bounds, cluster) = (input.aabb()?, input.u32()?);
        let cluster = (cluster != u32::MAX).then_some(cluster);
        if cluster.is_some_and(|cluster| cluster >= clusters) {
            return Err(BAD);
        }
        leafs.push(OriginLeaf { bounds, cluster });
    }
    let count = input.count(12)?;
    let mut nodes = Vec::with_capacity(count);
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
