//! The cells of an area, and the boxes that they make.
//!
//! The boxes of a room are unions of whole cells: every cell in a box belongs to the room. A box
//! grows from the largest cell of the area, side by side. It grows as long as most of what is added
//! belongs to the area, and no cell of another area and no cell that is not a box gets into it.
//! Solid space does not count.

use std::collections::HashMap;

use sightline_world::{
    Cell, CellId, Cells, Node, World, geometry::Aabb, tolerance::CELL_OVERLAP_M,
};

use super::areas::{Areas, Ground};

/// [`CELL_OVERLAP_M`] in single precision.
const TOUCH_M: f32 = CELL_OVERLAP_M as f32;
/// At least this share of what a box grows by belongs to the area.
const FILL_MIN: f32 = 0.5;
/// The most boxes of a room …
const BOXES_MAX: usize = 12;
/// … and the least share of the area for every box but the first.
const PART_MIN: f32 = 0.06;
/// The height above the floor at which cells belong to areas, in metres.
const CUT_M: f32 = 1.3;
/// A cell belongs to a storey when it begins no farther below the floor, in metres.
const BELOW_M: f32 = 0.5;

/// A room that is being made.
pub(super) struct Extent {
    pub(super) boxes: Vec<Aabb>,
    pub(super) cells: Vec<CellId>,
}

/// The rooms of a storey between two heights. Taken cells belong to rooms of lower storeys.
pub(super) fn rooms(
    world: &World,
    areas: &Areas,
    heights: [f32; 2],
    taken: &[Option<usize>],
) -> Vec<Extent> {
    let cells = &world.cells;
    let is_box = boxes_among(cells);
    let [feet, above] = heights;
    let is_cut =
        |cell: &Cell| cell.bounds.min.y <= feet + CUT_M && cell.bounds.max.y > feet + CUT_M;
    let mut by_label: Vec<Vec<CellId>> = vec![Vec::new(); areas.count];
    let mut grounds: HashMap<CellId, Ground> = HashMap::new();
    for (cell, id) in cells.cells.iter().zip((0..).map(CellId)) {
        let is_free = is_box[id.0 as usize] && taken[id.0 as usize].is_none();
        let is_here = (feet - BELOW_M..above).contains(&cell.bounds.min.y);
        if is_free && is_here {
            let ground = areas.under(&cell.bounds);
            grounds.insert(id, ground);
            if let Ground::Area(label) = ground
                && is_cut(cell)
            {
                by_label[label as usize].push(id);
            }
        }
    }
    let grower = Grower { cells, grounds: &grounds, feet };
    by_label.into_iter().zip(0..).filter_map(|(own, label)| grower.grow(own, label)).collect()
}

/// Which cells fill their boxes.
fn boxes_among(cells: &Cells) -> Vec<bool> {
    let mut is_box = vec![true; cells.cells.len()];
    let mut left = vec![(0u32, Vec::new())];
    while let Some((node, planes)) = left.pop() {
        match &cells.tree[node as usize] {
            Node::Solid => (),
            Node::Axial { sides, .. } => left.extend(sides.map(|side| (side, planes.clone()))),
            Node::Plane { normal, distance, sides } => {
                let mut planes = planes;
                planes.push((*normal, *distance));
                left.extend(sides.map(|side| (side, planes.clone())));
            }
            Node::Leaf(cell) => {
                let bounds = &cells.cells[cell.0 as usize].bounds;
                let cuts = |(normal, distance): &(glam::DVec3, f64)| {
                    let ahead = normal.dot(bounds.centre().as_dvec3()) - distance;
                    ahead.abs() < normal.abs().dot(bounds.size().as_dvec3() * 0.5) - CELL_OVERLAP_M
                };
                is_box[cell.0 as usize] = !planes.iter().any(cuts);
            }
        }
    }
    is_box
}

struct Grower<'a> {
    cells: &'a Cells,
    /// What is under each cell that may belong to a room of this storey.
    grounds: &'a HashMap<CellId, Ground>,
    feet: f32,
}

