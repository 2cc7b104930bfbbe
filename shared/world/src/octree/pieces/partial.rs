//! An octree of which only some pieces are here.

use rustc_hash::FxHashMap;

use glam::Vec3;

use super::{
    super::{
        INNER_MAX, InnerNode, LEAVES_MAX, MATERIALS_MAX, Octree, OctreeError,
        codec::{PackedPlane, read_head, read_palette, take},
        flat, octant_corner,
        palette::Palette,
    },
    GRADES, HEIGHTS, UNPACKED_MAX, grade_levels,
    level::{Level, MaterialCodes},
};
use crate::geometry::Aabb;

/// The most branches: those of the largest tree are fewer.
const BRANCHES_MAX: usize = 1 << 20;

/// The levels of a trunk take no more bytes: five and a mask for each node, of which there are at
/// most a third more than branches on average.
const TRUNK_BYTES_MAX: usize = 8 * BRANCHES_MAX;

/// An octree that grows by pieces.
///
/// What is not here yet has **stand-ins**: below the last node that is known, all space is filled
/// with voxels of its mean material. So it can be drawn and walked like any other tree at any time.
/// It never shows what is behind something that has not arrived, and bodies do not get into it.
/// Stand-ins of one material share their nodes, so an index is not one place in the tree.
#[derive(Clone, Debug)]
pub struct PartialOctree {
    octree: Octree,
    codes: MaterialCodes,
    /// The number of levels of a branch.
    height: u8,
    branches: Vec<Branch>,
    /// The branches by their place, counted in cubes of their size from the octree's corner.
    places: FxHashMap<[i32; 3], u32>,
    /// The first of eight equal nodes that fill all space below a node, by the node's material and
    /// its height above the leaves.
    stand_ins: FxHashMap<(u16, u8), u32>,
}

/// The state of a branch.
#[derive(Clone, Debug)]
struct Branch {
    root: u32,
    bounds: Aabb,
    /// How many grades are here.
    grades: u8,
    /// What the nodes of these take, in bytes.
    bytes: usize,
}

impl PartialOctree {
    /// A tree of which the trunk alone is here. Any bytes give a valid tree or an error.
    ///
    /// # Errors
    /// When the bytes are not exactly one trunk.
    pub fn new(trunk: &[u8]) -> Result<Self, OctreeError> {
        let mut rest = trunk;
        let mut octree = read_head(&mut rest)?;
        let [height] = take(&mut rest)?;
        let least = (*HEIGHTS.start()).min(octree.depth);
        if !(least..=*HEIGHTS.end()).contains(&height) || height > octree.depth {
            return Err(OctreeError::Nonsense("height"));
        }
        let mut count = |max: usize| {
            let count = u32::from_le_bytes(take(&mut rest)?) as usize;
            if count <= max { Ok(count) } else { Err(OctreeError::TooLarge) }
        };
        let (materials, branches) = (count(MATERIALS_MAX)?, count(BRANCHES_MAX)?);
        let keys = read_palette(&mut PackedPlane::take(&mut rest)?, materials)?;
        let palette = Palette::closed(keys);
        (octree.keys, octree.materials) = (palette.keys, palette.materials);
        let codes = MaterialCodes::of(&octree);
        let (stand_ins, places) = (FxHashMap::default(), FxHashMap::default());
        let mut partial = Self { octree, codes, height, branches: Vec::new(), places, stand_ins };
        let levels = PackedPlane::take(&mut rest)?.up_to(TRUNK_BYTES_MAX)?;
        if !rest.is_empty() {
            return Err(OctreeError::Length);
        }
        partial.read_trunk(&levels)?;
        if partial.branches.len() == branches { Ok(partial) } else { Err(OctreeError::Length) }
    }

    /// The tree as far as it is here.
    pub fn octree(&self) -> &Octree {
        &self.octree
    }

    /// Takes the tree out, and leaves one without voxels.
    pub fn take_octree(&mut self) -> Octree {
        self.emptied().octree
    }

    /// Leaves a tree without voxels in the place of this one.
    fn emptied(&mut self) -> Self {
        let Octree { origin, edge, depth, .. } = self.octree;
        let empty = Self {
            octree: Octree::empty(origin, edge, depth),
            codes: self.codes.clone(),
            height: self.height,
            branches: Vec::new(),
            places: FxHashMap::default(),
            stand_ins: FxHashMap::default(),
        };
        std::mem::replace(self, empty)
    }

    /// The number of branches.
    pub fn branches(&self) -> usize {
        self.branches.len()
    }

