//! Sight lines through sequences of gates: what can be seen from a box.
//!
//! A search starts in a space and goes from gate to gate. Each step keeps two boxes: the part of
//! the *source* from which the gate can be seen through those before it, and the part of the gate
//! that can be seen from there, its *pass*. Every line that goes from the source through the pass
//! stays within the half-spaces that separate the two (`separators`); these cut the next gate, and
//! with the roles changed the source. What is left of the next gate is the next step; when nothing
//! is left, no line goes through that sequence. The steps form a *stab tree*.
//!
//! For axial boxes the separating planes are the tangents of their projections along the three
//! axes, so that all is arithmetic on intervals. Gates that are no axial rectangles add the planes
//! through their edges.
//!
//! Open places let a gate be reached by very many sequences. A step whose source and pass lie
//! within those of an earlier step at the same gate shows nothing new, and is dropped; and where a
//! gate has `STEPS_AT_GATE_MAX` steps, further ones are joined: the box around both stands for both.
//! That is larger than either, so nothing is missed, and it bounds the work by the number of gates.

mod exact;
mod eye;
#[cfg(test)]
mod tests;

use std::{cmp::Ordering, collections::BinaryHeap, ops::Range};

use glam::DVec3;

use super::{CellId, Cells, Node, Polygon};
use crate::geometry::Aabb;

/// Gates and sources are widened by this much on each side, in metres: more than what importers
/// and compiler may have moved a surface by rounding, so that what it hides less is not lost.
pub const WIDENING: f64 = 2e-4;
/// A point this close to a plane, in metres, counts as on it, and what is cut keeps it.
const ON_PLANE: f64 = 1e-6;
/// Boxes that are nearer, in metres, have no tangents: they would be defined by rounding alone.
const APART_MIN: f64 = 1e-7;
/// Steps kept apart at one gate.
const STEPS_AT_GATE_MAX: usize = 6;
/// So many sequences to one step are told apart.
const CHAINS_MAX: usize = 6;
/// Longer sequences are looked at from their end.
const CHAIN_MAX: usize = 48;
/// A gate at which joined steps have grown so often takes the whole source and the whole gate.
const JOINS_MAX: u8 = 8;

/// A box in double precision, in metres and own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// The corner with the least coordinates.
    pub min: DVec3,
    /// The corner with the greatest coordinates.
    pub max: DVec3,
}

impl Extent {
    /// A box, grown on every side, in metres.
    pub fn around(region: &Aabb, margin: f64) -> Self {
        Self { min: region.min.as_dvec3() - margin, max: region.max.as_dvec3() + margin }
    }

    fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }

    fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| [self.min[axis], self.max[axis]][i >> axis & 1];
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// How far apart the nearest points of two boxes are, squared.
    fn distance_squared(&self, other: &Self) -> f64 {
        (other.min - self.max).max(self.min - other.max).max(DVec3::ZERO).length_squared()
    }

    /// Cuts off what is outside a half-space, and then whatever of the box is no longer needed to
    /// hold the rest. False when nothing is left.
    fn keep(&mut self, half: &HalfSpace) -> bool {
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        let slack = half.limit + ON_PLANE - nearest.element_sum();
        if slack < 0.0 {
            return false;
        }
        for axis in 0..3 {
            let n = half.normal[axis];
            if n > 1e-12 {
                self.max[axis] = self.max[axis].min(self.min[axis] + slack / n);
            } else if n < -1e-12 {
                self.min[axis] = self.min[axis].max(self.max[axis] + slack / n);
            }
        }
        true
    }

    fn meets(&self, half: &HalfSpace) -> bool {
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        nearest.element_sum() <= half.limit + ON_PLANE
    }
}

/// The points where `normal · point ≤ limit`. The normal has unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Out of it.
    pub normal: DVec3,
    /// In metres.
    pub limit: f64,
}

/// A gate, taken one way.
struct Door {
    to: u32,
    /// Towards `to`.
    normal: DVec3,
    distance: f64,
    bounds: Extent,
    /// For a gate that is no axial rectangle: a point of each edge, and the direction in the
    /// gate's plane that leads out over it.
    edges: Box<[(DVec3, DVec3)]>,
    corners: Box<[DVec3]>,
}

