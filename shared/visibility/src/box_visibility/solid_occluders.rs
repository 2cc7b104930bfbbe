//! Occluders in the solid part of a building: large boxes that overlap each other.

use std::{
    collections::HashSet,
    ops::ControlFlow::{Break, Continue},
};

use glam::Vec3;
use sightline_world::{
    CellId, Cells, Node, Origin, Solid, World, geometry::Aabb, tolerance::TOUCH_M,
};

use super::bvh::Bvh;

/// A hollow no thicker than this, in metres, may be the inside of a wall or slab, where nobody can
/// be.
const WALL_MAX_M: f32 = 0.6;
/// The orders in which boxes grow along the axes. A box that grows long along one axis first may
/// end up short along another.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
/// The most boxes to start growing from. Growing takes 24 bytes for each of them and each order.
const SEEDS_MAX: usize = 1 << 18;

/// The solid part of a subdivision.
pub(super) struct SolidOccluders<'a> {
    cells: &'a Cells,
    /// For each space, whether it is the inside of a wall.
    walls: Vec<bool>,
}

impl<'a> SolidOccluders<'a> {
    pub fn new(world: &'a World) -> Self {
        Self { cells: &world.cells, walls: walls(world) }
    }

    /// Whether a point in own axes is in the solid part, or inside a wall.
    pub fn holds(&self, point: Vec3) -> bool {
        self.cells.bounds.contains(point)
            && self.cells.at_own(point).is_none_or(|cell| self.is_wall(cell))
    }

    /// Boxes in the solid part, none of which lies in another.
    pub fn boxes(&self, world: &World) -> Vec<Aabb> {
        let mut known = HashSet::new();
        let mut grown: Vec<Aabb> = Vec::new();
        for seed in self.seeds(world) {
            for order in ORDERS {
                let mut region = seed;
                order.into_iter().for_each(|axis| self.grow(&mut region, axis));
                if known.insert(bits(&region)) {
                    grown.push(region);
                }
            }
        }
        outermost(&grown)
    }

    /// The boxes to start growing from: solid leaves, and the brushes of a Quake map that are
    /// boxes.
    fn seeds(&self, world: &World) -> Vec<Aabb> {
        let mut seeds = Vec::new();
        self.leaves(0, self.cells.bounds, &mut seeds);
        if let Some(origin) = &world.origin {
            let boxes = origin.solids.iter().filter(|solid| is_box(origin, solid));
            // In turned axes this is a box around the brush, and most likely not all of it is
            // solid.
            let own = boxes.map(|solid| self.cells.axes.own_box(&solid.bounds));
            seeds.extend(own.map(|region| region.intersection(&self.cells.bounds)));
        }
        seeds.retain(|seed| self.is_solid(seed));
        seeds.truncate(SEEDS_MAX);
        seeds
    }

    /// Adds the boxes around the solid leaves below a node, whose box is `region`.
    fn leaves(&self, node: u32, region: Aabb, found: &mut Vec<Aabb>) {
        let (low, high, sides) = match self.cells.tree[node as usize] {
            Node::Leaf(cell) if !self.is_wall(cell) => return,
            Node::Leaf(_) | Node::Solid => return found.push(region),
            Node::Plane { sides, .. } => (region, region, sides),
            Node::Axial { axis, at, sides } => {
                let (mut low, mut high) = (region, region);
                let axis = usize::from(axis);
                low.max[axis] = low.max[axis].min(at);
                high.min[axis] = high.min[axis].max(at);
                (low, high, sides)
            }
        };
        self.leaves(sides[0], low, found);
        self.leaves(sides[1], high, found);
    }

    /// Whether a box has a volume and no cell reaches into it.
    fn is_solid(&self, region: &Aabb) -> bool {
        let within = region.grown(-TOUCH_M);
        let mut found = Vec::new();
        if !within.is_empty() {
            self.cells.overlapping(&within, &mut found);
        }
        !within.is_empty() && found.iter().all(|&cell| self.is_wall(cell))
    }

    fn is_wall(&self, cell: CellId) -> bool {
        self.walls[self.cells.cells[cell.0 as usize].space as usize]
    }

    /// Moves the two faces of a box across an axis outwards, as far as the box stays solid.
    fn grow(&self, region: &mut Aabb, axis: usize) {
        let bounds = &self.cells.bounds;
        let mut above = region.grown(-TOUCH_M);
        (above.min[axis], above.max[axis]) = (region.max[axis] - TOUCH_M, bounds.max[axis]);
        self.shorten(0, &mut above, axis, true);
        let mut below = region.grown(-TOUCH_M);
        (below.min[axis], below.max[axis]) = (bounds.min[axis], region.min[axis] + TOUCH_M);
        self.shorten(0, &mut below, axis, false);
        debug_assert!(above.max[axis] <= bounds.max[axis] && below.min[axis] >= bounds.min[axis]);
        region.max[axis] = region.max[axis].max(above.max[axis]);
        region.min[axis] = region.min[axis].min(below.min[axis]);
    }