    /// The number of grades that each branch has.
    pub fn grades(&self) -> u8 {
        self.height.min(GRADES)
    }

    /// How many grades of a branch are here; zero for one that there is not.
    pub fn grades_of(&self, branch: usize) -> u8 {
        self.branches.get(branch).map_or(0, |branch| branch.grades)
    }

    /// The cube that a branch covers, if there is such a branch.
    pub fn bounds_of(&self, branch: usize) -> Option<Aabb> {
        self.branches.get(branch).map(|branch| branch.bounds)
    }

    /// The branches whose cubes meet a box.
    pub fn branches_in(&self, region: Aabb) -> impl Iterator<Item = usize> {
        let meets = move |(_, branch): &(usize, &Branch)| branch.bounds.intersects(&region);
        self.branches.iter().enumerate().filter(meets).map(|(index, _)| index)
    }

    /// The branch whose cube a point is in, if there is one.
    pub fn branch_at(&self, point: Vec3) -> Option<usize> {
        self.branch_of(self.place_of(point))
    }

    /// The branch at a place, if there is one.
    pub fn branch_of(&self, place: [i32; 3]) -> Option<usize> {
        self.places.get(&place).map(|&branch| branch as usize)
    }

    /// The place of a point, counted in cubes of the size of branches from the octree's corner.
    pub fn place_of(&self, point: Vec3) -> [i32; 3] {
        ((point - self.octree.origin) / self.edge_after(0)).floor().as_ivec3().to_array()
    }

    /// The edge of the smallest nodes of a branch whose first grades are here, in metres.
    pub fn edge_after(&self, grades: u8) -> f32 {
        let level = match grades {
            0 => 0,
            _ => *grade_levels(self.height, grades - 1 + GRADES - self.grades()).end(),
        };
        self.octree.voxel() * (1u32 << (self.height - level.min(self.height))) as f32
    }

    /// Whether every piece is here.
    pub fn is_complete(&self) -> bool {
        self.branches.iter().all(|branch| branch.grades == self.grades())
    }

    /// Whether all voxels in a box are here. What is outside of the tree has none.
    pub fn is_complete_in(&self, region: &Aabb) -> bool {
        self.branches_in(*region).all(|branch| self.grades_of(branch) == self.grades())
    }

    /// Takes in the next grade of a branch. When it fails, nothing has changed.
    ///
    /// # Errors
    /// When there is no such branch, it is complete, or the bytes are not its next grade.
    pub fn grow(&mut self, branch: usize, piece: &[u8]) -> Result<(), OctreeError> {
        let grades = self.grades();
        let Some(state) = self.branches.get(branch).filter(|branch| branch.grades < grades) else {
            return Err(OctreeError::Outside);
        };
        let (root, grade) = (state.root, state.grades + GRADES - grades);
        let levels = grade_levels(self.height, grade);
        let mut above = vec![root];
        for _ in 1..*levels.start() {
            above = self.octree.children_of(&above);
        }
        let read = self.read_levels(piece, &above, levels.clone().count())?;
        self.check_room(&read, *levels.end())?;
        self.put(branch, above, *levels.start(), &read);
        if let Some(state) = self.branches.get_mut(branch) {
            state.grades += 1;
        }
        Ok(())
    }

    /// Puts levels of a branch below some nodes, the first of which is the level `first`.
    fn put(&mut self, branch: usize, mut above: Vec<u32>, first: u8, levels: &[Level]) {
        let before = self.bytes();
        let last = first + levels.len() as u8 - 1;
        for (level, read) in (first..).zip(levels) {
            above = self.attach(&above, read, self.height - level, level == last);
        }
        self.mark_branch(self.branches[branch].root, last);
        self.branches[branch].bytes += self.bytes() - before;
    }

