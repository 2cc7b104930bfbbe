//! The octree as bytes: the shape first, then a plane for each property of the leaves.
//!
//! ```text
//! origin 3 × f32 · edge f32 · depth u8 · nodes u32 · leaves u32          (little-endian)
//! child masks, breadth-first, of every node above the greatest depth (zero: a leaf)
//! red, green, blue, normal x, y, z, flags: a byte for each leaf, in the nodes' order
//! ```
//!
//! Inner nodes get their looks back from the leaves. Indices are not stored, so that no bytes can
//! make a cycle; like bytes lie together, so that the file's compression does well.

use glam::Vec3;
use thiserror::Error;

use super::{DEPTH_MAX, NODES_MAX, Node, Octree, build::average};

/// Why there is no octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OctreeError {
    /// More levels than [`DEPTH_MAX`].
    #[error("an octree is deeper than {DEPTH_MAX} levels")]
    TooDeep,
    /// More nodes than [`NODES_MAX`].
    #[error("an octree has more than {NODES_MAX} nodes")]
    TooLarge,
    /// A voxel's key does not belong to the tree.
    #[error("a voxel lies outside its octree")]
    Outside,
    /// The bytes stop early, or go on after the end.
    #[error("an octree has too few or too many bytes")]
    Length,
    /// A number has no meaning.
    #[error("an octree's {0} makes no sense")]
    Nonsense(&'static str),
}

/// Bytes for each leaf.
const PLANES: usize = 7;

/// No coordinate or edge is greater, in metres.
const EXTENT_MAX: f32 = 1.0e6;

impl Octree {
    /// Writes the tree. Nodes that no walk from the root reaches are left out.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (masks, leaves) = self.breadth_first();
        let bottom = masks.iter().filter(|&&mask| mask == 0).count();
        let nodes = masks.len() + (leaves.len() - bottom);
        let mut bytes = Vec::with_capacity(25 + masks.len() + PLANES * leaves.len());
        for number in self.origin.to_array().into_iter().chain([self.edge]) {
            bytes.extend(number.to_le_bytes());
        }
        bytes.push(self.depth);
        bytes.extend((nodes as u32).to_le_bytes());
        bytes.extend((leaves.len() as u32).to_le_bytes());
        bytes.extend(masks);
        for plane in 0..PLANES {
            bytes.extend(leaves.iter().map(|&leaf| plane_of(&self.nodes[leaf as usize], plane)));
        }
        bytes
    }

    /// The child masks of all nodes above the greatest depth, and all leaves, breadth-first.
    fn breadth_first(&self) -> (Vec<u8>, Vec<u32>) {
        let mut masks = Vec::new();
        let mut leaves = Vec::new();
        let mut level: Vec<u32> = self.nodes.first().map(|_| 0).into_iter().collect();
        for _ in 0..self.depth {
            let mut below = Vec::new();
            for &index in &level {
                let node = &self.nodes[index as usize];
                masks.push(node.child_mask);
                if node.is_leaf() {
                    leaves.push(index);
                }
                below.extend((0..node.child_mask.count_ones()).map(|i| node.first_child + i));
            }
            level = below;
        }
        leaves.extend(level);
        (masks, leaves)
    }

    /// Reads what [`Octree::to_bytes`] wrote: any bytes give a sound tree or an error. At most nine
    /// times the bytes are held, and never more than [`NODES_MAX`] nodes.
    ///
    /// # Errors
    ///
    /// When the bytes are not exactly one octree.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, OctreeError> {
        let mut rest = bytes;
        let mut float = || take(&mut rest).map(f32::from_le_bytes);
        let origin = Vec3::new(float()?, float()?, float()?);
        let edge = float()?;
        let [depth] = take(&mut rest)?;
        let nodes = u32::from_le_bytes(take(&mut rest)?) as usize;
        let leaves = u32::from_le_bytes(take(&mut rest)?) as usize;
        if !(origin.is_finite() && origin.abs().max_element() <= EXTENT_MAX) {
            return Err(OctreeError::Nonsense("origin"));
        }
        if !(edge > 0.0 && edge <= EXTENT_MAX && edge.is_normal()) {
            return Err(OctreeError::Nonsense("edge"));
        }
        if depth > DEPTH_MAX {
            return Err(OctreeError::TooDeep);
        }
        if nodes > NODES_MAX {
            return Err(OctreeError::TooLarge);
        }
        let shape = Shape::measure(rest, depth, nodes)?;
        let (masks, planes) = rest.split_at_checked(shape.masks).ok_or(OctreeError::Length)?;
        if shape.leaves != leaves || planes.len() != leaves * PLANES {
            return Err(OctreeError::Length);
        }
        let mut nodes = plant(masks, nodes);
        paint(&mut nodes, planes, leaves)?;
        average(&mut nodes, shape.masks);
        Ok(Self { origin, edge, depth, nodes })
    }
}

fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], OctreeError> {
    let (head, tail) = rest.split_first_chunk::<N>().ok_or(OctreeError::Length)?;
    *rest = tail;
    Ok(*head)
}

