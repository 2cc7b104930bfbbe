//! Whether a shaft is closed: the spaces that its lines can get into, through the gates that it meets.
//!
//! A line from a point `a` of one box to a point `b` of another is at each share `t` of its way in the
//! box that is as far between the two: its corners are theirs, mixed. So it goes only through gates
//! that such a box meets, through one after another with `t` growing, and from side to side as it is
//! directed. A gate that it goes through at `g` narrows both boxes: with `s = 1 / t`, `b = g s - a (s - 1)`,
//! which along each axis is most or least at an end of what `s` can be; and likewise `a`. Where no
//! sequence of gates leads from a space that the first box reaches into to one that the other does,
//! every line is blocked, whatever blocks it: walls that only touch each other, or those of which
//! the insides are open elsewhere.

use glam::{BVec3A, Vec3A, Vec4};

use super::{BoxInSpaces, SightLine};
use sightline_world::{
    Cells, Node, Polygon,
    geometry::Aabb,
    tolerance::{GATE_WIDENING_M, SUM_F32_M},
};

/// The same for shares of the way.
const SLACK: f32 = 1e-6;
/// A gate nearer than this share of the way narrows nothing at its far end.
const NEAR: f32 = 1e-3;
/// A shaft that meets so many gates is open as far as anybody cares.
const GATES_MAX: u32 = 200;
/// A line that goes through so many spaces is not followed further.
const SPACES_MAX: u32 = 64;
/// So many ways into a space are told apart.
const WAYS_MAX: usize = 3;

/// Spaces and gates, ready to be asked. 32 bytes for each side of a gate.
#[derive(Clone, Debug, Default)]
pub(super) struct PortalFlood {
    /// Planes as in [`Cells::tree`], but that leaves are spaces.
    tree: Vec<SpaceNode>,
    /// For each space, where its ways begin; and where the last ones end.
    starts: Vec<u32>,
    ways: Vec<Exit>,
    /// Of those that are along no axis.
    normals: Vec<Vec3A>,
}

#[derive(Clone, Copy, Debug)]
enum SpaceNode {
    Axial { axis: u8, at: f32, sides: [u32; 2] },
    Plane { normal: Vec3A, distance: f32, sides: [u32; 2] },
    Space(u32),
    Solid,
}

/// A box.
#[derive(Clone, Copy, Debug)]
struct SimdBox {
    low: Vec3A,
    high: Vec3A,
}

/// Out of a space: half a cache line.
#[derive(Clone, Copy, Debug)]
struct Exit {
    /// The corners of the box around the gate. The last lanes, as whole numbers, are the space beyond, and where
    /// the way goes.
    low: Vec4,
    high: Vec4,
}

/// Where a way goes: along an axis, down or up, through a gate that fills its box; or else across
/// [`PortalFlood::normals`] at this number less [`AXIAL`].
type ExitDirection = u32;
/// There are so many ways along axes: down and up the first, then the second, then the third.
const AXIAL: ExitDirection = 6;

/// Lines that have come into a space.
#[derive(Clone, Copy, Debug)]
struct FloodStep {
    space: u32,
    /// No line has come there at a lesser share of its way.
    entry_t: f32,
    from: SimdBox,
    to: SimdBox,
    /// Another step into the same space.
    next: Option<u32>,
}

/// What a search keeps memory for.
#[derive(Clone, Debug, Default)]
pub(super) struct FloodScratch {
    search: u32,
    /// For each space, the search that came to it last, and its last step there.
    reached: Vec<(u32, u32)>,
    /// For each space, the last search for which it was a goal.
    goals: Vec<u32>,
    steps: Vec<FloodStep>,
    open: Vec<u32>,
    nodes: Vec<u32>,
    ends: [Vec<u32>; 2],
}

