//! The order of nodes in memory and in the file: from child masks to linked nodes.

use std::ops::Range;

use super::{BLOCK_LEVELS, InnerNode, OctreeError};

/// Inner nodes linked to their children, without materials.
pub(super) struct TreeLayout {
    pub(super) inner: Vec<InnerNode>,
    /// The roots of the blocks.
    pub(super) roots: Range<usize>,
    /// The number of leaves.
    pub(super) leaves: usize,
}

/// The number of levels of inner nodes above the roots of the blocks, and from the roots down.
pub(super) fn levels(depth: u8) -> (u8, u8) {
    let below = depth.min(BLOCK_LEVELS);
    (depth - below, below)
}

impl TreeLayout {
    /// Links nodes with these child masks in a tree of a given depth.
    ///
    /// # Errors
    ///
    /// When a mask is zero, or there are too few or too many masks.
    pub(super) fn link(masks: &[u8], depth: u8) -> Result<Self, OctreeError> {
        if masks.contains(&0) {
            return Err(OctreeError::Nonsense("mask"));
        }
        let inner = masks.iter().map(|&mask| InnerNode { mask, ..InnerNode::default() }).collect();
        let mut linking = Linking { inner, next: 0, leaves: 0 };
        if masks.is_empty() {
            return Ok(Self { inner: linking.inner, roots: 0..0, leaves: 0 });
        }
        let (above, below) = levels(depth);
        linking.next = 1;
        let mut roots = 0..1;
        for _ in 0..above {
            roots = linking.children(roots)?;
        }
        for root in roots.clone() {
            let mut level = root..root + 1;
            for _ in 1..below {
                level = linking.children(level)?;
            }
            linking.leaves_of(level);
        }
        if linking.next != masks.len() {
            return Err(OctreeError::Length);
        }
        let leaves = usize::try_from(linking.leaves).map_err(|_| OctreeError::TooLarge)?;
        Ok(Self { inner: linking.inner, roots, leaves })
    }
}

/// The inner nodes of the block with a given root.
pub(super) fn block(
    inner: &[InnerNode],
    roots: &Range<usize>,
    root: usize,
    depth: u8,
) -> BlockRange {
    let (_, below) = levels(depth);
    let start_of = |root: usize| match below {
        1 => inner.len(),
        _ if root < roots.end => inner[root].first as usize,
        _ => inner.len(),
    };
    let nodes = start_of(root)..start_of(root + 1);
    let mut bottom = root;
    for _ in 1..below {
        bottom = inner[bottom].first as usize;
    }
    BlockRange { nodes, bottom }
}

/// The inner nodes of a block below its root.
pub(super) struct BlockRange {
    pub(super) nodes: Range<usize>,
    /// The first node just above the leaves: the root itself when there are no nodes below it.
    pub(super) bottom: usize,
}

struct Linking {
    inner: Vec<InnerNode>,
    next: usize,
    leaves: u64,
}

impl Linking {
    /// Links the nodes of a level to their children, which are the next nodes.
    fn children(&mut self, level: Range<usize>) -> Result<Range<usize>, OctreeError> {
        let start = self.next;
        for node in self.inner.get_mut(level).ok_or(OctreeError::Length)? {
            node.first = self.next as u32;
            self.next += node.mask.count_ones() as usize;
        }
        if self.next > self.inner.len() {
            return Err(OctreeError::Length);
        }
        Ok(start..self.next)
    }

    fn leaves_of(&mut self, level: Range<usize>) {
        for node in &mut self.inner[level] {
            node.first = self.leaves as u32;
            self.leaves += u64::from(node.mask.count_ones());
        }
    }
}