impl Door {
    fn new(polygon: &Polygon, to: u32, sign: f64) -> Self {
        match polygon {
            Polygon::Rectangle { axis, bounds } => {
                let axis = usize::from(*axis);
                let mut normal = DVec3::ZERO;
                normal[axis] = sign;
                let at = f64::from(bounds.min[axis]);
                let mut extent = Extent::around(bounds, WIDENING);
                (extent.min[axis], extent.max[axis]) = (at, at);
                let none = (Box::default(), Box::default());
                Self {
                    to,
                    normal,
                    distance: at * sign,
                    bounds: extent,
                    edges: none.0,
                    corners: none.1,
                }
            }
            Polygon::Other { normal, corners } => Self::slanted(*normal * sign, corners, to),
        }
    }

    fn slanted(normal: DVec3, corners: &[glam::Vec3], to: u32) -> Self {
        let corners: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
        let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
        // Corners are moved outwards by so much that every edge moves by the widening at least,
        // but where two edges meet sharply: there the edges' own planes still do.
        let wide: Vec<DVec3> = corners
            .iter()
            .map(|&c| c + (c - centre).normalize_or_zero() * 4.0 * WIDENING)
            .collect();
        let mut edges = Vec::with_capacity(corners.len());
        for (i, &from) in corners.iter().enumerate() {
            let to = corners[(i + 1) % corners.len()];
            let out = (to - from).cross(normal).normalize_or_zero();
            let out = if out.dot(centre - from) > 0.0 { -out } else { out };
            // An edge too short to have a direction bounds nothing.
            if out != DVec3::ZERO {
                edges.push((from + out * WIDENING, out));
            }
        }
        let (min, max) = (
            wide.iter().fold(DVec3::INFINITY, |a, &b| a.min(b)),
            wide.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b)),
        );
        // Where the corners lie along the normal, and not where the widened ones do.
        let distance = normal.dot(centre);
        let bounds = Extent { min: min - WIDENING, max: max + WIDENING };
        Self { to, normal, distance, bounds, edges: edges.into(), corners: wide.into() }
    }

    /// What is on the near side.
    fn before(&self) -> HalfSpace {
        HalfSpace { normal: self.normal, limit: self.distance }
    }

    /// Whether something has a part on the near side.
    fn is_before(&self, extent: &Extent) -> bool {
        let nearest = (self.normal * extent.min).min(self.normal * extent.max).element_sum();
        nearest < self.distance - ON_PLANE
    }

    /// Whether something has a part on the far side.
    fn is_beyond(&self, extent: &Extent) -> bool {
        let farthest = (self.normal * extent.min).max(self.normal * extent.max).element_sum();
        farthest > self.distance + ON_PLANE
    }
}

/// A few half-spaces. Kept without heap memory: a search makes millions.
struct HalfSpaces {
    all: [HalfSpace; Self::MAX],
    count: usize,
}

impl HalfSpaces {
    /// Six tangents, and the edges of a gate; those beyond are left out, which cuts less.
    const MAX: usize = 24;

    const fn none() -> Self {
        Self { all: [HalfSpace { normal: DVec3::ZERO, limit: 0.0 }; Self::MAX], count: 0 }
    }

    fn push(&mut self, half: HalfSpace) {
        if let Some(place) = self.all.get_mut(self.count) {
            *place = half;
            self.count += 1;
        }
    }

    fn as_slice(&self) -> &[HalfSpace] {
        &self.all[..self.count]
    }

    fn cut(&self, extent: &mut Extent) -> bool {
        self.as_slice().iter().all(|half| extent.keep(half))
    }

    fn meet(&self, extent: &Extent) -> bool {
        self.as_slice().iter().all(|half| extent.meets(half))
    }
}

/// The half-spaces that every line from a box through another stays in, from the second on: those
/// with the first on the outside or the boundary, and the second inside or on the boundary.
fn separators(source: &Extent, pass: &Extent, found: &mut HalfSpaces) {
    found.count = 0;
    for (u, v) in [(0, 1), (1, 2), (2, 0)] {
        // The axis along which the projections are furthest apart.
        let gap = |axis: usize| {
            (pass.min[axis] - source.max[axis]).max(source.min[axis] - pass.max[axis])
        };
        let (along, across) = if gap(u) >= gap(v) { (u, v) } else { (v, u) };
        if gap(along) > APART_MIN {
            tangents(source, pass, along, across, found);
        }
    }
}