impl PortalFlood {
    pub fn new(cells: &Cells) -> Self {
        let mut passages = Self { tree: tree(cells), ..Self::default() };
        for (index, space) in (0..).zip(&cells.spaces) {
            passages.starts.push(passages.ways.len() as u32);
            for &gate in &space.gates {
                let gate = &cells.gates[gate as usize];
                let is_lesser = gate.spaces[0] == index;
                let towards = match gate.polygon {
                    Polygon::Rectangle { axis, .. } => 2 * u32::from(axis) + u32::from(is_lesser),
                    Polygon::Other { normal, .. } => {
                        let normal = normal.as_vec3a();
                        passages.normals.push(if is_lesser { normal } else { -normal });
                        AXIAL + passages.normals.len() as u32 - 1
                    }
                };
                let beyond = gate.spaces[usize::from(is_lesser)];
                passages.ways.push(Exit::new(&gate.polygon.bounds(), beyond, towards));
            }
        }
        passages.starts.push(passages.ways.len() as u32);
        passages
    }

    /// Whether no line leads from one box to another, in own axes; counts the nodes and gates looked at.
    pub fn are_closed(
        &self,
        steps: &mut FloodScratch,
        from: &Aabb,
        to: &Aabb,
        looked: &mut u32,
    ) -> bool {
        if self.tree.is_empty() {
            return false;
        }
        let [mut starts, mut goals] = std::mem::take(&mut steps.ends);
        self.spaces(from, steps, &mut starts, looked);
        self.spaces(to, steps, &mut goals, looked);
        let is_closed = self.are_apart(
            steps,
            BoxInSpaces { bounds: from, spaces: &starts },
            BoxInSpaces { bounds: to, spaces: &goals },
            looked,
        );
        steps.ends = [starts, goals];
        is_closed
    }

    /// The same for lines that begin and end in some spaces only.
    pub fn are_apart(
        &self,
        steps: &mut FloodScratch,
        from: BoxInSpaces<'_>,
        to: BoxInSpaces<'_>,
        looked: &mut u32,
    ) -> bool {
        if self.tree.is_empty() || from.spaces.is_empty() {
            // Eyes are in no wall; where they seem to be, nothing is known.
            return false;
        }
        steps.begin(self.starts.len());
        to.spaces.iter().for_each(|goal| steps.goals[*goal as usize] = steps.search);
        let starts = from.spaces;
        let (from, to) = (SimdBox::new(from.bounds), SimdBox::new(to.bounds));
        for &space in starts {
            if steps.goals[space as usize] == steps.search {
                return false;
            }
            steps.enter(FloodStep { space, entry_t: 0.0, from, to, next: None });
        }
        let most = *looked + GATES_MAX;
        while let Some(step) = steps.open.pop() {
            let FloodStep { space, entry_t, from, to, .. } = steps.steps[step as usize];
            if *looked > most {
                return false;
            }
            let between = SweptBox::new(&from, &to);
            let (first, end) = (self.starts[space as usize], self.starts[space as usize + 1]);
            *looked += end - first;
            for way in &self.ways[first as usize..end as usize] {
                let (towards, gate) = (way.towards(), way.gate());
                if between.goes(towards, &self.normals)
                    && let Some(shares) = between.meets(&gate, entry_t)
                    && let Some([from, to]) = between.narrowed(&gate, shares)
                {
                    let (space, entry_t) = (way.beyond(), shares[0]);
                    if steps.goals[space as usize] == steps.search {
                        return false;
                    }
                    steps.enter(FloodStep { space, entry_t, from, to, next: None });
                }
            }
        }
        true
    }

    /// Whether gates lead a line from the space that it begins in to the one that it ends in, as far as the boxes
    /// around them tell.
    pub fn is_free_through_gates(&self, line: &SightLine, [start, goal]: [u32; 2]) -> bool {
        let (from, way) = (Vec3A::from(line.from), Vec3A::from(line.to - line.from));
        let inverse = way.recip();
        let (mut space, mut entry_t) = (start, 0.0);
        for _ in 0..SPACES_MAX {
            if space == goal {
                return true;
            }
            let (first, end) = (self.starts[space as usize], self.starts[space as usize + 1]);
            let mut ways = self.ways[first as usize..end as usize].iter();
            let next = ways.find_map(|out| {
                let towards = out.towards();
                let goes = match towards {
                    0..AXIAL => (way[towards as usize / 2] > 0.0) == (towards % 2 == 1),
                    _ => self.normals[(towards - AXIAL) as usize].dot(way) > 0.0,
                };
                if !goes {
                    return None;
                }
                // Along an axis in which the line does not go, both are infinite: it is between them or nowhere.
                let gate = out.gate();
                let (a, b) = ((gate.low - from) * inverse, (gate.high - from) * inverse);
                let first = a.min(b).max_element().max(entry_t);
                let last = a.max(b).min_element().min(1.0);
                (first <= last).then(|| (out.beyond(), first))
            });
            let Some(next) = next else { return false };
            (space, entry_t) = next;
        }
        false
    }