fn plane_of(leaf: &Node, plane: usize) -> u8 {
    match plane {
        0..3 => leaf.colour[plane],
        3..6 => leaf.normal[plane - 3] as u8,
        _ => leaf.flags,
    }
}

/// How many masks come, and how many leaves they lead to.
struct Shape {
    masks: usize,
    leaves: usize,
}

impl Shape {
    /// Walks the masks without making anything, so that counts are known before memory is taken.
    fn measure(bytes: &[u8], depth: u8, nodes: usize) -> Result<Self, OctreeError> {
        let mut shape = Self { masks: 0, leaves: 0 };
        let mut level = usize::from(nodes > 0);
        let mut total = level;
        for _ in 0..depth {
            let end = shape.masks + level;
            let masks = bytes.get(shape.masks..end).ok_or(OctreeError::Length)?;
            shape.masks = end;
            shape.leaves += masks.iter().filter(|&&mask| mask == 0).count();
            level = masks.iter().map(|mask| mask.count_ones() as usize).sum();
            total += level;
            if total > nodes {
                return Err(OctreeError::Length);
            }
        }
        shape.leaves += level;
        if total == nodes { Ok(shape) } else { Err(OctreeError::Length) }
    }
}

/// Makes the nodes, still without looks.
fn plant(masks: &[u8], count: usize) -> Vec<Node> {
    let mut nodes = vec![Node::default(); count];
    let mut next = 1;
    for (node, &mask) in nodes.iter_mut().zip(masks) {
        node.child_mask = mask;
        if mask != 0 {
            node.first_child = next;
            next += mask.count_ones();
        }
    }
    nodes
}

fn paint(nodes: &mut [Node], planes: &[u8], leaves: usize) -> Result<(), OctreeError> {
    let plane = |plane: usize| &planes[plane * leaves..(plane + 1) * leaves];
    let planes: [&[u8]; PLANES] = std::array::from_fn(plane);
    if planes[6].iter().any(|flags| flags & !Node::GLASS != 0) {
        return Err(OctreeError::Nonsense("flags"));
    }
    for (i, leaf) in nodes.iter_mut().filter(|node| node.is_leaf()).enumerate() {
        leaf.colour = [planes[0][i], planes[1][i], planes[2][i]];
        leaf.normal = [planes[3][i] as i8, planes[4][i] as i8, planes[5][i] as i8];
        leaf.flags = planes[6][i];
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::octree::{Voxel, morton};

    fn octree() -> impl Strategy<Value = Octree> {
        let voxel = (prop::array::uniform3(0u32..32), any::<[u8; 3]>(), any::<[i8; 3]>(), 0u8..2)
            .prop_map(|(at, colour, normal, flags)| Voxel {
                key: morton(UVec3::from(at)),
                colour,
                normal,
                flags,
            });
        prop::collection::vec(voxel, 0..100).prop_map(|voxels| {
            Octree::from_voxels(Vec3::new(1.0, -2.0, 3.0), 0.125, 5, voxels).expect("small")
        })
    }

    /// No node has an index out of range, or is its own ancestor.
    fn is_sound(octree: &Octree) -> bool {
        octree.nodes.iter().enumerate().all(|(index, node)| {
            let children = u64::from(node.first_child) + u64::from(node.child_mask.count_ones());
            node.is_leaf()
                || node.first_child as usize > index && children <= octree.nodes.len() as u64
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(octree in octree()) {
            prop_assert_eq!(Octree::from_bytes(&octree.to_bytes()), Ok(octree));
        }

        #[test]
        fn any_damage_gives_a_sound_tree_or_an_error(
            octree in octree(),
            at in any::<prop::sample::Index>(),
            flip in 1u8..,
            cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = octree.to_bytes();
            prop_assert!(Octree::from_bytes(&bytes[..cut.index(bytes.len())]).is_err());
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            if let Ok(other) = Octree::from_bytes(&bytes) {
                prop_assert!(is_sound(&other));
                prop_assert_eq!(other.to_bytes(), bytes);
            }
        }

        #[test]
        fn noise_is_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            if let Ok(octree) = Octree::from_bytes(&bytes) {
                prop_assert!(is_sound(&octree));
            }
        }
    }

    #[test]
    fn a_leaf_may_lie_above_the_greatest_depth() {
        let leaf = Node { colour: [1, 2, 3], ..Node::default() };
        let root = Node { first_child: 1, child_mask: 0b10, colour: [1, 2, 3], ..leaf };
        let octree = Octree { origin: Vec3::ZERO, edge: 8.0, depth: 3, nodes: vec![root, leaf] };
        assert_eq!(Octree::from_bytes(&octree.to_bytes()), Ok(octree));
    }

    #[test]
    fn a_count_is_checked_before_memory_is_taken() {
        let mut bytes = octree_bytes_of_nothing();
        bytes[17..21].copy_from_slice(&(NODES_MAX as u32).to_le_bytes());
        bytes[21..25].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::Length));
        bytes[17..21].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(Octree::from_bytes(&bytes), Err(OctreeError::TooLarge));
    }

    fn octree_bytes_of_nothing() -> Vec<u8> {
        Octree { origin: Vec3::ZERO, edge: 1.0, depth: 5, nodes: Vec::new() }.to_bytes()
    }
}
