//! From voxels to the tree: breadth-first, with averaged looks in inner nodes.

use glam::{UVec3, Vec3};

use super::{DEPTH_MAX, NODES_MAX, Node, Octree, OctreeError};

/// A leaf on its way into an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Voxel {
    /// Where: see [`morton`].
    pub key: u64,
    /// As in [`Node::colour`].
    pub colour: [u8; 3],
    /// As in [`Node::normal`].
    pub normal: [i8; 3],
    /// As in [`Node::flags`].
    pub flags: u8,
}

/// The key of the voxel at these coordinates, of which the lowest 16 bits count: the octants on
/// the way from the root, three bits each.
pub fn morton(voxel: UVec3) -> u64 {
    spread(voxel.x) | spread(voxel.y) << 1 | spread(voxel.z) << 2
}

/// Puts two zeros between the lowest 16 bits.
fn spread(bits: u32) -> u64 {
    let b = u64::from(bits & 0xffff);
    let b = (b | b << 16) & 0xff00_00ff;
    let b = (b | b << 8) & 0x00f0_0f00_f00f;
    let b = (b | b << 4) & 0x0c30_c30c_30c3;
    (b | b << 2) & 0x2492_4924_9249
}

impl Octree {
    /// Makes a tree of voxels of edge `voxel` (in metres) whose keys count from `origin`, all at
    /// `depth`. Of voxels with one key the first is kept.
    ///
    /// # Errors
    ///
    /// When the tree would be too deep, too large, or a key lies outside.
    pub fn from_voxels(
        origin: Vec3,
        voxel: f32,
        depth: u8,
        mut voxels: Vec<Voxel>,
    ) -> Result<Self, OctreeError> {
        if depth > DEPTH_MAX {
            return Err(OctreeError::TooDeep);
        }
        if !voxels.is_sorted_by_key(|v| v.key) {
            voxels.sort_by_key(|v| v.key);
        }
        voxels.dedup_by_key(|v| v.key);
        if voxels.last().is_some_and(|last| last.key >> (3 * u32::from(depth)) != 0) {
            return Err(OctreeError::Outside);
        }
        let edge = voxel * (1u32 << depth) as f32;
        let starts = level_starts(&voxels, depth);
        if starts[usize::from(depth) + 1] > NODES_MAX {
            return Err(OctreeError::TooLarge);
        }
        let mut nodes = place(&voxels, depth, &starts);
        average(&mut nodes, starts[usize::from(depth)]);
        Ok(Self { origin, edge, depth, nodes })
    }
}

/// The index of the first node of each level, and at last the number of nodes.
fn level_starts(voxels: &[Voxel], depth: u8) -> [usize; DEPTH_MAX as usize + 2] {
    let mut counts = [0; DEPTH_MAX as usize + 1];
    let mut previous = None;
    for voxel in voxels {
        for count in &mut counts[first_new_level(previous, voxel.key, depth)..=usize::from(depth)] {
            *count += 1;
        }
        previous = Some(voxel.key);
    }
    let mut starts = [0; DEPTH_MAX as usize + 2];
    for (level, count) in counts.iter().enumerate() {
        starts[level + 1] = starts[level] + count;
    }
    starts
}

/// The least level at which a voxel's ancestors differ from those of the one before it.
fn first_new_level(previous: Option<u64>, key: u64, depth: u8) -> usize {
    let Some(previous) = previous else { return 0 };
    let bits_shared_not = 64 - (previous ^ key).leading_zeros();
    usize::from(depth) + 1 - bits_shared_not.div_ceil(3) as usize
}

fn place(voxels: &[Voxel], depth: u8, starts: &[usize]) -> Vec<Node> {
    let depth = usize::from(depth);
    let mut nodes = vec![Node::default(); starts[depth + 1]];
    let mut next: Vec<usize> = starts[..=depth].to_vec();
    let mut previous = None;
    for voxel in voxels {
        let first_new = first_new_level(previous, voxel.key, depth as u8);
        for level in first_new..=depth {
            let index = next[level];
            next[level] += 1;
            if level > 0 {
                let octant = voxel.key >> (3 * (depth - level)) & 7;
                nodes[next[level - 1] - 1].child_mask |= 1 << octant;
            }
            if level < depth {
                nodes[index].first_child = next[level + 1] as u32;
            } else {
                nodes[index].colour = voxel.colour;
                nodes[index].normal = voxel.normal;
                nodes[index].flags = voxel.flags;
            }
        }
        previous = Some(voxel.key);
    }
    nodes
}

