//! The tree of cells, cut off at nodes below which all cells belong to one space.

use glam::Vec3A;
use sightline_world::{Cells, Node, geometry::Aabb, tolerance::GATE_WIDENING_M};

/// A binary space partition whose leaves are spaces.
#[derive(Clone, Debug, Default)]
pub(super) struct SpaceTree {
    /// The root comes first. Empty without a building.
    nodes: Vec<SpaceNode>,
}

#[derive(Clone, Copy, Debug)]
enum SpaceNode {
    Axial { axis: u8, at: f32, sides: [u32; 2] },
    Plane { normal: Vec3A, distance: f32, sides: [u32; 2] },
    Space(u32),
    Solid,
}

impl SpaceTree {
    pub(super) fn new(cells: &Cells) -> Self {
        assert!(!cells.tree.is_empty(), "a subdivision has a root");
        let space_below = space_below(cells);
        let (mut nodes, mut open) = (vec![SpaceNode::Solid], vec![(0, 0)]);
        while let Some((from, to)) = open.pop() {
            let node = cells.tree[from as usize];
            let mut add_sides = |sides: [u32; 2]| {
                let first = nodes.len() as u32;
                nodes.extend([SpaceNode::Solid; 2]);
                open.extend([(sides[0], first), (sides[1], first + 1)]);
                [first, first + 1]
            };
            nodes[to as usize] = match (space_below[from as usize], node) {
                (Some(space), _) => SpaceNode::Space(space),
                (None, Node::Axial { axis, at, sides }) => {
                    SpaceNode::Axial { axis, at, sides: add_sides(sides) }
                }
                (None, Node::Plane { normal, distance, sides }) => SpaceNode::Plane {
                    normal: normal.as_vec3a(),
                    distance: distance as f32,
                    sides: add_sides(sides),
                },
                (None, Node::Leaf(_) | Node::Solid) => SpaceNode::Solid,
            };
        }
        Self { nodes }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Finds the spaces that a box overlaps; a space may be found twice. `open` is scratch memory.
    pub(super) fn overlapping(
        &self,
        region: &Aabb,
        open: &mut Vec<u32>,
        found: &mut Vec<u32>,
        visited: &mut u32,
    ) {
        found.clear();
        let (centre, half) = (Vec3A::from(region.centre()), Vec3A::from(region.size() * 0.5));
        open.push(0);
        while let Some(node) = open.pop() {
            *visited += 1;
            let (distance, reach, sides) = match self.nodes[node as usize] {
                SpaceNode::Space(space) => {
                    found.push(space);
                    continue;
                }
                SpaceNode::Solid => continue,
                SpaceNode::Axial { axis, at, sides } => {
                    let axis = usize::from(axis);
                    (centre[axis] - at, half[axis], sides)
                }
                SpaceNode::Plane { normal, distance, sides } => {
                    (normal.dot(centre) - distance, normal.abs().dot(half), sides)
                }
            };
            if distance <= reach + GATE_WIDENING_M {
                open.push(sides[0]);
            }
            if distance >= -reach - GATE_WIDENING_M {
                open.push(sides[1]);
            }
        }
    }

    /// Heap memory in use, in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<SpaceNode>()
    }
}

/// For each node of the cells' tree the space that all leaves below it belong to, if there is one.
fn space_below(cells: &Cells) -> Vec<Option<u32>> {
    let mut spaces: Vec<Option<u32>> = vec![None; cells.tree.len()];
    for (index, node) in cells.tree.iter().enumerate().rev() {
        spaces[index] = match *node {
            Node::Leaf(cell) => Some(cells.cells[cell.0 as usize].space),
            Node::Solid => None,
            Node::Axial { sides, .. } | Node::Plane { sides, .. } => {
                let [low, high] = sides.map(|side| spaces[side as usize]);
                low.filter(|_| low == high)
            }
        };
    }
    spaces
}