/// The two lines that touch both of two rectangles and pass between them; the rectangles are the
/// projections of two boxes that are apart on the axis `along`.
fn tangents(source: &Extent, pass: &Extent, along: usize, across: usize, found: &mut HalfSpaces) {
    let is_ahead = pass.min[along] > source.max[along];
    // As if `pass` were always on the greater side.
    let sign = if is_ahead { 1.0 } else { -1.0 };
    let near_far = |extent: &Extent| {
        if is_ahead {
            (extent.min[along], extent.max[along])
        } else {
            (-extent.max[along], -extent.min[along])
        }
    };
    let ((source_near, source_far), (pass_near, pass_far)) = (near_far(source), near_far(pass));
    // Above: from the lowest of the source to the highest of the pass, as steeply as can be; and
    // the same below, upside down.
    for up in [1.0, -1.0] {
        let (low, high) = if up > 0.0 {
            (source.min[across], pass.max[across])
        } else {
            (-source.max[across], -pass.min[across])
        };
        let rise = high - low;
        let (run, at) = if rise >= 0.0 {
            (pass_near - source_far, pass_near)
        } else {
            (pass_far - source_near, pass_far)
        };
        let slope = rise / run;
        let scale = 1.0 / (1.0 + slope * slope).sqrt();
        let mut normal = DVec3::ZERO;
        normal[along] = -slope * sign * scale;
        normal[across] = up * scale;
        found.push(HalfSpace { normal, limit: (high - slope * at) * scale });
    }
}

/// Likewise, through the edges of a gate that is no axial rectangle.
fn edge_separators(source: &Extent, door: &Door, normal: DVec3, found: &mut HalfSpaces) {
    if door.edges.is_empty() {
        return;
    }
    let corners = source.corners();
    for &(point, out) in &door.edges {
        let heights = corners.map(|c| ((c - point).dot(out), (c - point).dot(normal)));
        let lean = least_lean(&heights);
        if lean.is_finite() {
            let normal = (out + normal * lean).normalize();
            found.push(HalfSpace { normal, limit: normal.dot(point) });
        }
    }
}

/// The plane through an edge that leans outwards by this for each metre beyond the gate touches a
/// box: as little as can be. Given are the heights of the box's corners over the edge, outwards and
/// beyond the gate. Not finite when there is none.
fn least_lean(heights: &[(f64, f64); 8]) -> f64 {
    let mut lean = f64::INFINITY;
    for (corner, &(out, beyond)) in heights.iter().enumerate() {
        if beyond < -APART_MIN {
            lean = lean.min(out / -beyond);
        } else if out < ON_PLANE {
            return f64::NEG_INFINITY;
        } else {
            // The box may come to the gate within the edge all the same.
            for bit in [1, 2, 4] {
                let (other_out, other) = heights[corner ^ bit];
                if other < -APART_MIN
                    && out - (out - other_out) * beyond / (beyond - other) < ON_PLANE
                {
                    return f64::NEG_INFINITY;
                }
            }
        }
    }
    lean
}

/// A step of a search: a line from `source` came through `pass`, a part of a gate.
#[derive(Clone, Copy, Debug)]
struct Step {
    /// A later step at the same door shows all that this one does.
    is_covered: bool,
    /// It goes through a gate of the source's own space.
    is_first: bool,
    /// The steps before: none when it is the first, or stands for too many sequences.
    parents: Parents,
    door: u32,
    source: Extent,
    pass: Extent,
}

/// The steps that come before a step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Parents {
    steps: [u32; Self::MAX],
    count: u8,
}

impl Parents {
    const MAX: usize = 4;
    const NONE: Self = Self { steps: [0; Self::MAX], count: 0 };

    fn one(step: u32) -> Self {
        Self { steps: [step; Self::MAX], count: 1 }
    }

    fn as_slice(&self) -> &[u32] {
        &self.steps[..usize::from(self.count)]
    }

    /// Adds others to what is not none; too many are none.
    fn add(&mut self, others: &Self) {
        if others.count == 0 {
            *self = Self::NONE;
        }
        for &step in others.as_slice() {
            if self.count == 0 || self.as_slice().contains(&step) {
                continue;
            }
            match self.steps.get_mut(usize::from(self.count)) {
                Some(place) => {
                    *place = step;
                    self.count += 1;
                }
                None => *self = Self::NONE,
            }
        }
    }
}

/// A step that waits; the one nearest to the source goes first.
struct Waiting {
    distance: f64,
    step: u32,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        other.distance.total_cmp(&self.distance).then(other.step.cmp(&self.step))
    }
}