/// Gives inner nodes the looks of what is below them. Children must come after their parents, and
/// from `bottom` on there are only leaves.
pub(super) fn average(nodes: &mut [Node], bottom: usize) {
    let mut weights = vec![1u32; bottom];
    for index in (0..bottom).rev() {
        if nodes[index].is_leaf() {
            continue;
        }
        let first = nodes[index].first_child as usize;
        let children = first..first + nodes[index].child_mask.count_ones() as usize;
        let weight_of = |child: usize| weights.get(child).copied().unwrap_or(1);
        let mut blend = Blend::default();
        let solid = children.clone().any(|child| !nodes[child].is_glass());
        for child in children {
            // Glass that shares a node with something opaque does not change its looks.
            if !(solid && nodes[child].is_glass()) {
                blend.add(&nodes[child], weight_of(child));
            }
        }
        weights[index] = blend.weight;
        let node = &mut nodes[index];
        (node.colour, node.normal) = blend.looks();
        node.flags = if solid { 0 } else { Node::GLASS };
    }
}

/// A weighted mean of looks.
#[derive(Default)]
struct Blend {
    weight: u32,
    colour: [u64; 3],
    normal: [i64; 3],
}

impl Blend {
    fn add(&mut self, node: &Node, weight: u32) {
        self.weight = self.weight.saturating_add(weight);
        for (sum, &channel) in self.colour.iter_mut().zip(&node.colour) {
            *sum += u64::from(weight) * u64::from(channel);
        }
        // The two sides of a thin wall must not cancel out: what is drawn faces the eye anyway.
        let along: i64 =
            self.normal.iter().zip(&node.normal).map(|(&s, &n)| s * i64::from(n)).sum();
        let signed = if along < 0 { -i64::from(weight) } else { i64::from(weight) };
        for (sum, &part) in self.normal.iter_mut().zip(&node.normal) {
            *sum += signed * i64::from(part);
        }
    }

    fn looks(&self) -> ([u8; 3], [i8; 3]) {
        let weight = u64::from(self.weight.max(1));
        let colour = self.colour.map(|sum| ((sum + weight / 2) / weight).min(255) as u8);
        let normal = Vec3::from(self.normal.map(|sum| sum as f32)).normalize_or_zero() * 127.0;
        (colour, normal.to_array().map(|part| part.round() as i8))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_interleave_the_bits() {
        assert_eq!(morton(UVec3::new(1, 0, 0)), 1);
        assert_eq!(morton(UVec3::new(0, 1, 0)), 2);
        assert_eq!(morton(UVec3::new(0, 0, 1)), 4);
        assert_eq!(morton(UVec3::splat(0xffff)), (1 << 48) - 1);
        for bit in 0..16 {
            assert_eq!(morton(UVec3::new(1 << bit, 0, 0)), 1 << (3 * bit));
        }
    }

    #[test]
    fn inner_nodes_average_what_is_opaque() {
        let voxel = |x, colour, flags| Voxel {
            key: morton(UVec3::new(x, 0, 0)),
            colour,
            normal: [127, 0, 0],
            flags,
        };
        let voxels = vec![
            voxel(0, [100, 0, 0], 0),
            voxel(1, [200, 0, 50], 0),
            voxel(2, [0, 90, 0], 0),
            voxel(3, [0, 0, 255], Node::GLASS),
            voxel(5, [9, 9, 9], Node::GLASS),
        ];
        let octree = Octree::from_voxels(Vec3::ZERO, 1.0, 3, voxels).expect("small");
        let root = octree.nodes[0];
        assert_eq!((root.colour, root.flags), ([100, 30, 17], 0));
        let right = octree.nodes[root.child(1).expect("there") as usize];
        assert_eq!((right.colour, right.flags), ([9, 9, 9], Node::GLASS));
    }

    #[test]
    fn opposite_normals_do_not_cancel() {
        let sides = [127i8, -127].map(|x| Node { normal: [x, 0, 0], ..Node::default() });
        let mut blend = Blend::default();
        sides.iter().for_each(|side| blend.add(side, 1));
        assert_eq!(blend.looks().1, [127, 0, 0]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let voxels = vec![Voxel { key: 8, ..Voxel::default() }];
        let check = |depth, voxels| Octree::from_voxels(Vec3::ZERO, 1.0, depth, voxels);
        assert_eq!(check(1, voxels), Err(OctreeError::Outside));
        assert_eq!(check(17, Vec::new()), Err(OctreeError::TooDeep));
    }
}