    /// Moves the far face of a box inwards until no cell below a node reaches into the box. `up`
    /// says whether the far face is the upper one.
    fn shorten(&self, node: u32, sweep: &mut Aabb, axis: usize, up: bool) {
        match self.cells.tree[node as usize] {
            Node::Solid => {}
            Node::Leaf(cell) => {
                let bounds = &self.cells.cells[cell.0 as usize].bounds;
                // The boxes around two cells may overlap though the cells do not.
                if self.is_wall(cell) || !bounds.intersects(sweep) {
                    return;
                }
                if up {
                    sweep.max[axis] = sweep.max[axis].min(bounds.min[axis]).max(sweep.min[axis]);
                } else {
                    sweep.min[axis] = sweep.min[axis].max(bounds.max[axis]).min(sweep.max[axis]);
                }
            }
            Node::Axial { axis: across, at, sides } => {
                let across = usize::from(across);
                // The nearer side comes first: it may leave nothing of the other.
                let nearer = usize::from(across == axis && !up);
                for side in [nearer, 1 - nearer] {
                    let is_in = [sweep.min[across] <= at, sweep.max[across] >= at][side];
                    if is_in {
                        self.shorten(sides[side], sweep, axis, up);
                    }
                }
            }
            Node::Plane { normal, distance, sides } => {
                for (side, sign) in sides.into_iter().zip([1.0, -1.0]) {
                    let away = normal.dot(sweep.centre().as_dvec3()) - distance;
                    let reach = normal.abs().dot(sweep.size().as_dvec3() * 0.5);
                    if away * sign <= reach + f64::from(TOUCH_M) {
                        self.shorten(side, sweep, axis, up);
                    }
                }
            }
        }
    }
}

/// Whether all sides of a brush are axial in the world's axes.
pub(super) fn is_box(origin: &Origin, solid: &Solid) -> bool {
    origin.sides(solid).all(|side| side.normal.abs().max_element() == 1.0)
}

/// For each space, whether it is the inside of a wall. It is one if gates join it to no space that
/// is thicker than a wall, reaches the edge of the world or holds a spawn point.
fn walls(world: &World) -> Vec<bool> {
    let cells = &world.cells;
    let eyes: Vec<Vec3> = world.spawns.iter().map(|spawn| cells.axes.own(spawn.eye)).collect();
    let is_open = |bounds: &Aabb| {
        !cells.bounds.grown(-TOUCH_M).contains_box(bounds)
            || bounds.size().min_element() > WALL_MAX_M
            || eyes.iter().any(|eye| bounds.contains(*eye))
    };
    let mut walls: Vec<bool> = cells.spaces.iter().map(|space| !is_open(&space.bounds)).collect();
    debug_assert_eq!(walls.len(), cells.spaces.len());
    let mut open: Vec<u32> = (0..).zip(&walls).filter(|(_, w)| !**w).map(|(i, _)| i).collect();
    while let Some(space) = open.pop() {
        for &gate in &cells.spaces[space as usize].gates {
            for next in cells.gates[gate as usize].spaces {
                if std::mem::replace(&mut walls[next as usize], false) {
                    open.push(next);
                }
            }
        }
    }
    walls
}

/// The bits of a box's corners, as a key.
fn bits(region: &Aabb) -> [[u32; 3]; 2] {
    [region.min, region.max].map(|corner| corner.to_array().map(f32::to_bits))
}

/// The boxes that do not lie in another.
fn outermost(boxes: &[Aabb]) -> Vec<Aabb> {
    let tree = Bvh::new(boxes);
    let is_inside = |index: u32, region: &Aabb| {
        let middle = Aabb::new(region.centre(), region.centre());
        let found = tree.touching(&middle, |other| {
            let of = &boxes[other as usize];
            let holds = other != index && of.grown(TOUCH_M).contains_box(region);
            // Of two that hold each other, the first is kept.
            let is_held = region.grown(TOUCH_M).contains_box(of);
            if holds && (!is_held || other < index) { Break(()) } else { Continue(()) }
        });
        found.is_break()
    };
    let kept = (0..).zip(boxes).filter(|(index, region)| !is_inside(*index, region));
    kept.map(|(_, region)| *region).collect()
}
