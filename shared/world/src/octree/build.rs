//! Builds a tree from voxels: first blocks, which threads can build independently, then the whole.

use std::ops::Range;

use glam::{UVec3, Vec3};

use super::{
    BLOCK_LEVELS, DEPTH_MAX, INNER_MAX, LEAVES_MAX, Material, Octree, OctreeError,
    blend::average,
    census::Census,
    layout::{TreeLayout, levels},
    palette::Palette,
};

/// A voxel to build an octree from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Voxel {
    /// The place: see [`morton`].
    pub key: u64,
    /// The sRGB colour, as in [`Material::colour`].
    pub colour: [u8; 3],
    /// The outward normal, as in [`Material::normal`].
    pub normal: [i8; 3],
    /// The flags, as in [`Material::flags`].
    pub flags: u8,
}

impl Voxel {
    /// The material.
    pub fn material(&self) -> Material {
        Material { colour: self.colour, normal: self.normal, flags: self.flags & Material::GLASS }
    }
}

/// The Morton key of the voxel at these coordinates: the octants on the way from the root, three
/// bits each. Only the lowest 16 bits of each coordinate count.
pub fn morton(voxel: UVec3) -> u64 {
    spread(voxel.x) | spread(voxel.y) << 1 | spread(voxel.z) << 2
}

/// Inserts two zeros between neighbouring bits of the lowest 16.
fn spread(bits: u32) -> u64 {
    let b = u64::from(bits & 0xffff);
    let b = (b | b << 16) & 0xff00_00ff;
    let b = (b | b << 8) & 0x00f0_0f00_f00f;
    let b = (b | b << 4) & 0x0c30_c30c_30c3;
    (b | b << 2) & 0x2492_4924_9249
}

/// The voxels of a cube of 2^[`BLOCK_LEVELS`] voxels each way, or of a whole shallower tree. It
/// takes about nine bytes for each voxel.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelBlock {
    key: u64,
    /// The child masks, breadth-first, the root's first.
    masks: Vec<u8>,
    materials: Vec<Material>,
}

impl VoxelBlock {
    /// Builds a block from voxels of its cube, in ascending order of their keys. `None` without
    /// voxels.
    ///
    /// # Errors
    ///
    /// When the keys do not ascend, or are not all in one block.
    pub fn new(depth: u8, voxels: &[Voxel]) -> Result<Option<Self>, OctreeError> {
        let Some(first) = voxels.first() else { return Ok(None) };
        let below = levels(depth).1;
        let key = first.key >> (3 * below);
        let is_inside = |voxel: &Voxel| voxel.key >> (3 * below) == key;
        if !(voxels.is_sorted_by(|a, b| a.key < b.key) && voxels.iter().all(is_inside)) {
            return Err(OctreeError::Outside);
        }
        let keys = voxels.iter().map(|voxel| voxel.key).collect();
        let materials = voxels.iter().map(Voxel::material).collect();
        Ok(Some(Self { key, masks: masks_above(keys, below), materials }))
    }

    /// The number of voxels.
    pub fn voxels(&self) -> usize {
        self.materials.len()
    }
}

/// The child masks of the nearest `levels` levels above some nodes, breadth-first from the top. The
/// nodes are given by ascending keys.
fn masks_above(mut keys: Vec<u64>, levels: u8) -> Vec<u8> {
    let mut all = Vec::with_capacity(levels.into());
    for _ in 0..levels {
        let mut masks: Vec<u8> = Vec::with_capacity(keys.len() / 2);
        let mut parents: Vec<u64> = Vec::with_capacity(keys.len() / 2);
        for key in keys {
            if parents.last() != Some(&(key >> 3)) {
                parents.push(key >> 3);
                masks.push(0);
            }
            if let Some(mask) = masks.last_mut() {
                *mask |= 1 << (key & 7);
            }
        }
        all.push(masks);
        keys = parents;
    }
    all.into_iter().rev().flatten().collect()
}