    /// Finds the spaces that a box reaches into; some twice.
    fn spaces(
        &self,
        region: &Aabb,
        steps: &mut FloodScratch,
        found: &mut Vec<u32>,
        looked: &mut u32,
    ) {
        found.clear();
        let (centre, half) = (Vec3A::from(region.centre()), Vec3A::from(region.size() * 0.5));
        let open = &mut steps.nodes;
        open.push(0);
        while let Some(node) = open.pop() {
            *looked += 1;
            let (away, reach, sides) = match self.tree[node as usize] {
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
            if away <= reach + GATE_WIDENING_M {
                open.push(sides[0]);
            }
            if away >= -reach - GATE_WIDENING_M {
                open.push(sides[1]);
            }
        }
    }

    /// In memory, without its own head.
    pub fn bytes(&self) -> usize {
        self.tree.len() * size_of::<SpaceNode>()
            + self.starts.len() * size_of::<u32>()
            + self.ways.len() * size_of::<Exit>()
            + self.normals.len() * size_of::<Vec3A>()
    }
}

/// The tree of cells, cut off where all that is below is of one space.
fn tree(cells: &Cells) -> Vec<SpaceNode> {
    let mut whole: Vec<Option<u32>> = vec![None; cells.tree.len()];
    for (index, node) in cells.tree.iter().enumerate().rev() {
        whole[index] = match *node {
            Node::Leaf(cell) => Some(cells.cells[cell.0 as usize].space),
            Node::Solid => None,
            Node::Axial { sides, .. } | Node::Plane { sides, .. } => {
                let [low, high] = sides.map(|side| whole[side as usize]);
                low.filter(|_| low == high)
            }
        };
    }
    let (mut tree, mut open) = (vec![SpaceNode::Solid], vec![(0, 0)]);
    while let Some((from, to)) = open.pop() {
        let node = cells.tree[from as usize];
        let mut sides_of = |sides: [u32; 2]| {
            let first = tree.len() as u32;
            tree.extend([SpaceNode::Solid; 2]);
            open.extend([(sides[0], first), (sides[1], first + 1)]);
            [first, first + 1]
        };
        tree[to as usize] = match (whole[from as usize], node) {
            (Some(space), _) => SpaceNode::Space(space),
            (None, Node::Axial { axis, at, sides }) => {
                SpaceNode::Axial { axis, at, sides: sides_of(sides) }
            }
            (None, Node::Plane { normal, distance, sides }) => SpaceNode::Plane {
                normal: normal.as_vec3a(),
                distance: distance as f32,
                sides: sides_of(sides),
            },
            (None, Node::Leaf(_) | Node::Solid) => SpaceNode::Solid,
        };
    }
    tree
}

impl Exit {
    fn new(gate: &Aabb, beyond: u32, towards: ExitDirection) -> Self {
        let gate = gate.grown(GATE_WIDENING_M);
        Self {
            low: gate.min.extend(f32::from_bits(beyond)),
            high: gate.max.extend(f32::from_bits(towards)),
        }
    }

    fn gate(&self) -> SimdBox {
        SimdBox { low: Vec3A::from_vec4(self.low), high: Vec3A::from_vec4(self.high) }
    }

    fn beyond(&self) -> u32 {
        self.low.w.to_bits()
    }