/// What a search needs memory for; kept from one search to the next.
#[derive(Default)]
pub struct Scratch {
    steps: Vec<Step>,
    waiting: BinaryHeap<Waiting>,
    /// For each door, its steps and how often they were joined; those with `touched` hold some.
    at_door: Vec<AtDoor>,
    touched: Vec<u32>,
    /// For each part of the source and each cell, or for each space, the last search that found it.
    seen: Vec<u32>,
    allowed: Vec<u32>,
    /// For each block, the last search that found all of it from all parts of the source.
    full: Vec<u32>,
    search: u32,
    chains: Chains,
    room: Vec<Extent>,
    room_of_eye: eye::Room,
}

/// What a line has to meet along a sequence of steps, and which way it goes.
#[derive(Default)]
struct Chain {
    met: Vec<Extent>,
    signs: exact::Signs,
    /// All of the gates on the way; axial rectangles when `is_whole`, from the source on.
    gates: Vec<Extent>,
    is_whole: bool,
    /// The step to go on with.
    next: Option<u32>,
}

/// Chains, of which the first `count` are in use.
#[derive(Default)]
struct Chains {
    all: Vec<Chain>,
    count: usize,
}

impl Chains {
    fn begin(&mut self, set: impl FnOnce(&mut Chain)) {
        if self.all.is_empty() {
            self.all.resize_with(CHAINS_MAX, Chain::default);
        }
        self.count = 1;
        set(&mut self.all[0]);
    }

    /// Adds a copy of a chain that goes on with a step.
    fn split(&mut self, index: usize, next: u32) {
        let (head, tail) = self.all.split_at_mut(self.count);
        let (from, to) = (&head[index], &mut tail[0]);
        to.met.clone_from(&from.met);
        to.gates.clone_from(&from.gates);
        to.is_whole = from.is_whole;
        to.signs = from.signs;
        to.next = Some(next);
        self.count += 1;
    }
}

#[derive(Clone, Default)]
struct AtDoor {
    steps: Vec<u32>,
    joins: u8,
}

/// What a search is for.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    /// The space that the source lies in.
    pub space: u32,
    /// From where one looks, widened already.
    pub source: Extent,
    /// No other spaces are looked into; all when absent.
    pub spaces: Option<&'a [u32]>,
    /// What is seen lies within all of these.
    pub frustum: &'a [HalfSpace],
}

impl Query<'_> {
    fn holds(&self, target: &Extent) -> bool {
        self.frustum.iter().all(|half| target.meets(half))
    }
}

/// A search with several sources, and what it has found.
struct Look<'a, 'b> {
    query: &'a Query<'b>,
    sources: &'a [Extent],
    found: &'a mut [Vec<u32>],
    scratch: &'a mut Scratch,
    halves: HalfSpaces,
}

impl Look<'_, '_> {
    fn index(&self, source: usize, cell: u32) -> u32 {
        cell * self.sources.len() as u32 + source as u32
    }

    fn has_seen(&self, source: usize, cell: u32) -> bool {
        self.scratch.has_seen(self.index(source, cell))
    }

    fn see(&mut self, source: usize, cell: u32) {
        let index = self.index(source, cell);
        if self.scratch.see(index) {
            self.found[source].push(cell);
        }
    }
}

/// Cells of one space that lie close together.
#[derive(Clone, Debug)]
pub struct Block {
    /// The smallest box around them, widened.
    pub bounds: Extent,
    /// Indices into [`Cells::cells`].
    pub cells: Range<u32>,
    /// Index into [`Cells::spaces`].
    pub space: u32,
}

/// The most cells in a block.
const BLOCK_CELLS_MAX: u32 = 8;

/// The blocks that the subtrees of the tree make.
fn blocks(cells: &Cells, targets: &[Extent]) -> Vec<Block> {
    let mut blocks = Vec::new();
    if let Some(all) = block(cells, targets, 0, &mut blocks) {
        blocks.push(all);
    }
    blocks.sort_unstable_by_key(|block| block.cells.start);
    blocks
}

/// The cells of a subtree as one block, if they make one; else adds those blocks that they make.
fn block(cells: &Cells, targets: &[Extent], node: u32, found: &mut Vec<Block>) -> Option<Block> {
    let sides = match cells.tree[node as usize] {
        Node::Solid => return None,
        Node::Leaf(CellId(cell)) => {
            let space = cells.cells[cell as usize].space;
            let bounds = targets[cell as usize];
            return Some(Block { bounds, cells: cell..cell + 1, space });
        }
        Node::Axial { sides, .. } | Node::Plane { sides, .. } => sides,
    };
    let [lesser, greater] = sides.map(|side| block(cells, targets, side, found));
    if let (Some(lesser), Some(greater)) = (&lesser, &greater) {
        let bounds = lesser.bounds.union(&greater.bounds);
        if lesser.space == greater.space
            && lesser.cells.end == greater.cells.start
            && greater.cells.end - lesser.cells.start <= BLOCK_CELLS_MAX
        {
            let cells = lesser.cells.start..greater.cells.end;
            return Some(Block { bounds, cells, space: lesser.space });
        }
    }
    found.extend(lesser.into_iter().chain(greater));
    None
}

