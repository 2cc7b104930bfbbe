//! Whether a shaft is closed: the spaces that its lines can get into, through the gates that it meets.
//!
//! A line from one box to another is at each share `t` of its way in the box that is as far between the
//! two: its corners are theirs, mixed. So it goes only through gates that such a box meets, and
//! through one after another with `t` growing. Where no such sequence of gates leads from a space that
//! the first box reaches into to one that the other does, every line is blocked, whatever blocks it:
//! walls that only touch each other, or those of which the insides are open elsewhere.

use glam::{BVec3A, Vec3A};

use crate::{
    geometry::Aabb,
    world::{Cells, Node},
};

/// Gates are so much larger here, in metres: more than single precision may lose, and than the
/// compiler moves corners by.
const SLACK_M: f32 = 2e-4;
/// The same for shares of the way.
const SLACK: f32 = 1e-6;
/// A shaft that leads through so many gates is open as far as anybody cares.
const GATES_MAX: u32 = 1_000;

/// Spaces and gates, ready to be asked. 28 bytes for each side of a gate.
#[derive(Clone, Debug, Default)]
pub(super) struct Passages {
    /// Planes as in [`Cells::tree`], but that leaves are spaces.
    tree: Vec<Branch>,
    /// For each space, where its ways begin; and where the last ones end.
    starts: Vec<u32>,
    ways: Vec<Way>,
}

#[derive(Clone, Copy, Debug)]
enum Branch {
    Axial { axis: u8, at: f32, sides: [u32; 2] },
    Plane { normal: Vec3A, distance: f32, sides: [u32; 2] },
    Space(u32),
    Solid,
}

/// Out of a space.
#[derive(Clone, Copy, Debug)]
struct Way {
    gate: Aabb,
    beyond: u32,
}

/// What a search keeps memory for.
#[derive(Clone, Debug, Default)]
pub(super) struct Steps {
    search: u32,
    /// For each space, the search that came to it last, and the least share of the way there.
    reached: Vec<(u32, f32)>,
    /// For each space, the last search for which it was a goal.
    goals: Vec<u32>,
    open: Vec<(u32, f32)>,
    nodes: Vec<u32>,
    ends: [Vec<u32>; 2],
}

impl Passages {
    pub fn new(cells: &Cells) -> Self {
        let mut passages = Self { tree: tree(cells), ..Self::default() };
        for (index, space) in (0..).zip(&cells.spaces) {
            passages.starts.push(passages.ways.len() as u32);
            passages.ways.extend(space.gates.iter().map(|&gate| {
                let gate = &cells.gates[gate as usize];
                let beyond = gate.spaces[usize::from(gate.spaces[0] == index)];
                Way { gate: gate.polygon.bounds().grown(SLACK_M), beyond }
            }));
        }
        passages.starts.push(passages.ways.len() as u32);
        passages
    }

    /// Whether no line leads from one box to another, in own axes; counts the nodes and gates looked at.
    pub fn are_closed(&self, steps: &mut Steps, from: &Aabb, to: &Aabb, looked: &mut u32) -> bool {
        if self.tree.is_empty() {
            return false;
        }
        let [mut starts, mut goals] = std::mem::take(&mut steps.ends);
        self.spaces(from, steps, &mut starts, looked);
        self.spaces(to, steps, &mut goals, looked);
        let is_closed = self.are_apart(steps, (from, &starts), (to, &goals), looked);
        steps.ends = [starts, goals];
        is_closed
    }

    /// The same for lines that begin and end in some spaces only.
    pub fn are_apart(
        &self,
        steps: &mut Steps,
        (from, starts): (&Aabb, &[u32]),
        (to, goals): (&Aabb, &[u32]),
        looked: &mut u32,
    ) -> bool {
        if self.tree.is_empty() || starts.is_empty() {
            // Eyes are in no wall; where they seem to be, nothing is known.
            return false;
        }
        steps.begin(self.starts.len());
        goals.iter().for_each(|goal| steps.goals[*goal as usize] = steps.search);
        starts.iter().for_each(|start| steps.come_to(*start, 0.0));
        let between = Between::new(from, to);
        let most = *looked + GATES_MAX;
        while let Some((space, come)) = steps.open.pop() {
            if steps.goals[space as usize] == steps.search || *looked > most {
                return false;
            }
            if steps.reached[space as usize].1 < come {
                continue;
            }
            let [first, end] = [0, 1].map(|i| self.starts[space as usize + i] as usize);
            *looked += (end - first) as u32;
            for way in &self.ways[first..end] {
                if let Some(there) = between.meets(&way.gate, come) {
                    steps.come_to(way.beyond, there);
                }
            }
        }
        true
    }

    /// Finds the spaces that a box reaches into; some twice.
    fn spaces(&self, region: &Aabb, steps: &mut Steps, found: &mut Vec<u32>, looked: &mut u32) {
        found.clear();
        let open = &mut steps.nodes;
        let (centre, half) = (Vec3A::from(region.centre()), Vec3A::from(region.size() * 0.5));
        open.push(0);
        while let Some(node) = open.pop() {
            *looked += 1;
            let (away, reach, sides) = match self.tree[node as usize] {
                Branch::Space(space) => {
                    found.push(space);
                    continue;
                }
                Branch::Solid => continue,
                Branch::Axial { axis, at, sides } => {
                    let axis = usize::from(axis);
                    (centre[axis] - at, half[axis], sides)
                }
                Branch::Plane { normal, distance, sides } => {
                    (normal.dot(centre) - distance, normal.abs().dot(half), sides)
                }
            };
            if away <= reach + SLACK_M {
                open.push(sides[0]);
            }
            if away >= -reach - SLACK_M {
                open.push(sides[1]);
            }
        }
    }

