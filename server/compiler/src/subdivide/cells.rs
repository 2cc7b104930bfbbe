//! The second step: spaces split into cells, and the portals between them.

use std::ops::Range;

use glam::Vec3;
use sightline_world::{Cell, CellId, Cells, Gate, Node, Portal, Space};

use super::{
    CellSize,
    bsp_tree::{BspNode, BspTree},
    polygon::polygon,
    region::{Region, WALL_MAX},
    spaces::Spaces,
};
use crate::split_plane::SplitPlane;

/// How spaces are split into cells.
#[derive(Clone, Copy)]
pub(crate) enum CellGrain<'a> {
    /// Each space is one cell.
    Whole,
    /// All cells are about of one size.
    Even(CellSize),
    /// The same, but for some spaces, each of which is one cell.
    EvenExcept(CellSize, &'a [bool]),
}

/// Splits the spaces into cells, and finds the portals between these. The PVS is left empty.
pub(crate) fn cells(spaces: &Spaces, grain: CellGrain<'_>) -> Cells {
    let mut builder = CellBuilder {
        spaces_in: spaces,
        grain,
        fine: BspTree::default(),
        spaces: Vec::new(),
        space_of: vec![u32::MAX; spaces.tree.leaves.len()],
        roots: Vec::new(),
    };
    builder.refine(0);
    builder.finish()
}

/// Cells that are being made.
struct CellBuilder<'a> {
    spaces_in: &'a Spaces,
    grain: CellGrain<'a>,
    /// The final tree, whose leaves are the cells.
    fine: BspTree,
    spaces: Vec<(Range<u32>, Region)>,
    /// The space of each leaf of the coarse tree.
    space_of: Vec<u32>,
    /// The node of each space in the final tree.
    roots: Vec<u32>,
}

impl CellBuilder<'_> {
    /// Adds a subtree of the coarse tree, with its spaces split into cells.
    fn refine(&mut self, node: u32) -> u32 {
        match &self.spaces_in.tree.nodes[node as usize] {
            BspNode::Split { cut, plane, sides } => {
                let index = self.fine.reserve();
                let sides = sides.map(|side| self.refine(side));
                self.fine.set_split(index, *cut, *plane, sides);
                index
            }
            BspNode::Leaf(leaf) if self.spaces_in.kept[*leaf as usize] => {
                let region = &self.spaces_in.tree.leaves[*leaf as usize];
                let start = self.fine.leaves.len() as u32;
                let space = self.spaces.len() as u32;
                self.space_of[*leaf as usize] = space;
                let root = match self.grain {
                    CellGrain::Whole => self.fine_leaf(region.clone()),
                    CellGrain::Even(size) => self.split_evenly(region.clone(), &size),
                    CellGrain::EvenExcept(_, whole) if whole[space as usize] => {
                        self.fine_leaf(region.clone())
                    }
                    CellGrain::EvenExcept(size, _) => self.split_evenly(region.clone(), &size),
                };
                self.spaces.push((start..self.fine.leaves.len() as u32, region.clone()));
                self.roots.push(root);
                root
            }
            BspNode::Leaf(_) | BspNode::Solid => self.fine.solid(),
        }
    }

    /// Adds a region as a cell.
    fn fine_leaf(&mut self, region: Region) -> u32 {
        if region.extent().is_none() { self.fine.solid() } else { self.fine.space(region) }
    }

    /// Adds a space as a subtree of cells: halved across its longest side until all are small
    /// enough.
    fn split_evenly(&mut self, region: Region, most: &CellSize) -> u32 {
        let Some((bounds, _)) = region.extent() else { return self.fine.solid() };
        let size = bounds.size();
        let too = size / Vec3::new(most.width_max, most.height_max, most.width_max);
        let axis = (0..3).max_by(|&a, &b| too[a].total_cmp(&too[b])).unwrap_or(0);
        if too[axis] <= 1.0 || size.min_element() <= WALL_MAX && too[axis] <= 2.0 {
            return self.fine.space(region);
        }
        let cut = SplitPlane::Axial { axis, at: bounds.centre()[axis] };
        let index = self.fine.reserve();
        let sides = region.halves(&cut).map(|half| self.split_evenly(half.tightened(), most));
        self.fine.set_split(index, cut, None, sides);
        index
    }

    /// Collects spaces, gates, cells and portals.
    fn finish(self) -> Cells {
        let Spaces { bounds, axes, gates, .. } = self.spaces_in;
        let mut spaces: Vec<Space> = self
            .spaces
            .iter()
            .map(|(cells, region)| {
                let bounds = region.extent().map_or(region.bounds, |(bounds, _)| bounds);
                Space { bounds, cells: cells.clone(), gates: Vec::new() }
            })
            .collect();
        let mut portals = Vec::new();
        let mut found = Vec::new();
        for (space, (_, region)) in self.spaces.iter().enumerate() {
            found.extend(self.fine.shared_faces(self.roots[space], region));
        }
        let mut world_gates = Vec::new();
        for (join, polygon) in gates {
            let ids = join.leaves.map(|leaf| self.space_of[leaf as usize]);
            if ids.contains(&u32::MAX) {
                continue;
            }
            for space in ids {
                spaces[space as usize].gates.push(world_gates.len() as u32);
            }
            debug_assert_ne!(ids[0], ids[1], "a gate joins two spaces");
            world_gates.push(Gate { spaces: ids, polygon: polygon.clone() });
            let roots = ids.map(|space| self.roots[space as usize]);
            self.fine.add_faces_across(roots, &join.cut, None, join.polygon.clone(), &mut found);
        }
        let mut cells: Vec<Cell> = Vec::with_capacity(self.fine.leaves.len());
        for (space, (range, _)) in (0..).zip(&self.spaces) {
            for leaf in range.clone() {
                let region = &self.fine.leaves[leaf as usize];
                let bounds = region.extent().map_or(region.bounds, |(bounds, _)| bounds);
                cells.push(Cell { bounds, space, portals: Vec::new() });
            }
        }
        for join in found {
            let Some(polygon) = polygon(&join.cut, &join.polygon) else { continue };
            for cell in join.leaves {
                cells[cell as usize].portals.push(portals.len() as u32);
            }
            portals.push(Portal { cells: join.leaves.map(CellId), polygon });
        }
        assert_eq!(cells.len(), self.fine.leaves.len(), "each leaf is a cell");
        let tree = self.fine.nodes.iter().map(world_node).collect();
        let gates = world_gates;
        Cells { axes: *axes, bounds: *bounds, tree, cells, portals, spaces, gates, pvs: Vec::new() }
    }
}

/// A node as the world has it.
fn world_node(node: &BspNode) -> Node {
    match *node {
        BspNode::Split { cut: SplitPlane::Axial { axis, at }, sides, .. } => {
            Node::Axial { axis: axis as u8, at, sides }
        }
        BspNode::Split { cut: SplitPlane::Plane { normal, distance }, sides, .. } => {
            Node::Plane { normal, distance, sides }
        }
        BspNode::Leaf(leaf) => Node::Leaf(CellId(leaf)),
        BspNode::Solid => Node::Solid,
    }
}
