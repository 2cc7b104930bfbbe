//! What is solid all through: large boxes inside of it, which reach into each other.

use std::{
    collections::HashSet,
    ops::ControlFlow::{Break, Continue},
};

use glam::Vec3;

use super::bvh::Bvh;
use sightline_world::{
    CellId, Cells, Node, Origin, Solid, World, geometry::Aabb, tolerance::TOUCH_M,
};

/// Insides of walls and slabs are no thicker than this, in metres: no place to be.
const WALL_MAX_M: f32 = 0.6;
/// Boxes grow along the axes in each order: what is long one way may be short the other way.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
/// Boxes grow from no more places than this; what they need meanwhile is 24 bytes for each order.
const SEEDS_MAX: usize = 1 << 18;

/// The solid parts of a subdivision.
pub(super) struct SolidOccluders<'a> {
    cells: &'a Cells,
    /// For each space, whether it is the inside of a wall.
    walls: Vec<bool>,
}

impl<'a> SolidOccluders<'a> {
    pub fn new(world: &'a World) -> Self {
        Self { cells: &world.cells, walls: walls(world) }
    }

    /// Whether a point in own axes is in something solid.
    pub fn holds(&self, point: Vec3) -> bool {
        self.cells.bounds.contains(point)
            && self.cells.at_own(point).is_none_or(|cell| self.is_wall(cell))
    }

    /// Boxes inside of what is solid, none of which is inside of another.
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

    /// Where to begin: solid leaves that are boxes, and a map's brushes that are.
    fn seeds(&self, world: &World) -> Vec<Aabb> {
        let mut seeds = Vec::new();
        self.leaves(0, self.cells.bounds, &mut seeds);
        if let Some(origin) = &world.origin {
            let boxes = origin.solids.iter().filter(|solid| is_box(origin, solid));
            // Where axes are turned, this is around the brush and most likely not all solid.
            let own = boxes.map(|solid| self.cells.axes.own_box(&solid.bounds));
            seeds.extend(own.map(|region| region.intersection(&self.cells.bounds)));
        }
        seeds.retain(|seed| self.is_solid(seed));
        seeds.truncate(SEEDS_MAX);
        seeds
    }

    /// Adds the boxes around solid leaves.
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

    /// Whether a box has some volume, and no cell reaches into it.
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

    /// Moves both faces of a box that are across an axis as far out as it stays solid.
    fn grow(&self, region: &mut Aabb, axis: usize) {
        let bounds = &self.cells.bounds;
        let mut above = region.grown(-TOUCH_M);
        (above.min[axis], above.max[axis]) = (region.max[axis] - TOUCH_M, bounds.max[axis]);
        self.shorten(0, &mut above, axis, true);
        let mut below = region.grown(-TOUCH_M);
        (below.min[axis], below.max[axis]) = (bounds.min[axis], region.min[axis] + TOUCH_M);
        self.shorten(0, &mut below, axis, false);
        region.max[axis] = region.max[axis].max(above.max[axis]);
        region.min[axis] = region.min[axis].min(below.min[axis]);
    }

    /// Moves the far face of a box inwards until no cell is in it.
    fn shorten(&self, node: u32, sweep: &mut Aabb, axis: usize, up: bool) {
        match self.cells.tree[node as usize] {
            Node::Solid => {}
            Node::Leaf(cell) => {
                let bounds = &self.cells.cells[cell.0 as usize].bounds;
                // Cells that are no boxes are found when they only come near.
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
                // The nearer side first: it may leave nothing of the other.
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

/// Whether all sides of a brush are along the world's axes.
pub(super) fn is_box(origin: &Origin, solid: &Solid) -> bool {
    origin.sides(solid).all(|side| side.normal.abs().max_element() == 1.0)
}

/// Which spaces are insides of walls: those that hang together through gates with nothing that is
/// thicker than a wall, that reaches the edge of the world or in which somebody begins.
fn walls(world: &World) -> Vec<bool> {
    let cells = &world.cells;
    let eyes: Vec<Vec3> = world.spawns.iter().map(|spawn| cells.axes.own(spawn.eye)).collect();
    let is_open = |bounds: &Aabb| {
        !cells.bounds.grown(-TOUCH_M).contains_box(bounds)
            || bounds.size().min_element() > WALL_MAX_M
            || eyes.iter().any(|eye| bounds.contains(*eye))
    };
    let mut walls: Vec<bool> = cells.spaces.iter().map(|space| !is_open(&space.bounds)).collect();
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

fn bits(region: &Aabb) -> [[u32; 3]; 2] {
    [region.min, region.max].map(|corner| corner.to_array().map(f32::to_bits))
}

/// Those boxes that are not inside of another.
fn outermost(boxes: &[Aabb]) -> Vec<Aabb> {
    let tree = Bvh::new(boxes);
    let is_inside = |index: u32, region: &Aabb| {
        let middle = Aabb::new(region.centre(), region.centre());
        let found = tree.touching(&middle, |other| {
            let of = &boxes[other as usize];
            let holds = other != index && of.grown(TOUCH_M).contains_box(region);
            // Of two that hold each other, the first stays.
            let is_held = region.grown(TOUCH_M).contains_box(of);
            if holds && (!is_held || other < index) { Break(()) } else { Continue(()) }
        });
        found.is_break()
    };
    let kept = (0..).zip(boxes).filter(|(index, region)| !is_inside(*index, region));
    kept.map(|(_, region)| *region).collect()
}
