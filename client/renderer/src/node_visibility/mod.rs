//! Which octree nodes no eye of a viewpoint box can see, and which every eye sees whole.
//!
//! **Occluders** (`occluders`) are rectangles of opaque voxels in one layer, each as a plane
//! through their middles. A line of sight that meets such a rectangle meets a voxel right there, so
//! it does not matter how voxels differ from the polygons that they were made of. **Patches** are
//! the octree's nodes down to 0.6 m, each as the box around its contents.
//!
//! **A picture is the same with and without.** A node is left out when every line of sight that
//! meets what is drawn of it meets a voxel of an occluder before. That voxel, or the inner node
//! that stands for it, comes first in the traversal and covers the pixel, or something nearer has.
//! Where voxels are smaller than a pixel, inner nodes a pixel wide are drawn in their place. Where
//! such a node may be larger than the steps in which the box around the voxels is known, its whole
//! cube is tested.
//!
//! **Unoccluded nodes** (`unoccluded`) are drawn without tests against the mask buffer, because
//! such tests would find nothing covered. An error here costs time and changes no picture, so
//! roundings do not matter.
//!
//! [`NodeVisibility`] holds for one viewpoint box. `VisibilityPrefetcher` makes them ahead of the
//! eye, on another thread (feature `threads`). The method is fuzzy projection (Lim 1999).

mod occluders;
#[cfg(feature = "threads")]
mod prefetcher;
#[cfg(test)]
mod tests;
mod unoccluded;
mod viewpoint_boxes;

use sightline_visibility::fuzzy::{FuzzyBuffer, SurfaceError, Surfaces, ViewpointBox};
use sightline_world::{
    geometry::Aabb,
    octree::{Cursor, Octree},
};

use super::traversal::NodeClasses;

#[cfg(feature = "threads")]
pub use self::prefetcher::VisibilityPrefetcher;
pub use self::viewpoint_boxes::boxes_ahead;

/// Nodes are tested down to this edge, in metres.
const NODE_M: f32 = 0.6;
/// The box around a node's voxels is found from its contents this many levels below.
const FINER: u8 = 3;
/// The number of elements along each side of a face of the fuzzy buffer.
const ELEMENTS: usize = 256;
/// Boxes are grown on all sides by this share of a voxel, for rounding.
const MARGIN: f32 = 0.05;

/// The occluders and the nodes of a building, for the node visibility of any viewpoint box.
#[derive(Clone, Debug)]
pub struct VoxelOccluders {
    surfaces: Surfaces,
    /// The nodes down to the smallest that are tested. The nodes below a node follow right after
    /// it.
    nodes: Vec<OccluderNode>,
    /// The edge of a voxel, in metres.
    voxel: f32,
    /// The number of inner nodes of the octree.
    inner: usize,
    /// The level of the smallest nodes that are tested.
    level: u8,
}

/// An inner node of the octree.
#[derive(Clone, Copy, Debug)]
struct OccluderNode {
    /// The index among the inner nodes.
    index: u32,
    /// The place of the first node that is not below this one.
    end: u32,
    cube: Aabb,
    /// The box around the node's contents, [`FINER`] levels below.
    tight: Aabb,
    /// A box around the node's voxels that is no larger than `tight`: exact across the layer where
    /// they form one.
    voxels: Aabb,
    /// The axis across which the voxels form one layer, if they do. Known of the smallest nodes
    /// only.
    layer: Option<usize>,
}

/// Which inner nodes no eye of a viewpoint box can see, and which have nothing in front of them.
#[derive(Clone, Debug)]
pub struct NodeVisibility {
    eyes: Aabb,
    /// The least focal length in pixels for which the result holds.
    focal_min: f32,
    /// A bit for each inner node of the octree: whether it is hidden.
    nodes: Vec<u64>,
    /// A bit for each inner node of the octree: whether every eye sees it whole.
    unoccluded: Vec<u64>,
    /// The number of inner nodes of the octree.
    inner: usize,
    level: u8,
    counts: NodeCounts,
}

/// How many nodes were found hidden or unoccluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct NodeCounts {
    /// Nodes of the smallest size that no eye sees.
    pub hidden: usize,
    /// Nodes of the smallest size that every eye sees whole.
    pub visible: usize,
    /// All nodes of the smallest size.
    pub all: usize,
    /// Tests.
    pub tested: usize,
}

impl VoxelOccluders {
    /// Finds the occluders of an octree. Every voxel is visited.
    ///
    /// # Errors
    /// When there are more occluders than can be numbered.
    pub fn new(octree: &Octree) -> Result<Self, SurfaceError> {
        let level = (octree.edge / NODE_M).log2().ceil().max(1.0) as u8;
        let level = level.min(octree.depth - 1);
        let mut collector = NodeCollector { octree, level, nodes: Vec::new() };
        if let Some(root) = octree.root() {
            collector.add(root, 0, octree.bounds());
        }
        Ok(Self {
            surfaces: occluders::find(octree)?,
            nodes: collector.nodes,
            voxel: octree.voxel(),
            inner: octree.inner.len(),
            level,
        })
    }

    /// The number of occluders.
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether there are no occluders.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }
}

/// Collects the nodes of an octree down to a level.
struct NodeCollector<'a> {
    octree: &'a Octree,
    level: u8,
    nodes: Vec<OccluderNode>,
}