/// A building's gates, ready for searches.
pub struct Sightlines<'a> {
    cells: &'a Cells,
    /// Two for each gate: `2i` leads to its greater side, `2i + 1` to its lesser side.
    doors: Vec<Door>,
    targets: Vec<Extent>,
    blocks: Vec<Block>,
    /// For each space, its blocks.
    blocks_of: Vec<Range<u32>>,
}

impl<'a> Sightlines<'a> {
    /// Prepares the gates of a subdivision.
    pub fn new(cells: &'a Cells) -> Self {
        let doors = cells
            .gates
            .iter()
            .flat_map(|gate| {
                let [lesser, greater] = gate.spaces;
                [Door::new(&gate.polygon, greater, 1.0), Door::new(&gate.polygon, lesser, -1.0)]
            })
            .collect();
        let targets: Vec<Extent> =
            cells.cells.iter().map(|cell| Extent::around(&cell.bounds, WIDENING)).collect();
        let blocks = blocks(cells, &targets);
        let starting = |cell: u32| blocks.partition_point(|block| block.cells.start < cell) as u32;
        let blocks_of = cells
            .spaces
            .iter()
            .map(|space| starting(space.cells.start)..starting(space.cells.end))
            .collect();
        Self { cells, doors, targets, blocks, blocks_of }
    }

