//! Which octree nodes no eye of a viewpoint box can see, and which every eye sees whole.
//!
//! **Occluders** (`occluders`) are rectangles of opaque voxels in one layer, each as a plane through
//! their middles. A line of sight that meets such a rectangle meets a voxel right there, so it does
//! not matter how voxels differ from the polygons that they were made of. **Patches** are the
//! octree's nodes down to 0.6 m, each as the box around its contents.
//!
//! **A picture is the same with and without.** A node is left out when every line of sight that
//! meets what is drawn of it meets a voxel of an occluder before. That voxel, or the inner node that
//! stands for it, comes first in the traversal and covers the pixel, or something nearer has. Where
//! voxels are smaller than a pixel, inner nodes a pixel wide are drawn in their place. Where such a
//! node may be larger than the steps in which the box around the voxels is known, its whole cube is
//! tested.
//!
//! **Unoccluded nodes** (`unoccluded`) are drawn without tests against the mask buffer, because such
//! tests would find nothing covered. An error here costs time and changes no picture, so roundings
//! do not matter.
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
/// So many levels below a node its voxels are known, to find the box around them.
const FINER: u8 = 3;
/// Elements of a face of the fuzzy buffer, each way.
const ELEMENTS: usize = 256;
/// Boxes are taken to be larger on all sides by this part of a voxel.
const MARGIN: f32 = 0.05;

/// A building as it hides itself, ready for any box of eyes.
#[derive(Clone, Debug)]
pub struct VoxelOccluders {
    surfaces: Surfaces,
    /// With what is below right behind each.
    nodes: Vec<OccluderNode>,
    voxel: f32,
    /// How many inner nodes the octree has.
    inner: usize,
    /// The level of the smallest nodes that are tested.
    level: u8,
}

/// A node of the octree.
#[derive(Clone, Copy, Debug)]
struct OccluderNode {
    index: u32,
    /// The node after all that is below.
    end: u32,
    cube: Aabb,
    /// Around what is in it.
    tight: Aabb,
    /// The same, and where these are one layer no more than that; as large or smaller.
    voxels: Aabb,
    /// The axis that such a layer lies across; known of the smallest nodes.
    layer: Option<usize>,
}

/// What no eye in a box can see, and what all do.
#[derive(Clone, Debug)]
pub struct NodeVisibility {
    eyes: Aabb,
    /// It does not hold for pictures in which a metre at a metre's distance spans fewer pixels.
    focal_min: f32,
    /// A bit for each inner node of the octree.
    nodes: Vec<u64>,
    /// The same of those that every eye sees whole.
    unoccluded: Vec<u64>,
    inner: usize,
    level: u8,
    counts: NodeCounts,
}

/// What became of the nodes that were tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct NodeCounts {
    /// Nodes of the smallest size that no eye sees, or that are in nodes that none does.
    pub hidden: usize,
    /// Nodes of the smallest size that every eye sees whole.
    pub visible: usize,
    /// All nodes of the smallest size.
    pub all: usize,
    /// Tests.
    pub tested: usize,
}

impl VoxelOccluders {
    /// Looks through all voxels for what hides others.
    ///
    /// # Errors
    /// When there are more walls than can be numbered.
    pub fn new(octree: &Octree) -> Result<Self, SurfaceError> {
        let level = (octree.edge / NODE_M).log2().ceil().max(1.0) as u8;
        let level = level.min(octree.depth - 1);
        let mut nodes = Vec::new();
        if let Some(root) = octree.root() {
            add(&mut nodes, (root, 0), octree.bounds(), (level, octree));
        }
        Ok(Self {
            surfaces: occluders::find(octree)?,
            nodes,
            voxel: octree.voxel(),
            inner: octree.inner.len(),
            level,
        })
    }

    /// How many rectangles there are.
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether nothing hides anything.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }
}