impl NodeCollector<'_> {
    /// Adds a node, by its index, and the nodes below it. Returns its place.
    fn add(&mut self, node: Cursor<'_>, index: u32, cube: Aabb) -> usize {
        let (tight, voxels) = (Aabb::EMPTY, Aabb::EMPTY);
        let mut added = OccluderNode { index, end: 0, cube, tight, voxels, layer: None };
        let place = self.nodes.len();
        self.nodes.push(added);
        if node.level() == self.level {
            added.tight = around(node, &cube, self.level + FINER);
            added.voxels = added.tight;
            if let Some((axis, [from, to])) = unoccluded::layer(node, &cube, self.octree) {
                (added.voxels.min[axis], added.voxels.max[axis]) = (from, to);
                added.layer = Some(axis);
            }
        } else {
            for (octant, child) in node.children() {
                let Some(inner) = node.inner() else { continue };
                let Some(index) = inner.child(octant) else { continue };
                let part = self.add(child, index, octant_of(&cube, octant));
                added.tight = added.tight.union(&self.nodes[part].tight);
                added.voxels = added.voxels.union(&self.nodes[part].voxels);
            }
        }
        added.end = self.nodes.len() as u32;
        self.nodes[place] = added;
        place
    }
}

/// The box around the contents of a node, as the cubes of a level.
fn around(node: Cursor<'_>, cube: &Aabb, level: u8) -> Aabb {
    if node.level() == level || node.is_leaf() {
        return *cube;
    }
    let parts =
        node.children().map(|(octant, child)| around(child, &octant_of(cube, octant), level));
    parts.fold(Aabb::EMPTY, |all, part| all.union(&part))
}

/// The cube of an octant of a cube.
fn octant_of(cube: &Aabb, octant: u8) -> Aabb {
    let half = cube.size() * 0.5;
    let at = glam::Vec3::from([0, 1, 2].map(|axis| f32::from(octant >> axis & 1)));
    let min = cube.min + at * half;
    Aabb::new(min, min + half)
}

impl NodeVisibility {
    /// Finds the node visibility of a viewpoint box, for pictures with a focal length of at least
    /// `focal_min` pixels.
    pub fn new(occluders: &VoxelOccluders, eyes: Aabb, focal_min: f32) -> Self {
        // A voxel that contains the eye is not drawn, so it must not hide anything.
        let viewpoints = ViewpointBox::all_round(eyes.grown(occluders.voxel));
        let buffer = FuzzyBuffer::new(&occluders.surfaces, &viewpoints, ELEMENTS);
        let mut hidden = Self {
            eyes,
            focal_min,
            nodes: vec![0; occluders.inner.div_ceil(64).max(1)],
            unoccluded: Vec::new(),
            inner: occluders.inner,
            level: occluders.level,
            counts: NodeCounts::default(),
        };
        let mut unoccluded = hidden.nodes.clone();
        let (mut at, mut open) = (0, Vec::new());
        while let Some(node) = occluders.nodes.get(at) {
            hidden.counts.tested += 1;
            let ends = at as u32 + 1 == node.end;
            if buffer.hides(&hidden.bounds(node).grown(occluders.voxel * MARGIN)) {
                hidden.nodes[node.index as usize / 64] |= 1 << (node.index % 64);
                let below = &occluders.nodes[at..node.end as usize];
                let smallest =
                    (at as u32 + 1..).zip(below).filter(|(next, node)| *next == node.end);
                let count = smallest.count();
                hidden.counts.hidden += count;
                hidden.counts.all += count;
                at = node.end as usize;
            } else {
                hidden.counts.all += usize::from(ends);
                open.extend(ends.then_some(node));
                at += 1;
            }
        }
        let mut visible = 0;
        for node in
            open.into_iter().filter(|node| unoccluded::is_unoccluded(occluders, &hidden, node))
        {
            unoccluded[node.index as usize / 64] |= 1 << (node.index % 64);
            visible += 1;
        }
        (hidden.unoccluded, hidden.counts.visible) = (unoccluded, visible);
        hidden
    }

    /// Whether an inner node is hidden.
    fn is_hidden(&self, index: u32) -> bool {
        self.nodes[index as usize / 64] >> (index % 64) & 1 == 1
    }

    /// This node visibility without its unoccluded nodes, so that every node is tested.
    pub fn without_unoccluded(mut self) -> Self {
        self.unoccluded.fill(0);
        self.counts.visible = 0;
        self
    }

    /// The box around what may be drawn of a node.
    fn bounds(&self, node: &OccluderNode) -> Aabb {
        let step = node.cube.size().x / f32::from(1u16 << FINER);
        let aside = (node.cube.max - self.eyes.min).max(self.eyes.max - node.cube.min);
        // The tight box holds as long as its steps are no smaller than a pixel.
        if aside.length() < step * self.focal_min { node.tight } else { node.cube }
    }

    /// The viewpoint box.
    pub fn eyes(&self) -> Aabb {
        self.eyes
    }

    /// How many nodes were found hidden or unoccluded.
    pub fn counts(&self) -> NodeCounts {
        self.counts
    }

    /// What is known of each inner node; `None` when it does not hold for an octree, an eye and a
    /// focal length.
    pub(super) fn classes(
        &self,
        octree: &Octree,
        eye: glam::Vec3,
        focal: f32,
    ) -> Option<NodeClasses<'_>> {
        let holds =
            self.eyes.contains(eye) && focal >= self.focal_min && octree.inner.len() == self.inner;
        holds.then_some(NodeClasses {
            hidden: &self.nodes,
            unoccluded: &self.unoccluded,
            level: self.level,
        })
    }
}