    /// In memory, without its own head.
    pub fn bytes(&self) -> usize {
        self.tree.len() * size_of::<Branch>()
            + self.starts.len() * size_of::<u32>()
            + self.ways.len() * size_of::<Way>()
    }
}

/// The tree of cells, cut off where all that is below is of one space.
fn tree(cells: &Cells) -> Vec<Branch> {
    let whole: Vec<Option<u32>> = {
        let mut whole = vec![None; cells.tree.len()];
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
        whole
    };
    let (mut tree, mut open) = (vec![Branch::Solid], vec![(0, 0)]);
    while let Some((from, to)) = open.pop() {
        let node = cells.tree[from as usize];
        let mut sides_of = |sides: [u32; 2]| {
            let first = tree.len() as u32;
            tree.extend([Branch::Solid; 2]);
            open.extend([(sides[0], first), (sides[1], first + 1)]);
            [first, first + 1]
        };
        tree[to as usize] = match (whole[from as usize], node) {
            (Some(space), _) => Branch::Space(space),
            (None, Node::Axial { axis, at, sides }) => {
                Branch::Axial { axis, at, sides: sides_of(sides) }
            }
            (None, Node::Plane { normal, distance, sides }) => Branch::Plane {
                normal: normal.as_vec3a(),
                distance: distance as f32,
                sides: sides_of(sides),
            },
            (None, Node::Leaf(_) | Node::Solid) => Branch::Solid,
        };
    }
    tree
}

impl Steps {
    fn begin(&mut self, spaces: usize) {
        self.search = self.search.wrapping_add(1);
        if self.search == 0 || self.goals.len() < spaces {
            self.reached = vec![(0, 0.0); spaces];
            self.goals = vec![0; spaces];
            self.search = 1;
        }
        self.open.clear();
    }

    fn come_to(&mut self, space: u32, share: f32) {
        let known = &mut self.reached[space as usize];
        if known.0 != self.search || share < known.1 {
            *known = (self.search, share);
            self.open.push((space, share));
        }
    }
}

/// The boxes between two, by their share of the way: planes that move.
struct Between {
    low: Vec3A,
    high: Vec3A,
    /// By how much the planes move, inverted; never infinite.
    low_inverse: Vec3A,
    high_inverse: Vec3A,
    low_rises: BVec3A,
    high_rises: BVec3A,
}

impl Between {
    fn new(from: &Aabb, to: &Aabb) -> Self {
        // What moves by less than this does not move.
        let sane =
            |by: Vec3A| Vec3A::select(by.abs().cmplt(Vec3A::splat(1e-9)), Vec3A::splat(1e-9), by);
        let by = [sane(Vec3A::from(to.min - from.min)), sane(Vec3A::from(to.max - from.max))];
        Self {
            low: from.min.into(),
            high: from.max.into(),
            low_inverse: by[0].recip(),
            high_inverse: by[1].recip(),
            low_rises: by[0].cmpgt(Vec3A::ZERO),
            high_rises: by[1].cmpgt(Vec3A::ZERO),
        }
    }

    /// The least share of the way, from some share on, at which a box meets a gate.
    fn meets(&self, gate: &Aabb, from: f32) -> Option<f32> {
        let below = (Vec3A::from(gate.max) - self.low) * self.low_inverse;
        let above = (Vec3A::from(gate.min) - self.high) * self.high_inverse;
        // The lower planes must not be above the gate, nor the upper ones below it.
        let (all, none) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let first = Vec3A::select(self.low_rises, none, below)
            .max(Vec3A::select(self.high_rises, above, none))
            .max_element()
            .max(from);
        let last = Vec3A::select(self.low_rises, below, all)
            .min(Vec3A::select(self.high_rises, all, above))
            .min_element()
            .min(1.0);
        (first <= last + SLACK).then_some(first)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use roaring::RoaringBitmap;

    use super::*;
    use crate::world::{Axes, Cell, CellId, Gate, Polygon, Space};

    /// Rooms side by side along x, each 10 m wide, with a door of so much of z in each wall between.
    fn row(doors: &[[f32; 2]]) -> Passages {
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
        Passages::new(&Cells {
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
        let (passages, mut steps) = (row(doors), Steps::default());
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
        fn a_gate_is_met_where_a_box_between_meets_it(
            corners in prop::array::uniform6(prop::array::uniform3(-4i8..4)),
            from in 0.0..1.0f32,
        ) {
            let [a, b, c, d, e, f] = corners.map(|at| Vec3::from(at.map(f32::from)));
            let [start, end, gate] =
                [(a, b), (c, d), (e, f)].map(|(a, b)| Aabb::new(a.min(b), a.max(b)));
            let met = Between::new(&start, &end).meets(&gate.grown(1e-4), from);
            for share in (0..=200).map(|i| i as f32 / 200.0).filter(|share| *share >= from) {
                let between = Aabb::new(
                    start.min.lerp(end.min, share),
                    start.max.lerp(end.max, share),
                );
                if between.intersects(&gate) {
                    prop_assert!(met.is_some_and(|least| least <= share + 1e-4));
                }
            }
        }
    }
}