    /// The doors out of a space.
    fn doors_of(&self, space: u32) -> impl Iterator<Item = u32> + '_ {
        self.cells.spaces[space as usize].gates.iter().map(move |&gate| {
            let is_lesser = self.cells.gates[gate as usize].spaces[0] == space;
            gate * 2 + u32::from(!is_lesser)
        })
    }

    /// The spaces of which some point may be visible from some point of the source: its own first.
    pub fn spaces(&self, scratch: &mut Scratch, query: &Query<'_>) -> Vec<u32> {
        scratch.begin(self, 1, query);
        let mut found = vec![query.space];
        scratch.see(query.space);
        self.search(scratch, query);
        for step in 0..scratch.steps.len() {
            let space = self.doors[scratch.steps[step].door as usize].to;
            if scratch.see(space) {
                found.push(space);
            }
        }
        found
    }

    /// The cells of which some point may be visible from some point of the source.
    pub fn cells(&self, scratch: &mut Scratch, query: &Query<'_>) -> Vec<u32> {
        let mut found = [Vec::new()];
        self.look(scratch, query, &[query.source], &mut found);
        let [found] = found;
        found
    }

    /// For each cell of a block, the cells of which some point may be visible from some point of it.
    /// Only the given spaces are looked into.
    pub fn rows(&self, scratch: &mut Scratch, block: &Block, spaces: &[u32]) -> Vec<Vec<u32>> {
        let Block { bounds, ref cells, space } = *block;
        let query = Query { space, source: bounds, spaces: Some(spaces), frustum: &[] };
        let sources: Vec<Extent> = cells.clone().map(|cell| self.targets[cell as usize]).collect();
        let mut found = vec![Vec::new(); sources.len()];
        self.look(scratch, &query, &sources, &mut found);
        found
    }

    /// The cells, in blocks that lie close together and see much the same.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Finds, for each of some parts of a query's source, the cells that it may see.
    fn look(
        &self,
        scratch: &mut Scratch,
        query: &Query<'_>,
        sources: &[Extent],
        found: &mut [Vec<u32>],
    ) {
        scratch.begin(self, sources.len(), query);
        let mut look = Look { query, sources, found, scratch, halves: HalfSpaces::none() };
        for cell in self.cells.spaces[query.space as usize].cells.clone() {
            if query.holds(&self.targets[cell as usize]) {
                (0..sources.len()).for_each(|source| look.see(source, cell));
            }
        }
        self.search(look.scratch, query);
        let (mut halves, mut back) = (HalfSpaces::none(), HalfSpaces::none());
        for index in 0..look.scratch.steps.len() {
            let step = look.scratch.steps[index];
            if step.is_covered {
                continue;
            }
            let gate = &self.doors[step.door as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            let mut is_gathered = false;
            for number in self.blocks_of[gate.to as usize].clone() {
                let block = &self.blocks[number as usize];
                if look.scratch.full[number as usize] == look.scratch.search
                    || !halves.meet(&block.bounds)
                    || !query.holds(&block.bounds)
                {
                    continue;
                }
                // And the other way round: from the block through the gate to the source.
                separators(&block.bounds, &step.pass, &mut back);
                let mut source = step.source;
                if !back.cut(&mut source) {
                    continue;
                }
                if !std::mem::replace(&mut is_gathered, true) {
                    self.gather(look.scratch, &step);
                }
                if look.scratch.is_stabbed(&source, &block.bounds) {
                    self.look_at(&mut look, &step, &source, number);
                }
            }
        }
    }

    /// Finds which parts of the source may see which cells of a block by a step that shows some of
    /// the block to some of the source.
    fn look_at(&self, look: &mut Look<'_, '_>, step: &Step, source: &Extent, number: u32) {
        let block = &self.blocks[number as usize];
        if look.sources.len() == 1 && block.cells.len() == 1 {
            look.see(0, block.cells.start);
            return;
        }
        let gate = &self.doors[step.door as usize];
        let is_open = look.query.frustum.is_empty()
            && look.scratch.is_open(&look.query.source, &block.bounds);
        let mut all = true;
        for index in 0..look.sources.len() {
            if is_open {
                block.cells.clone().for_each(|cell| look.see(index, cell));
                continue;
            }
            let mut part = look.sources[index];
            part.min = part.min.max(source.min);
            part.max = part.max.min(source.max);
            if !part.min.cmple(part.max).all() {
                all = false;
                continue;
            }
            separators(&part, &step.pass, &mut look.halves);
            edge_separators(&part, gate, gate.normal, &mut look.halves);
            for cell in block.cells.clone() {
                if look.has_seen(index, cell) {
                    continue;
                }
                let target = &self.targets[cell as usize];
                if look.halves.meet(target)
                    && look.query.holds(target)
                    && look.scratch.is_stabbed(&part, target)
                {
                    look.see(index, cell);
                } else {
                    all = false;
                }
            }
        }
        if all {
            look.scratch.full[number as usize] = look.scratch.search;
        }
    }

    /// Finds all steps.
    fn search(&self, scratch: &mut Scratch, query: &Query<'_>) {
        let mut halves = HalfSpaces::none();
        for door in self.doors_of(query.space) {
            let gate = &self.doors[door as usize];
            let mut source = query.source;
            if gate.is_before(&source) && source.keep(&gate.before()) {
                let step = Step {
                    is_covered: false,
                    is_first: true,
                    parents: Parents::NONE,
                    door,
                    source,
                    pass: gate.bounds,
                };
                self.add(scratch, query, step);
            }
        }
        while let Some(Waiting { step: index, .. }) = scratch.waiting.pop() {
            let step = scratch.steps[index as usize];
            if step.is_covered {
                continue;
            }
            let gate = &self.doors[step.door as usize];
            separators(&step.source, &step.pass, &mut halves);
            edge_separators(&step.source, gate, gate.normal, &mut halves);
            for next in self.doors_of(gate.to) {
                if next != step.door ^ 1
                    && let Some(next) = self.step(index, &step, next, &halves)
                {
                    self.add(scratch, query, next);
                }
            }
        }
    }

    /// Lists, for every sequence of steps that ends with the given one, what a line must meet to get
    /// along it. Where there are too many sequences, their beginnings are left out.
    fn gather(&self, scratch: &mut Scratch, last: &Step) {
        let Scratch { steps, chains, .. } = scratch;
        let begin = |chain: &mut Chain| {
            chain.met.clear();
            chain.gates.clear();
            chain.is_whole = true;
            chain.signs = [None; 3];
            chain.next = None;
            self.put(chain, last);
        };
        chains.begin(begin);
        let mut index = 0;
        // Chains split where steps have several parents.
        while index < chains.count {
            let mut step = *last;
            if let Some(next) = chains.all[index].next.take() {
                step = steps[next as usize];
                self.put(&mut chains.all[index], &step);
            }
            // Boxes are larger than what they stand for: steps can seem to come back.
            loop {
                let (&first, others) = match step.parents.as_slice() {
                    [first, others @ ..]
                        if chains.count + others.len() <= CHAINS_MAX
                            && chains.all[index].met.len() < CHAIN_MAX =>
                    {
                        (first, others)
                    }
                    none => {
                        let chain = &mut chains.all[index];
                        chain.met.push(step.source);
                        chain.is_whole &= none.is_empty() && step.is_first;
                        break;
                    }
                };
                for &other in others {
                    chains.split(index, other);
                }
                step = steps[first as usize];
                self.put(&mut chains.all[index], &step);
            }
            index += 1;
        }
    }

    fn put(&self, chain: &mut Chain, step: &Step) {
        chain.met.push(step.pass);
        let door = &self.doors[step.door as usize];
        chain.gates.push(door.bounds);
        chain.is_whole &= door.edges.is_empty();
        let normal = door.normal;
        for axis in 0..3 {
            if normal[axis].abs() == 1.0 {
                chain.signs[axis] = Some(normal[axis] > 0.0);
            }
        }
    }

    /// What of the next gate can be seen through the last one, and from where; none when nothing.
    fn step(&self, index: u32, last: &Step, door: u32, halves: &HalfSpaces) -> Option<Step> {
        let (gate, before) = (&self.doors[door as usize], &self.doors[last.door as usize]);
        let (mut pass, mut source) = (gate.bounds, last.source);
        if !gate.is_before(&source)
            || !gate.is_before(&last.pass)
            || !before.is_beyond(&pass)
            || !halves.cut(&mut pass)
        {
            return None;
        }
        if !gate.corners.is_empty() && !cut_polygon(&gate.corners, halves, &mut pass) {
            return None;
        }
        let mut back = HalfSpaces::none();
        separators(&pass, &last.pass, &mut back);
        edge_separators(&pass, before, -before.normal, &mut back);
        back.push(gate.before());
        back.push(before.before());
        let parents = Parents::one(index);
        back.cut(&mut source).then_some(Step {
            is_covered: false,
            is_first: false,
            parents,
            door,
            source,
            pass,
        })
    }

    /// Adds a step, unless it shows nothing new.
    fn add(&self, scratch: &mut Scratch, query: &Query<'_>, mut step: Step) {
        let door = &self.doors[step.door as usize];
        if query.spaces.is_some() && scratch.allowed[door.to as usize] != scratch.search
            || query.frustum.iter().any(|half| !step.pass.meets(half))
        {
            return;
        }
        if scratch.has_known(&step) {
            return;
        }
        let at = &mut scratch.at_door[step.door as usize];
        if at.steps.is_empty() {
            scratch.touched.push(step.door);
        }
        if at.steps.len() >= STEPS_AT_GATE_MAX {
            at.joins += 1;
            for other in at.steps.drain(..) {
                let other = &mut scratch.steps[other as usize];
                other.is_covered = true;
                step.parents.add(&other.parents);
                step.source = step.source.union(&other.source);
                step.pass = step.pass.union(&other.pass);
            }
            if at.joins > JOINS_MAX {
                step.pass = door.bounds;
                step.source = query.source;
                step.parents = Parents::NONE;
            }
        }
        let index = scratch.steps.len() as u32;
        at.steps.push(index);
        scratch.steps.push(step);
        let distance = query.source.distance_squared(&step.pass);
        scratch.waiting.push(Waiting { distance, step: index });
    }
}