impl Octree {
    /// Builds a tree from voxels at one depth. `voxel` is their edge in metres; their keys count
    /// from `origin`. Of several voxels with one key the first is kept.
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
        if !(1..=DEPTH_MAX).contains(&depth) {
            return Err(OctreeError::Depth);
        }
        if !voxels.is_sorted_by_key(|v| v.key) {
            voxels.sort_by_key(|v| v.key);
        }
        voxels.dedup_by_key(|v| v.key);
        let below = 3 * depth.min(BLOCK_LEVELS);
        let of_a_block = |a: &Voxel, b: &Voxel| a.key >> below == b.key >> below;
        let blocks =
            voxels.chunk_by(of_a_block).filter_map(|part| VoxelBlock::new(depth, part).transpose());
        let blocks = blocks.collect::<Result<_, _>>()?;
        Self::from_blocks(origin, voxel, depth, blocks)
    }

    /// Builds a tree from blocks, in ascending order of their voxels' keys. `voxel` is the edge of
    /// a voxel in metres.
    ///
    /// # Errors
    ///
    /// When the tree would be too deep, too large, or a block lies outside or is out of order.
    pub fn from_blocks(
        origin: Vec3,
        voxel: f32,
        depth: u8,
        mut blocks: Vec<VoxelBlock>,
    ) -> Result<Self, OctreeError> {
        if !(1..=DEPTH_MAX).contains(&depth) {
            return Err(OctreeError::Depth);
        }
        let (above, below) = levels(depth);
        let is_outside = blocks.last().is_some_and(|last| last.key >> (3 * u32::from(above)) != 0);
        if is_outside || !blocks.is_sorted_by(|a, b| a.key < b.key) {
            return Err(OctreeError::Outside);
        }
        let masks = masks_of(&mut blocks, above);
        let leaves = blocks.iter().map(VoxelBlock::voxels).sum::<usize>();
        if masks.len() > INNER_MAX || leaves > LEAVES_MAX {
            return Err(OctreeError::TooLarge);
        }
        let layout = TreeLayout::link(&masks, depth)?;
        drop(masks);
        if layout.leaves != leaves || below == 0 {
            return Err(OctreeError::Outside);
        }
        let edge = voxel * (1u32 << depth) as f32;
        let mut octree = Self::empty(origin, edge, depth);
        octree.inner = layout.inner;
        let mut census = Census::default();
        blocks.iter().for_each(|block| census.count(&block.materials, leaves));
        let mut palettes = census.palettes();
        let painted =
            palettes.any(|palette| octree.paint(palette, &layout.roots, &blocks).is_some());
        if painted { Ok(octree) } else { Err(OctreeError::Nonsense("palette")) }
    }

    /// Fills in all materials. `None` when the palette has no room for them.
    fn paint(
        &mut self,
        mut palette: Palette,
        roots: &Range<usize>,
        blocks: &[VoxelBlock],
    ) -> Option<()> {
        self.leaves.clear();
        self.leaves.reserve_exact(blocks.iter().map(VoxelBlock::voxels).sum());
        for material in blocks.iter().flat_map(|block| &block.materials) {
            self.leaves.push(palette.index(material)?);
        }
        average(&mut self.inner, roots, &self.leaves, self.depth, &mut palette)?;
        let places = palette.sort();
        let inner = self.inner.iter_mut().map(|node| &mut node.material);
        inner
            .chain(&mut self.leaves)
            .for_each(|material| *material = places[usize::from(*material)]);
        (self.keys, self.materials) = (palette.keys, palette.materials);
        debug_assert_eq!(self.materials.len(), self.keys.len(), "a key for each material");
        Some(())
    }
}

/// All child masks in the order of nodes in memory. Those of the blocks are moved out of these.
fn masks_of(blocks: &mut [VoxelBlock], above: u8) -> Vec<u8> {
    let mut masks = masks_above(blocks.iter().map(|block| block.key).collect(), above);
    masks.extend(blocks.iter().filter_map(|block| block.masks.first()));
    for block in blocks {
        masks.extend(block.masks.drain(..).skip(1));
    }
    masks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::{InnerNode, MATERIALS_MAX};

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
    fn inner_nodes_average_their_opaque_leaves() {
        let voxel = |x, colour, flags| Voxel {
            key: morton(UVec3::new(x, 0, 0)),
            colour,
            normal: [127, 0, 0],
            flags,
        };
        for levels in [2, 3, 6, 7, 9] {
            // Two groups of voxels, in one block or in two.
            let far = 1 << levels;
            let voxels = vec![
                voxel(0, [100, 0, 0], 0),
                voxel(1, [200, 0, 50], 0),
                voxel(2, [0, 90, 0], 0),
                voxel(3, [0, 0, 255], Material::GLASS),
                voxel(far + 1, [9, 9, 9], Material::GLASS),
            ];
            let octree = Octree::from_voxels(Vec3::ZERO, 1.0, levels + 1, voxels).expect("small");
            let root = octree.root().expect("filled");
            assert_eq!((root.material().colour, root.is_glass()), ([129, 52, 29], false));
            assert_eq!(root.inner().map(|inner| inner.flags), Some(InnerNode::SOME_GLASS));
            let right = root.child(1).expect("there");
            assert_eq!((right.material().colour, right.is_glass()), ([9, 9, 9], true));
            assert_eq!(
                right.inner().map(|inner| inner.flags),
                Some(InnerNode::GLASS | InnerNode::SOME_GLASS)
            );
        }
    }

    #[test]
    fn any_number_of_materials_fits() {
        let voxels = (0..300_000u32).map(|i| {
            let [x, r, g, b] = i.wrapping_mul(2_654_435_761).to_be_bytes();
            let normal = [x as i8, r as i8, i as i8];
            Voxel { key: u64::from(i), colour: [r, g, b], normal, flags: x & Material::GLASS }
        });
        let octree = Octree::from_voxels(Vec3::ZERO, 1.0, 7, voxels.collect()).expect("fits");
        assert!((1_000..=MATERIALS_MAX).contains(&octree.materials.len()));
        let glass = octree.first_glass();
        assert!(octree.materials[..glass].iter().all(|material| !material.is_glass()));
        // The reader finds the same entries for inner nodes.
        assert!(Octree::from_bytes(&octree.to_bytes()) == Ok(octree));
    }

    #[test]
    fn voxels_and_blocks_outside_of_the_tree_are_refused() {
        let voxels = vec![Voxel { key: 8, ..Voxel::default() }];
        let check = |depth, voxels| Octree::from_voxels(Vec3::ZERO, 1.0, depth, voxels);
        assert_eq!(check(1, voxels), Err(OctreeError::Outside));
        assert_eq!(check(17, Vec::new()), Err(OctreeError::Depth));
        assert_eq!(check(0, Vec::new()), Err(OctreeError::Depth));
        let block = |key| {
            let voxel = Voxel { key, ..Voxel::default() };
            VoxelBlock::new(7, &[voxel]).expect("one block").expect("not empty")
        };
        let check = |blocks| Octree::from_blocks(Vec3::ZERO, 1.0, 7, blocks).map(|_| ());
        assert_eq!(check(vec![block(1 << 18), block(0)]), Err(OctreeError::Outside));
        assert_eq!(check(vec![block(0), block(1)]), Err(OctreeError::Outside));
        assert_eq!(check(vec![block(0), block(8 << 18)]), Err(OctreeError::Outside));
        assert_eq!(check(vec![block(0), block(7 << 18)]), Ok(()));
    }
}