    fn towards(&self) -> ExitDirection {
        self.high.w.to_bits()
    }
}

impl FloodScratch {
    fn begin(&mut self, spaces: usize) {
        self.search = self.search.wrapping_add(1);
        if self.search == 0 || self.goals.len() < spaces {
            self.reached = vec![(0, 0); spaces];
            self.goals = vec![0; spaces];
            self.search = 1;
        }
        self.steps.clear();
        self.open.clear();
    }

    /// Takes in lines that have come into a space, unless such have come there before. When they have
    /// come there in many ways, these are joined.
    fn enter(&mut self, step: FloodStep) {
        let known = &mut self.reached[step.space as usize];
        let mut next = (known.0 == self.search).then_some(known.1);
        let (first, mut count) = (next, 0);
        while let Some(place) = next {
            let other = &self.steps[place as usize];
            if other.holds(&step) {
                return;
            }
            (next, count) = (other.next, count + 1);
        }
        match first {
            Some(place) if count >= WAYS_MAX => {
                let joined = &mut self.steps[place as usize];
                joined.entry_t = joined.entry_t.min(step.entry_t);
                joined.from = joined.from.union(&step.from);
                joined.to = joined.to.union(&step.to);
                self.open.push(place);
            }
            _ => {
                let place = self.steps.len() as u32;
                *known = (self.search, place);
                self.steps.push(FloodStep { next: first, ..step });
                self.open.push(place);
            }
        }
    }
}

impl FloodStep {
    /// Whether all lines of another one are among its own.
    fn holds(&self, other: &Self) -> bool {
        self.entry_t <= other.entry_t && self.from.holds(&other.from) && self.to.holds(&other.to)
    }
}

impl SimdBox {
    fn new(region: &Aabb) -> Self {
        Self { low: region.min.into(), high: region.max.into() }
    }

    fn union(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn holds(&self, other: &Self) -> bool {
        (self.low.cmple(other.low) & self.high.cmpge(other.high)).all()
    }
}

/// The boxes between two, by their share of the way: planes that move.
struct SweptBox {
    from: SimdBox,
    to: SimdBox,
    /// By how much the planes move, inverted; never infinite.
    low_inverse: Vec3A,
    high_inverse: Vec3A,
    low_rises: BVec3A,
    high_rises: BVec3A,
    /// For each direction along an axis, whether some line goes there: a bit for each.
    goes: u32,
}

impl SweptBox {
    fn new(from: &SimdBox, to: &SimdBox) -> Self {
        // What moves by less than this does not move.
        let least = Vec3A::splat(1e-9);
        let sane = |by: Vec3A| Vec3A::select(by.abs().cmplt(least), least, by);
        let by = [sane(to.low - from.low), sane(to.high - from.high)];
        let margin = Vec3A::splat(SUM_F32_M);
        let down = (to.low - from.high).cmple(margin).bitmask();
        let up = (to.high - from.low).cmpge(-margin).bitmask();
        // Of each, the bits of the three axes go apart.
        let apart = |bits: u32| bits & 1 | (bits & 2) << 1 | (bits & 4) << 2;
        Self {
            from: *from,
            to: *to,
            low_inverse: by[0].recip(),
            high_inverse: by[1].recip(),
            low_rises: by[0].cmpgt(Vec3A::ZERO),
            high_rises: by[1].cmpgt(Vec3A::ZERO),
            goes: apart(down) | apart(up) << 1,
        }
    }

    /// The least and the greatest share of the way, from some share on, at which a box meets a gate.
    fn meets(&self, gate: &SimdBox, entry_t: f32) -> Option<[f32; 2]> {
        let below = (gate.high - self.from.low) * self.low_inverse;
        let above = (gate.low - self.from.high) * self.high_inverse;
        // The lower planes must not be above the gate, nor the upper ones below it.
        let (all, none) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let first = Vec3A::select(self.low_rises, none, below)
            .max(Vec3A::select(self.high_rises, above, none))
            .max_element()
            .max(entry_t);
        let last = Vec3A::select(self.low_rises, below, all)
            .min(Vec3A::select(self.high_rises, all, above))
            .min_element()
            .min(1.0);
        (first <= last + SLACK).then_some([first - SLACK, last + SLACK])
    }

