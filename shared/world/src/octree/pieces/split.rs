//! Cuts an octree into pieces.

use super::{
    super::{
        Octree,
        codec::{head, palette_planes, put_frame},
    },
    BRANCHES_AIM, GRADES, HEIGHTS, UNPACKED_MAX, grade_levels,
    level::{Level, MaterialCodes},
};
use crate::packing;

/// Higher levels take much longer and gain little.
const ZSTD_LEVEL: i32 = 9;

/// An octree in pieces.
#[derive(Clone, Debug, PartialEq)]
pub struct OctreePieces {
    /// The palette, and the nodes down to the roots of the branches.
    pub trunk: Vec<u8>,
    /// The grades of each branch, coarse ones first.
    pub branches: Vec<Vec<Vec<u8>>>,
}

impl Octree {
    /// The tree in pieces. Equal trees give equal pieces on all native platforms.
    pub fn to_pieces(&self) -> OctreePieces {
        let mut height = self.branch_height();
        let codes = MaterialCodes::of(self);
        let branches = loop {
            match self.grades(height, &codes) {
                Some(branches) => break branches,
                // Six levels always fit.
                None => height -= 1,
            }
        };
        OctreePieces { trunk: self.trunk(height, branches.len(), &codes), branches }
    }

    /// The number of levels of a branch.
    fn branch_height(&self) -> u8 {
        let mut level = self.top();
        // The number of nodes by level.
        let mut counts = vec![level.len()];
        for _ in 1..self.depth {
            level = self.children_of(&level);
            counts.push(level.len());
        }
        let few = |&height: &u8| {
            let at = usize::from(self.depth.saturating_sub(height));
            counts.get(at).is_none_or(|&count| count <= BRANCHES_AIM)
        };
        let height = HEIGHTS.clone().find(few).unwrap_or(*HEIGHTS.end());
        height.min(self.depth)
    }

    /// All grades of all branches. `None` when one has too many bytes.
    fn grades(&self, height: u8, codes: &MaterialCodes) -> Option<Vec<Vec<Vec<u8>>>> {
        let mut roots = self.top();
        for _ in height..self.depth {
            roots = self.children_of(&roots);
        }
        roots.into_iter().map(|root| self.branch(root, height, codes)).collect()
    }

    fn branch(&self, root: u32, height: u8, codes: &MaterialCodes) -> Option<Vec<Vec<u8>>> {
        let mut above = vec![root];
        let mut grades = Vec::new();
        for grade in 0..GRADES {
            let mut bytes = Vec::new();
            for level in grade_levels(height, grade) {
                above = self.put_level(&mut bytes, &above, level == height, codes);
            }
            if bytes.len() > UNPACKED_MAX {
                return None;
            }
            if !bytes.is_empty() {
                grades.push(packing::pack(&bytes, ZSTD_LEVEL));
            }
        }
        Some(grades)
    }

    fn trunk(&self, height: u8, branches: usize, codes: &MaterialCodes) -> Vec<u8> {
        let mut out = head(self);
        out.push(height);
        for count in [self.materials.len(), branches] {
            out.extend((count as u32).to_le_bytes());
        }
        put_frame(&mut out, &palette_planes(&self.keys));
        let mut levels = Vec::new();
        let mut above = self.top();
        if let Some(root) = self.root() {
            // The root is the only child of a node that looks like the first material.
            let materials = vec![root.material_index()];
            Level { masks: vec![1], materials }.put(&mut levels, &[0], codes);
        }
        for _ in height..self.depth {
            above = self.put_level(&mut levels, &above, false, codes);
        }
        put_frame(&mut out, &levels);
        out
    }

    /// Appends the level below some nodes, and gives its nodes unless they are leaves.
    fn put_level(
        &self,
        out: &mut Vec<u8>,
        above: &[u32],
        is_leaves: bool,
        codes: &MaterialCodes,
    ) -> Vec<u32> {
        let children = self.children_of(above);
        let material = |&index: &u32| match is_leaves {
            true => self.leaves[index as usize],
            false => self.inner[index as usize].material,
        };
        let masks = above.iter().map(|&index| self.inner[index as usize].mask).collect();
        let materials = children.iter().map(material).collect();
        let parents: Vec<u16> =
            above.iter().map(|&index| self.inner[index as usize].material).collect();
        Level { masks, materials }.put(out, &parents, codes);
        if is_leaves { Vec::new() } else { children }
    }

    /// The root, if there is one, as a level of nodes.
    pub(super) fn top(&self) -> Vec<u32> {
        if self.inner.is_empty() { Vec::new() } else { vec![0] }
    }

    /// The children of inner nodes, in order.
    pub(super) fn children_of(&self, level: &[u32]) -> Vec<u32> {
        let node = |&index: &u32| &self.inner[index as usize];
        let children =
            level.iter().map(node).flat_map(|node| node.first..node.first + node.mask.count_ones());
        children.collect()
    }
}