/// Whether every line from a box to another goes through a gate, an axial rectangle between them.
fn is_between(source: &Extent, gate: &Extent, target: &Extent) -> bool {
    let Some(axis) = (0..3).find(|&axis| gate.min[axis] == gate.max[axis]) else { return false };
    let at = gate.min[axis];
    let is_ahead = target.min[axis] + target.max[axis] > source.min[axis] + source.max[axis];
    // The near and the far side of each, as distances from the gate.
    let (source_far, source_near, target_near, target_far) = if is_ahead {
        (at - source.min[axis], at - source.max[axis], target.min[axis] - at, target.max[axis] - at)
    } else {
        (source.max[axis] - at, source.min[axis] - at, at - target.max[axis], at - target.min[axis])
    };
    if source_near < -2.0 * WIDENING || target_near < -2.0 * WIDENING {
        return false;
    }
    let ways = [source_near.max(0.0), source_far].into_iter().flat_map(|before| {
        [target_near.max(0.0), target_far].map(|beyond| before / (before + beyond).max(1e-9))
    });
    ways.into_iter().all(|share| {
        let low = source.min.lerp(target.min, share);
        let high = source.max.lerp(target.max, share);
        let within = low.cmpge(gate.min) & high.cmple(gate.max);
        (0..3).all(|other| other == axis || within.test(other))
    })
}