    /// What all nodes take, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.octree.inner.as_slice()) + size_of_val(self.octree.leaves.as_slice())
    }

    /// What the nodes of a branch take that are here, in bytes.
    pub fn bytes_of(&self, branch: usize) -> usize {
        self.branches.get(branch).map_or(0, |branch| branch.bytes)
    }

    /// Lets go of all branches but those that `keeps` names: none of their grades is here
    /// afterwards. It copies what it keeps.
    pub fn keep(&mut self, keeps: impl Fn(usize) -> bool) {
        let Some(root) = self.octree.inner.first().copied() else { return };
        let mut old = self.emptied();
        let trunk = old.levels(vec![0], old.octree.depth, old.octree.depth - old.height);
        self.octree.materials = std::mem::take(&mut old.octree.materials);
        self.octree.keys = std::mem::take(&mut old.octree.keys);
        self.link_trunk(root.material, &trunk);
        for (branch, state) in old.branches.iter().enumerate() {
            if state.grades == 0 || !keeps(branch) {
                continue;
            }
            let last = *grade_levels(old.height, state.grades - 1 + GRADES - old.grades()).end();
            let levels = old.levels(vec![state.root], old.height, last);
            self.put(branch, vec![self.branches[branch].root], 1, &levels);
            self.branches[branch].grades = state.grades;
        }
    }

    /// This number of levels below some nodes, which are `height` levels above the leaves.
    fn levels(&self, mut above: Vec<u32>, height: u8, count: u8) -> Vec<Level> {
        let node = |index: &u32| &self.octree.inner[*index as usize];
        let mut levels = Vec::new();
        for level in 1..=count {
            let children = self.octree.children_of(&above);
            let masks = above.iter().map(|index| node(index).mask).collect();
            let materials = match level == height {
                true => children.iter().map(|&leaf| self.octree.leaves[leaf as usize]).collect(),
                false => children.iter().map(|index| node(index).material).collect(),
            };
            levels.push(Level { masks, materials });
            above = children;
        }
        levels
    }

    /// Reads the levels of a grade below some nodes.
    fn read_levels(
        &self,
        piece: &[u8],
        above: &[u32],
        levels: usize,
    ) -> Result<Vec<Level>, OctreeError> {
        let bytes = PackedPlane::of(piece)?.up_to(UNPACKED_MAX)?;
        let (mut rest, mut read): (_, Vec<Level>) = (bytes.as_slice(), Vec::new());
        let top: Vec<u16> =
            above.iter().map(|&index| self.octree.inner[index as usize].material).collect();
        for _ in 0..levels {
            let above = read.last().map_or(top.as_slice(), |level| level.materials.as_slice());
            read.push(Level::take(&mut rest, above, &self.codes)?);
        }
        if rest.is_empty() { Ok(read) } else { Err(OctreeError::Length) }
    }

    /// Checks that the nodes of a grade fit in, with as many stand-ins as they may need.
    fn check_room(&self, read: &[Level], last: u8) -> Result<(), OctreeError> {
        let nodes: usize = read.iter().map(|level| level.materials.len()).sum();
        let spare = 8 * usize::from(self.height - last.min(self.height));
        let lowest = read.last().map_or(0, |level| level.materials.len());
        let wanted = nodes + spare * lowest;
        let fits = self.octree.inner.len() + wanted <= INNER_MAX
            && self.octree.leaves.len() + wanted <= LEAVES_MAX;
        if fits { Ok(()) } else { Err(OctreeError::TooLarge) }
    }

    fn read_trunk(&mut self, bytes: &[u8]) -> Result<(), OctreeError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let mut rest = bytes;
        let top = Level::take(&mut rest, &[0], &self.codes)?;
        let &[material] = top.materials.as_slice() else {
            return Err(OctreeError::Nonsense("mask"));
        };
        let (mut materials, mut levels) = (top.materials.clone(), Vec::new());
        for _ in self.height..self.octree.depth {
            let level = Level::take(&mut rest, &materials, &self.codes)?;
            if level.materials.len() > BRANCHES_MAX {
                return Err(OctreeError::TooLarge);
            }
            materials.clone_from(&level.materials);
            levels.push(level);
        }
        if !rest.is_empty() {
            return Err(OctreeError::Length);
        }
        self.link_trunk(material, &levels);
        Ok(())
    }

    /// Makes the nodes of the trunk, and finds the branches.
    fn link_trunk(&mut self, material: u16, levels: &[Level]) {
        let depth = self.octree.depth;
        let root = InnerNode { material, mask: !0, flags: self.glass(material), first: 0 };
        self.octree.inner.push(root);
        if levels.is_empty() {
            self.octree.inner[0].first = self.stand_in(material, depth);
        }
        let (mut above, mut corners) = (vec![0], vec![self.octree.origin]);
        let mut edge = self.octree.edge;
        for (level, read) in (1..).zip(levels) {
            edge *= 0.5;
            let octants = |(corner, mask): (&Vec3, &u8)| {
                let (corner, mask) = (*corner, *mask);
                let octants = (0..8).filter(move |octant| mask >> octant & 1 == 1);
                octants.map(move |octant| corner + octant_corner(octant) * edge)
            };
            corners = corners.iter().zip(&read.masks).flat_map(octants).collect();
            above = self.attach(&above, read, depth - level, level == depth - self.height);
        }
        let branch = |(root, corner)| Branch {
            root,
            bounds: Aabb::new(corner, corner + edge),
            grades: 0,
            bytes: 0,
        };
        self.branches = above.into_iter().zip(corners).map(branch).collect();
        let centres = self.branches.iter().map(|branch| branch.bounds.centre());
        self.places = (0..).zip(centres).map(|(i, centre)| (self.place_of(centre), i)).collect();
        self.mark_trunk();
    }

    /// Gives nodes their children, `height` levels above the leaves, and returns them unless they
    /// are leaves. The lowest ones that are known get stand-ins.
    fn attach(&mut self, above: &[u32], level: &Level, height: u8, lowest: bool) -> Vec<u32> {
        let is_leaves = height == 0;
        let start =
            if is_leaves { self.octree.leaves.len() } else { self.octree.inner.len() } as u32;
        let mut next = start;
        for (&index, &mask) in above.iter().zip(&level.masks) {
            let node = &mut self.octree.inner[index as usize];
            (node.mask, node.first) = (mask, next);
            next += mask.count_ones();
        }
        if is_leaves {
            self.octree.leaves.extend_from_slice(&level.materials);
            return Vec::new();
        }
        for &material in &level.materials {
            let flags = self.glass(material);
            self.octree.inner.push(InnerNode { material, flags, mask: !0, first: 0 });
        }
        if lowest {
            for (index, &material) in (start as usize..).zip(&level.materials) {
                self.octree.inner[index].first = self.stand_in(material, height);
            }
        }
        (start..next).collect()
    }

    /// The first of the eight children of a node, `height` levels above the leaves, that fill it
    /// with one material.
    fn stand_in(&mut self, material: u16, height: u8) -> u32 {
        if let Some(&first) = self.stand_ins.get(&(material, height)) {
            return first;
        }
        let first = if height <= 1 {
            self.octree.leaves.extend([material; 8]);
            self.octree.leaves.len() - 8
        } else {
            let first = self.stand_in(material, height - 1);
            let node = InnerNode { first, material, mask: !0, flags: self.glass(material) };
            self.octree.inner.extend([node; 8]);
            self.octree.inner.len() - 8
        } as u32;
        self.stand_ins.insert((material, height), first);
        first
    }

    /// The flags of a node all of whose leaves have one material.
    fn glass(&self, material: u16) -> u8 {
        let is_glass =
            self.octree.materials.get(usize::from(material)).is_some_and(|m| m.is_glass());
        if is_glass { InnerNode::GLASS | InnerNode::SOME_GLASS } else { 0 }
    }

    /// Sets the flags of a branch whose nodes are known down to a level.
    fn mark_branch(&mut self, root: u32, known: u8) {
        let mut levels = vec![vec![root]];
        for _ in 1..self.height.min(known + 1) {
            let above = levels.last().map_or([].as_slice(), Vec::as_slice);
            levels.push(self.octree.children_of(above));
        }
        let before = self.octree.inner[root as usize].flags;
        for (level, nodes) in levels.iter().enumerate().rev() {
            let height = u32::from(self.height) - level as u32;
            for &index in nodes {
                let mut flags = self.flags(index, height);
                if known == self.height {
                    flags |= flat::flags_at(&self.octree.inner, index as usize, || height);
                }
                self.octree.inner[index as usize].flags = flags;
            }
        }
        if self.octree.inner[root as usize].flags != before {
            self.mark_trunk();
        }
    }

    /// Sets the flags of the nodes above the roots of the branches.
    fn mark_trunk(&mut self) {
        let mut levels = Vec::new();
        let mut nodes = self.octree.top();
        for _ in self.height..self.octree.depth {
            let children = self.octree.children_of(&nodes);
            levels.push(std::mem::replace(&mut nodes, children));
        }
        for (level, nodes) in levels.iter().enumerate().rev() {
            for &index in nodes {
                let height = u32::from(self.octree.depth) - level as u32;
                self.octree.inner[index as usize].flags = self.flags(index, height);
            }
        }
    }

    /// Whether all leaves, and whether some leaves, of a node, `height` levels above them, are
    /// glass.
    fn flags(&self, index: u32, height: u32) -> u8 {
        let InnerNode { first, material, mask, .. } = self.octree.inner[index as usize];
        let mut children = first..first + mask.count_ones();
        let some = children.any(|child| match height {
            1 => self.glass(self.octree.leaves[child as usize]) != 0,
            _ => self.octree.inner[child as usize].flags & InnerNode::SOME_GLASS != 0,
        });
        let some = if some { InnerNode::SOME_GLASS } else { 0 };
        self.glass(material) & InnerNode::GLASS | some
    }
}
