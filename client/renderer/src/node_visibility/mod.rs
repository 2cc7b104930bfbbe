//! What of the building no eye in a box can see: it is left out of all pictures from there. And what every eye sees whole.
//!
//! **Surfaces** of the octree are what its voxels are without a gap: rectangles of opaque voxels in one layer
//! (`walls`), by a plane through their middles. A line of sight that meets such a rectangle meets a voxel
//! right there, whatever the building was modelled of; so nothing need be known about how voxels differ from
//! polygons. **Patches** are the octree's nodes down to 0.6 m, each by the box around what is in it, that is with
//! all below it.
//!
//! **A picture is the same with and without.** A node is left out when every line of sight that meets what is drawn of it
//! meets a voxel of a wall before. That voxel, or the cell that stands for it, comes first in the order of the walk
//! and closes the pixel, or something before it has. What is drawn of a node in place of its voxels, where these
//! are smaller than a pixel, is cells a pixel wide: where such a cell may be larger than the steps in which
//! the box around the node's voxels is known, all of the node's cube is tested.
//!
//! **What every eye sees whole** (`clear`) is drawn without a test against the mask buffer, as such tests find nothing
//! covered. Here being wrong would take time and change nothing, so roundings do not matter.
//!
//! [`NodeVisibility`] is for one box of eyes, [`VisibilityPrefetcher`] makes them on another thread, ahead of the eye.

mod occluders;
mod prefetcher;
#[cfg(test)]
mod tests;
mod unoccluded;

use sightline_visibility::fuzzy::{FuzzyBuffer, SurfaceError, Surfaces, ViewpointBox};
use sightline_world::{
    geometry::Aabb,
    octree::{Cursor, Octree},
};

use super::traversal::NodeClasses;
pub use prefetcher::{VisibilityPrefetcher, boxes_ahead};

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
    nodes: Vec<Node>,
    voxel: f32,
    /// How many inner nodes the octree has.
    inner: usize,
    /// The level of the smallest nodes that are tested.
    level: u8,
}

/// A node of the octree.
#[derive(Clone, Copy, Debug)]
struct Node {
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
    clear: Vec<u64>,
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
    nodes: &mut Vec<Node>,
    (node, index): (Cursor<'_>, u32),
    cube: Aabb,
    (level, octree): (u8, &Octree),
) -> usize {
    let place = nodes.len();
    nodes.push(Node { index, end: 0, cube, tight: Aabb::EMPTY, voxels: Aabb::EMPTY, layer: None });
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
            clear: Vec::new(),
            inner: walls.inner,
            level: walls.level,
            counts: NodeCounts::default(),
        };
        let mut clear = hidden.nodes.clone();
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
        for node in open.into_iter().filter(|node| unoccluded::is_clear(walls, &hidden, node)) {
            clear[node.index as usize / 64] |= 1 << (node.index % 64);
            visible += 1;
        }
        (hidden.clear, hidden.counts.visible) = (clear, visible);
        hidden
    }

    fn is_hidden(&self, index: u32) -> bool {
        self.nodes[index as usize / 64] >> (index % 64) & 1 == 1
    }

    /// The same, but all that is drawn is tested.
    pub fn without_unoccluded(mut self) -> Self {
        self.clear.fill(0);
        self.counts.visible = 0;
        self
    }

    /// What may be drawn of a node.
    fn bounds(&self, node: &Node) -> Aabb {
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
    pub(super) fn known(
        &self,
        octree: &Octree,
        eye: glam::Vec3,
        focal: f32,
    ) -> Option<NodeClasses<'_>> {
        let holds =
            self.eyes.contains(eye) && focal >= self.focal_min && octree.inner.len() == self.inner;
        holds.then_some(NodeClasses { hidden: &self.nodes, clear: &self.clear, level: self.level })
    }
}