/// Adds a node, by its index, and those below; tells its place.
fn add(
    nodes: &mut Vec<OccluderNode>,
    (node, index): (Cursor<'_>, u32),
    cube: Aabb,
    (level, octree): (u8, &Octree),
) -> usize {
    let place = nodes.len();
    nodes.push(OccluderNode {
        index,
        end: 0,
        cube,
        tight: Aabb::EMPTY,
        voxels: Aabb::EMPTY,
        layer: None,
    });
    if node.level() == level {
        let tight = around(node, &cube, level + FINER);
        let mut voxels = tight;
        if let Some((axis, [from, to])) = unoccluded::layer(node, &cube, octree) {
            (voxels.min[axis], voxels.max[axis]) = (from, to);
            nodes[place].layer = Some(axis);
        }
        (nodes[place].tight, nodes[place].voxels) = (tight, voxels);
    } else {
        for (octant, child) in node.children() {
            let Some(inner) = node.inner() else { continue };
            let Some(index) = inner.child(octant) else { continue };
            let part = add(nodes, (child, index), octant_of(&cube, octant), (level, octree));
            nodes[place].tight = nodes[place].tight.union(&nodes[part].tight);
            nodes[place].voxels = nodes[place].voxels.union(&nodes[part].voxels);
        }
    }
    nodes[place].end = nodes.len() as u32;
    place
}

/// The box around the cubes of a level that are in a node.
fn around(node: Cursor<'_>, cube: &Aabb, level: u8) -> Aabb {
    if node.level() == level || node.is_leaf() {
        return *cube;
    }
    let parts =
        node.children().map(|(octant, child)| around(child, &octant_of(cube, octant), level));
    parts.fold(Aabb::EMPTY, |all, part| all.union(&part))
}

fn octant_of(cube: &Aabb, octant: u8) -> Aabb {
    let half = cube.size() * 0.5;
    let at = glam::Vec3::from([0, 1, 2].map(|axis| f32::from(octant >> axis & 1)));
    let min = cube.min + at * half;
    Aabb::new(min, min + half)
}

impl NodeVisibility {
    /// Finds it, for pictures in which a metre at a metre's distance spans so many pixels or more.
    pub fn new(walls: &VoxelOccluders, eyes: Aabb, focal_min: f32) -> Self {
        // A voxel that an eye is in is not drawn, and hides nothing.
        let viewpoints = ViewpointBox::all_round(eyes.grown(walls.voxel));
        let buffer = FuzzyBuffer::new(&walls.surfaces, &viewpoints, ELEMENTS);
        let mut hidden = Self {
            eyes,
            focal_min,
            nodes: vec![0; walls.inner.div_ceil(64).max(1)],
            unoccluded: Vec::new(),
            inner: walls.inner,
            level: walls.level,
            counts: NodeCounts::default(),
        };
        let mut unoccluded = hidden.nodes.clone();
        let (mut at, mut open) = (0, Vec::new());
        while let Some(node) = walls.nodes.get(at) {
            hidden.counts.tested += 1;
            let ends = at as u32 + 1 == node.end;
            if buffer.hides(&hidden.bounds(node).grown(walls.voxel * MARGIN)) {
                hidden.nodes[node.index as usize / 64] |= 1 << (node.index % 64);
                let below = &walls.nodes[at..node.end as usize];
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
        for node in open.into_iter().filter(|node| unoccluded::is_unoccluded(walls, &hidden, node))
        {
            unoccluded[node.index as usize / 64] |= 1 << (node.index % 64);
            visible += 1;
        }
        (hidden.unoccluded, hidden.counts.visible) = (unoccluded, visible);
        hidden
    }

    fn is_hidden(&self, index: u32) -> bool {
        self.nodes[index as usize / 64] >> (index % 64) & 1 == 1
    }

    /// The same, but all that is drawn is tested.
    pub fn without_unoccluded(mut self) -> Self {
        self.unoccluded.fill(0);
        self.counts.visible = 0;
        self
    }

    /// What may be drawn of a node.
    fn bounds(&self, node: &OccluderNode) -> Aabb {
        let step = node.cube.size().x / f32::from(1u16 << FINER);
        let aside = (node.cube.max - self.eyes.min).max(self.eyes.max - node.cube.min);
        // As far as its steps are no smaller than a pixel.
        if aside.length() < step * self.focal_min { node.tight } else { node.cube }
    }

    /// The box of eyes.
    pub fn eyes(&self) -> Aabb {
        self.eyes
    }

    /// What became of the nodes.
    pub fn counts(&self) -> NodeCounts {
        self.counts
    }

    /// What is known of each inner node, if it holds for an octree, an eye and a focal length.
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