    /// Whether some line goes this way.
    fn goes(&self, towards: ExitDirection, normals: &[Vec3A]) -> bool {
        if towards < AXIAL {
            return self.goes >> towards & 1 == 1;
        }
        let way = normals[(towards - AXIAL) as usize];
        let most = Vec3A::select(way.cmpgt(Vec3A::ZERO), self.to.high, self.to.low);
        let least = Vec3A::select(way.cmpgt(Vec3A::ZERO), self.from.low, self.from.high);
        way.dot(most - least) >= -SUM_F32_M
    }

    /// Where the lines begin and end that go through a gate between some shares of the way.
    fn narrowed(&self, gate: &SimdBox, [first, last]: [f32; 2]) -> Option<[SimdBox; 2]> {
        let from = self.from.narrowed(&self.to, gate, [1.0 - last, 1.0 - first])?;
        Some([from, self.to.narrowed(&self.from, gate, [first, last])?])
    }
}

impl SimdBox {
    /// The far ends of lines that begin in another box and go through a gate between some shares of their way.
    fn narrowed(&self, near: &Self, gate: &Self, [first, last]: [f32; 2]) -> Option<Self> {
        if first < NEAR {
            return Some(*self);
        }
        let (most, least) = (first.recip(), last.min(1.0).recip());
        let (low, high) = (gate.low - near.high, gate.high - near.low);
        let margin = Vec3A::splat(SUM_F32_M * most);
        let low = near.high + (low * most).min(low * least) - margin;
        let high = near.low + (high * most).max(high * least) + margin;
        let narrowed = Self { low: self.low.max(low), high: self.high.min(high) };
        narrowed.low.cmple(narrowed.high).all().then_some(narrowed)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use roaring::RoaringBitmap;

    use super::*;
    use sightline_world::{Cell, CellId, Gate, Polygon, Space, geometry::Axes};

    /// Rooms side by side along x, each 10 m wide, with a door of so much of z in each wall between.
    fn row(doors: &[[f32; 2]]) -> PortalFlood {
        let room = |i: usize| {
            Aabb::new(
                Vec3::new(i as f32 * 10.0, 0.0, 0.0),
                Vec3::new(i as f32 * 10.0 + 10.0, 3.0, 10.0),
            )
        };
        let count = doors.len() + 1;
        let mut tree = Vec::new();
        for i in 0..doors.len() {
            let next = tree.len() as u32 + 1;
            tree.push(Node::Axial { axis: 0, at: i as f32 * 10.0 + 10.0, sides: [next, next + 1] });
            tree.push(Node::Leaf(CellId(i as u32)));
        }
        tree.push(Node::Leaf(CellId(doors.len() as u32)));
        let gates = doors.iter().enumerate().map(|(i, [from, to])| {
            let x = i as f32 * 10.0 + 10.0;
            let bounds = Aabb::new(Vec3::new(x, 0.0, *from), Vec3::new(x, 2.0, *to));
            let polygon = Polygon::Rectangle { axis: 0, bounds };
            Gate { spaces: [i as u32, i as u32 + 1], polygon }
        });
        let near =
            |i: usize| (i.saturating_sub(1)..(i + 1).min(doors.len())).map(|gate| gate as u32);
        PortalFlood::new(&Cells {
            axes: Axes::WORLD,
            bounds: room(0).union(&room(doors.len())),
            tree,
            cells: (0..count)
                .map(|i| Cell { bounds: room(i), space: i as u32, portals: Vec::new() })
                .collect(),
            portals: Vec::new(),
            spaces: (0..count)
                .map(|i| Space {
                    bounds: room(i),
                    cells: i as u32..i as u32 + 1,
                    gates: near(i).collect(),
                })
                .collect(),
            gates: gates.collect(),
            pvs: vec![RoaringBitmap::new(); count],
        })
    }

    #[track_caller]
    fn check(doors: &[[f32; 2]], from: [f32; 2], to: [f32; 2], expected: bool) {
        let [from, to] = [from, to].map(|[x, z]| Aabb::around(Vec3::new(x, 1.0, z), 0.5));
        let (passages, mut steps) = (row(doors), FloodScratch::default());
        for (from, to) in [(&from, &to), (&to, &from)] {
            assert_eq!(passages.are_closed(&mut steps, from, to, &mut 0), expected);
        }
    }

    #[test]
    fn a_shaft_is_closed_unless_gates_lead_through_it() {
        check(&[[4.0, 5.0]], [5.0, 4.5], [15.0, 4.5], false);
        check(&[[4.0, 5.0]], [5.0, 1.0], [15.0, 1.0], true);
        check(&[[4.0, 5.0]], [5.0, 1.0], [15.0, 8.0], false);
        check(&[[4.0, 5.0]], [5.0, 1.0], [5.0, 8.0], false);
        // Through the one door the way is clear, but not through both.
        check(&[[4.0, 5.0], [4.0, 5.0]], [5.0, 4.5], [25.0, 4.5], false);
        check(&[[4.0, 5.0], [8.0, 9.0]], [5.0, 4.5], [25.0, 4.5], true);
        // A box in a wall between two rooms is in both.
        check(&[[4.0, 5.0]], [5.0, 1.0], [10.0, 1.0], false);
    }

    proptest! {
        #[test]
        fn what_goes_through_a_gate_is_in_the_narrowed_boxes(
            corners in prop::array::uniform6(prop::array::uniform3(-40i8..40)),
            ends in prop::array::uniform2(prop::array::uniform3(0.0..=1.0f32)),
            share in 0.0..=1.0f32,
        ) {
            let [a, b, c, d, e, f] = corners.map(|at| Vec3::from(at.map(f32::from)));
            let [start, end] = [(a, b), (c, d)].map(|(a, b)| Aabb::new(a.min(b), a.max(b)));
            let [from, to] = [(start, ends[0]), (end, ends[1])]
                .map(|(region, at)| region.min + region.size() * Vec3::from(at));
            // A gate somewhere about a point of the line.
            let through = from.lerp(to, share);
            let gate = Aabb::new(through.min(through + e * 0.1), through.max(through + f * 0.1));
            let between = SweptBox::new(&SimdBox::new(&start), &SimdBox::new(&end));
            let gate = SimdBox::new(&gate.grown(GATE_WIDENING_M));
            let shares = between.meets(&gate, 0.0);
            prop_assert!(shares.is_some_and(|[least, most]| least <= share && share <= most));
            let narrowed = shares.and_then(|shares| between.narrowed(&gate, shares));
            let holds = |span: &SimdBox, point: Vec3| {
                span.holds(&SimdBox { low: point.into(), high: point.into() })
            };
            prop_assert!(narrowed.is_some_and(|[a, b]| holds(&a, from) && holds(&b, to)));
        }

        #[test]
        fn a_gate_is_met_where_a_box_between_meets_it(
            corners in prop::array::uniform6(prop::array::uniform3(-4i8..4)),
            from in 0.0..1.0f32,
        ) {
            let [a, b, c, d, e, f] = corners.map(|at| Vec3::from(at.map(f32::from)));
            let [start, end, gate] =
                [(a, b), (c, d), (e, f)].map(|(a, b)| Aabb::new(a.min(b), a.max(b)));
            let between = SweptBox::new(&SimdBox::new(&start), &SimdBox::new(&end));
            let met = between.meets(&SimdBox::new(&gate.grown(1e-4)), from);
            for share in (0..=200).map(|i| i as f32 / 200.0).filter(|share| *share >= from) {
                let between = Aabb::new(
                    start.min.lerp(end.min, share),
                    start.max.lerp(end.max, share),
                );
                if between.intersects(&gate) {
                    let is_among =
                        |[least, most]: [f32; 2]| least <= share + 1e-4 && share <= most + 1e-4;
                    prop_assert!(met.is_some_and(is_among));
                }
            }
        }
    }
}