/// Cuts a box about a polygon to what holds the polygon's part within some half-spaces; false when
/// there is none.
fn cut_polygon(corners: &[DVec3], halves: &HalfSpaces, around: &mut Extent) -> bool {
    let mut polygon = corners.to_vec();
    let mut kept = Vec::with_capacity(polygon.len() + 2);
    for half in halves.as_slice() {
        let height = |p: DVec3| half.normal.dot(p) - half.limit - ON_PLANE;
        kept.clear();
        for (i, &here) in polygon.iter().enumerate() {
            let next = polygon[(i + 1) % polygon.len()];
            let (a, b) = (height(here), height(next));
            if a <= 0.0 {
                kept.push(here);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                kept.push(here.lerp(next, a / (a - b)));
            }
        }
        std::mem::swap(&mut polygon, &mut kept);
        if polygon.is_empty() {
            return false;
        }
    }
    let min = polygon.iter().fold(DVec3::INFINITY, |a, &b| a.min(b)) - WIDENING;
    let max = polygon.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b)) + WIDENING;
    *around = Extent { min: around.min.max(min), max: around.max.min(max) };
    around.min.cmple(around.max).all()
}

impl Scratch {
    /// Makes ready for a search.
    fn begin(&mut self, lines: &Sightlines<'_>, sources: usize, query: &Query<'_>) {
        let (doors, spaces) = (lines.doors.len(), lines.cells.spaces.len());
        let seen = (sources * lines.cells.cells.len()).max(spaces);
        for door in self.touched.drain(..) {
            let at = &mut self.at_door[door as usize];
            at.steps.clear();
            at.joins = 0;
        }
        self.at_door.resize(doors.max(self.at_door.len()), AtDoor::default());
        self.seen.resize(seen.max(self.seen.len()), 0);
        self.allowed.resize(spaces.max(self.allowed.len()), 0);
        self.full.resize(lines.blocks.len().max(self.full.len()), 0);
        self.steps.clear();
        self.waiting.clear();
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.seen.fill(0);
            self.allowed.fill(0);
            self.full.fill(0);
            self.search = 1;
        }
        for &space in query.spaces.unwrap_or_default() {
            self.allowed[space as usize] = self.search;
        }
    }

    /// Whether a step shows nothing new, because another step at its door does. That one then stands
    /// for both sequences.
    fn has_known(&mut self, step: &Step) -> bool {
        let at = &self.at_door[step.door as usize];
        let holds = |of: &&u32| {
            let of = &self.steps[**of as usize];
            of.source.contains(&step.source) && of.pass.contains(&step.pass)
        };
        let Some(&index) = at.steps.iter().find(holds) else { return false };
        let of = &mut self.steps[index as usize];
        of.parents.add(&step.parents);
        true
    }

    /// Whether some line that meets all that was gathered meets a target too.
    fn is_stabbed(&mut self, source: &Extent, target: &Extent) -> bool {
        let mut certain: exact::Signs = [None; 3];
        for (axis, sign) in certain.iter_mut().enumerate() {
            if target.min[axis] > source.max[axis] {
                *sign = Some(true);
            } else if target.max[axis] < source.min[axis] {
                *sign = Some(false);
            }
        }
        let towards = (target.min + target.max) - (source.min + source.max);
        let Self { chains, room, .. } = self;
        chains.all[..chains.count].iter_mut().any(|chain| {
            let signs = [0, 1, 2].map(|axis| chain.signs[axis].or(certain[axis]));
            chain.met.extend([*source, *target]);
            let is_stabbed = exact::is_stabbed(&chain.met, signs, towards, room);
            chain.met.truncate(chain.met.len() - 2);
            is_stabbed
        })
    }

    /// Whether every line from a source to a target goes along one of the sequences gathered.
    fn is_open(&self, source: &Extent, target: &Extent) -> bool {
        self.chains.all[..self.chains.count].iter().any(|chain| {
            chain.is_whole && chain.gates.iter().all(|gate| is_between(source, gate, target))
        })
    }

    fn has_seen(&self, index: u32) -> bool {
        self.seen[index as usize] == self.search
    }

    /// Notes that something is seen; false when it is known.
    fn see(&mut self, index: u32) -> bool {
        !self.has_seen(index) && {
            self.seen[index as usize] = self.search;
            true
        }
    }
}