impl Grower<'_> {
    fn bounds(&self, cell: CellId) -> &Aabb {
        &self.cells.cells[cell.0 as usize].bounds
    }

    /// The boxes of an area, given its cells.
    fn grow(&self, mut own: Vec<CellId>, label: u32) -> Option<Extent> {
        let all: f32 = own.iter().map(|cell| volume(self.bounds(*cell))).sum();
        let mut extent = Extent { boxes: Vec::new(), cells: Vec::new() };
        while extent.boxes.len() < BOXES_MAX {
            let size = |cell: &&CellId| volume(self.bounds(**cell));
            let largest = own.iter().max_by(|a, b| size(a).total_cmp(&size(b)).then(b.cmp(a)));
            let Some(seed) = largest else { break };
            let seed = *seed;
            let Some((region, inside)) = self.box_from(seed, label, &extent) else {
                own.retain(|cell| *cell != seed);
                continue;
            };
            own.retain(|cell| !inside.contains(cell));
            if !extent.boxes.is_empty() && volume(&region) < all * PART_MIN {
                continue;
            }
            extent.boxes.push(region);
            extent.cells.extend(inside);
        }
        extent.cells.sort_unstable();
        debug_assert!(extent.cells.is_sorted_by(|a, b| a < b), "a cell is in one box only");
        (!extent.boxes.is_empty()).then_some(extent)
    }

    /// The box that grows around a cell, and all cells in it.
    fn box_from(&self, seed: CellId, label: u32, extent: &Extent) -> Option<(Aabb, Vec<CellId>)> {
        let (mut region, mut inside) = self.closed(*self.bounds(seed), label, extent)?;
        loop {
            let next = (0..6).find_map(|side| self.grown(&region, side, label, extent));
            let Some((larger, cells)) = next else { return Some((region, inside)) };
            (region, inside) = (larger, cells);
        }
    }

    /// The box grown on one side by the least step there, if most of that belongs to the area.
    fn grown(
        &self,
        region: &Aabb,
        side: usize,
        label: u32,
        extent: &Extent,
    ) -> Option<(Aabb, Vec<CellId>)> {
        let (axis, is_max) = (side % 3, side >= 3);
        let face = if is_max { region.max[axis] } else { region.min[axis] };
        let mut slab = *region;
        if is_max {
            (slab.min[axis], slab.max[axis]) = (face, face + 2.0 * TOUCH_M);
        } else {
            (slab.min[axis], slab.max[axis]) = (face - 2.0 * TOUCH_M, face);
        }
        let near = self.overlapping(&slab);
        let to = near.iter().filter(|cell| self.is_own(**cell, label)).map(|cell| {
            let bounds = self.bounds(*cell);
            if is_max { bounds.max[axis] } else { bounds.min[axis] }
        });
        let to = if is_max { to.reduce(f32::min) } else { to.reduce(f32::max) }?;
        let mut larger = *region;
        if is_max {
            larger.max[axis] = to;
        } else {
            larger.min[axis] = to;
        }
        let (larger, inside) = self.closed(larger, label, extent)?;
        let own = inside.iter().filter(|cell| self.is_own(**cell, label)).map(|cell| {
            let shared = self.bounds(*cell);
            volume(shared) - volume(&shared.intersection(region))
        });
        let added = volume(&larger) - volume(region);
        (own.sum::<f32>() >= FILL_MIN * added).then_some((larger, inside))
    }

    /// The smallest box around a box that cuts no cell, and the cells in it. None when it would
    /// contain a cell that it may not have.
    fn closed(&self, region: Aabb, label: u32, extent: &Extent) -> Option<(Aabb, Vec<CellId>)> {
        let mut region = region;
        loop {
            let inside = self.overlapping(&region);
            if inside.iter().any(|cell| !self.may_have(*cell, label) || extent.cells.contains(cell))
            {
                return None;
            }
            let larger = inside.iter().fold(region, |all, cell| all.union(self.bounds(*cell)));
            if larger == region {
                return Some((region, inside));
            }
            region = larger;
        }
    }

    fn is_own(&self, cell: CellId, label: u32) -> bool {
        match self.grounds.get(&cell) {
            Some(Ground::Area(known)) => *known == label,
            // A cell above or below furniture belongs to the area around it.
            Some(Ground::Closed) => !self.is_cut(cell),
            _ => false,
        }
    }

    fn may_have(&self, cell: CellId, label: u32) -> bool {
        match self.grounds.get(&cell) {
            Some(Ground::Area(known)) => *known == label,
            Some(Ground::Closed) => true,
            _ => false,
        }
    }

    fn is_cut(&self, cell: CellId) -> bool {
        let bounds = self.bounds(cell);
        bounds.min.y <= self.feet + CUT_M && bounds.max.y > self.feet + CUT_M
    }

    /// The cells that overlap a box.
    fn overlapping(&self, region: &Aabb) -> Vec<CellId> {
        let mut found = Vec::new();
        self.cells.overlapping(&region.grown(-TOUCH_M * 0.5), &mut found);
        found.retain(|cell| self.bounds(*cell).intersection(region).size().min_element() > TOUCH_M);
        found
    }
}

fn volume(region: &Aabb) -> f32 {
    if region.is_empty() { 0.0 } else { region.size().element_product() }
}
