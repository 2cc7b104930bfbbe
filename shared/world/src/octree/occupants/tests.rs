use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::SmallRng};

use super::{grid::GridCell, *};

const ORIGIN: Vec3 = Vec3::new(-7.0, 2.0, -31.0);
const EDGE: f32 = 64.0;

/// The primitives at each node: an object, and the index of its box.
type TreeShape = BTreeMap<GridCell, BTreeSet<(u32, usize)>>;

impl Occupants {
    fn shape(&self) -> TreeShape {
        let index = |primitive: u32| {
            let object = self.tree.primitives[primitive as usize].object;
            let held = &self.objects[object as usize];
            (object, held.iter().position(|&of| of == primitive).expect("held"))
        };
        let nodes = self.tree.nodes_in_use();
        nodes.map(|(_, n)| (n.cell, n.primitives.iter().map(|&p| index(p)).collect())).collect()
    }

    /// The tree that the rules of the module give for the present objects.
    fn shape_by_rule(&self) -> TreeShape {
        let mut all = Vec::new();
        for object in 0..self.objects.len() as u32 {
            for (index, bounds) in self.primitives(OccupantId(object)).enumerate() {
                all.push(((object, index), self.tree.grid.span(bounds)));
            }
        }
        let mut shape = TreeShape::new();
        put(&self.tree.grid, GridCell::ROOT, &all, &mut shape);
        shape
    }

    /// Checks that nodes and primitives refer to one another, and so do parents and children.
    fn check_links(&self) {
        for (at, node) in self.tree.nodes_in_use() {
            for &primitive in &node.primitives {
                assert!(self.tree.primitives[primitive as usize].nodes().contains(&at));
            }
            for octant in 0..8 {
                assert_eq!(node.child(octant).is_some(), node.child_mask >> octant & 1 == 1);
            }
            for child in node.children() {
                assert_eq!(self.tree.nodes[child as usize].parent, at);
            }
        }
        for &primitive in self.objects.iter().flatten() {
            for &at in self.tree.primitives[primitive as usize].nodes() {
                assert!(self.tree.nodes[at as usize].primitives.contains(&primitive));
            }
        }
        assert_eq!(self.tree.nodes_in_use().count(), self.node_count());
    }
}

/// Applies the rules of the module.
fn put(
    grid: &OccupantGrid,
    cell: GridCell,
    inside: &[((u32, usize), CellRange)],
    shape: &mut TreeShape,
) {
    let is_split = inside.len() > 1 && inside.iter().any(|(_, span)| span.level > cell.depth);
    let (own, deeper): (Vec<_>, Vec<_>) =
        inside.iter().partition(|(_, span)| !is_split || span.level == cell.depth);
    shape.insert(cell, own.into_iter().map(|(of, _)| of).collect());
    for octant in (0..8).filter(|_| is_split) {
        let child = cell.child(octant);
        let meets = |(_, span): &&(_, CellRange)| grid.meets(child, span);
        let below: Vec<_> = deeper.iter().filter(meets).copied().collect();
        if !below.is_empty() {
            put(grid, child, &below, shape);
        }
    }
}

/// Objects on random walks with short steps and rare leaps. Boxes measure from millimetres to the
/// whole region. Some are partly outside.
struct Crowd {
    rng: SmallRng,
    /// The centre of each object.
    middles: Vec<Vec3>,
    /// The boxes of each object relative to its centre.
    boxes: Vec<Vec<Aabb>>,
}

impl Crowd {
    fn new(seed: u64, count: usize) -> Self {
        let mut crowd =
            Self { rng: SmallRng::seed_from_u64(seed), middles: Vec::new(), boxes: Vec::new() };
        for _ in 0..count {
            let middle = crowd.anywhere();
            let boxes = crowd.some_boxes();
            crowd.middles.push(middle);
            crowd.boxes.push(boxes);
        }
        crowd
    }

    fn anywhere(&mut self) -> Vec3 {
        // Half of all places are close together, so that objects meet.
        let place = Vec3::from_array(std::array::from_fn(|_| self.rng.random_range(0.0..1.0)));
        let spread = if self.rng.random_bool(0.5) { 3.0 } else { EDGE * 1.05 };
        ORIGIN + place * spread
    }

    fn some_boxes(&mut self) -> Vec<Aabb> {
        let count = self.rng.random_range(1..=4);
        (0..count).map(|_| self.some_box()).collect()
    }

    fn some_box(&mut self) -> Aabb {
        let scale = 2f32.powf(self.rng.random_range(-9.0..6.0));
        let flat = self.rng.random_range(0..4usize);
        let half = Vec3::from_array(std::array::from_fn(|axis| {
            if axis == flat { 0.0 } else { scale * self.rng.random_range(0.2..0.5) }
        }));
        let aside = Vec3::from_array(std::array::from_fn(|_| self.rng.random_range(-1.0..1.0)));
        let aside = aside * scale.min(2.0);
        Aabb::new(aside - half, aside + half)
    }

    fn at(&self, object: usize) -> Vec<Aabb> {
        let at = self.middles[object];
        self.boxes[object].iter().map(|b| Aabb::new(b.min + at, b.max + at)).collect()
    }

    fn step(&mut self, object: usize) {
        self.middles[object] = if self.rng.random_bool(0.1) {
            self.anywhere()
        } else {
            let step = Vec3::from_array(std::array::from_fn(|_| self.rng.random_range(-1.0..1.0)));
            self.middles[object] + step * 2f32.powf(self.rng.random_range(-8.0..2.0))
        };
    }
}

fn with(crowd: &Crowd, depth: u8) -> (Occupants, Vec<OccupantId>) {
    let mut occupants = Occupants::new(ORIGIN, EDGE, depth);
    let ids = (0..crowd.boxes.len()).map(|i| occupants.insert(&crowd.at(i)).expect("good"));
    let ids = ids.collect();
    (occupants, ids)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn both_methods_give_the_tree_of_the_rules(
        seed: u64, count in 1usize..24, depth in 0u8..=16,
    ) {
        let mut crowd = Crowd::new(seed, count);
        let (mut b, ids) = with(&crowd, depth);
        prop_assert_eq!(b.shape(), b.shape_by_rule());
        let mut n = b.clone();
        for _ in 0..60 {
            let object = crowd.rng.random_range(0..count);
            crowd.step(object);
            b.move_to(ids[object], &crowd.at(object)).expect("good");
            n.move_naively(ids[object], &crowd.at(object)).expect("good");
            prop_assert_eq!(b.shape(), n.shape());
            prop_assert_eq!(b.shape(), b.shape_by_rule());
            b.check_links();
            n.check_links();
        }
    }

    #[test]
    fn grouped_moves_give_the_tree_of_single_moves(
        seed: u64, count in 2usize..24, depth in 1u8..=16,
    ) {
        let mut crowd = Crowd::new(seed, count);
        let (mut together, ids) = with(&crowd, depth);
        let mut single = together.clone();
        for _ in 0..20 {
            let moving: Vec<usize> = (0..count).filter(|_| crowd.rng.random_bool(0.6)).collect();
            for &object in &moving {
                crowd.step(object);
                if crowd.rng.random_bool(0.1) {
                    crowd.boxes[object] = crowd.some_boxes();
                }
                single.move_to(ids[object], &crowd.at(object)).expect("good");
            }
            let boxes: Vec<Vec<Aabb>> = moving.iter().map(|&object| crowd.at(object)).collect();
            let moves: Vec<(OccupantId, &[Aabb])> =
                moving.iter().zip(&boxes).map(|(&of, boxes)| (ids[of], &boxes[..])).collect();
            together.move_all(&moves).expect("good");
            prop_assert_eq!(together.shape(), single.shape());
            prop_assert_eq!(together.shape(), together.shape_by_rule());
            together.check_links();
        }
    }

    #[test]
    fn removed_objects_leave_no_trace(seed: u64, count in 1usize..24, depth in 0u8..=16) {
        let mut crowd = Crowd::new(seed, count);
        let (mut occupants, mut ids) = with(&crowd, depth);
        for _ in 0..60 {
            let object = crowd.rng.random_range(0..count);
            prop_assert!(occupants.remove(ids[object]));
            prop_assert!(!occupants.remove(ids[object]));
            prop_assert_eq!(occupants.shape(), occupants.shape_by_rule());
            crowd.step(object);
            ids[object] = occupants.insert(&crowd.at(object)).expect("good");
            prop_assert_eq!(occupants.shape(), occupants.shape_by_rule());
        }
        for id in ids {
            prop_assert!(occupants.remove(id));
        }
        prop_assert!(occupants.is_empty());
        prop_assert_eq!(occupants.node_count(), 1);
    }

    #[test]
    fn a_query_finds_what_a_linear_scan_finds(seed: u64, count in 0usize..60, depth in 0u8..=16) {
        let mut crowd = Crowd::new(seed, count);
        let (mut occupants, ids) = with(&crowd, depth);
        for _ in 0..20 {
            if count > 0 {
                let object = crowd.rng.random_range(0..count);
                crowd.step(object);
                occupants.move_to(ids[object], &crowd.at(object)).expect("good");
            }
            let (at, around) = (crowd.anywhere(), crowd.some_box());
            let region = Aabb::new(at + around.min, at + around.max);
            let meets = |&id: &OccupantId| occupants.primitives(id).any(|b| b.intersects(&region));
            let scan: Vec<OccupantId> = ids.iter().copied().filter(meets).collect();
            prop_assert_eq!(occupants.meeting(&region), scan);
        }
    }

    #[test]
    fn a_walk_visits_each_object_once_and_possible_hiders_first(
        seed: u64, count in 1usize..60, eye in prop::array::uniform3(-40f32..80.0),
    ) {
        let crowd = Crowd::new(seed, count);
        let (occupants, ids) = with(&crowd, 12);
        let (mut met, mut cubes) = (Vec::new(), Vec::new());
        let eye = Vec3::from(eye);
        occupants.front_to_back(eye, |what| {
            match what {
                Visit::Node(cube) => cubes.push(cube),
                Visit::Occupant(id) => met.push(id),
            }
            true
        });
        met.sort();
        prop_assert_eq!(met, ids);
        prop_assert_eq!(cubes.len() + 1, occupants.node_count());
        for (later, cube) in cubes.iter().enumerate() {
            for before in &cubes[..later] {
                prop_assert!(!may_hide(cube, before, eye));
            }
        }
    }
}

/// Whether the first of two cubes may hide the second. It may only if they are apart, and the eye
/// is on the first's side of every axial plane between them.
fn may_hide(first: &Aabb, second: &Aabb, eye: Vec3) -> bool {
    let below = first.max.cmple(second.min);
    let above = second.max.cmple(first.min);
    let on_its_side = (!below | eye.cmplt(first.max)) & (!above | eye.cmpgt(first.min));
    (below | above).any() && on_its_side.all()
}

#[test]
fn objects_only_in_refused_nodes_are_not_visited() {
    let mut occupants = Occupants::new(Vec3::ZERO, 64.0, 10);
    let near = occupants.insert(&[Aabb::around(Vec3::splat(10.0), 1.0)]).expect("good");
    let far = occupants.insert(&[Aabb::around(Vec3::splat(50.0), 1.0)]).expect("good");
    let both = occupants.insert(&[Aabb::around(Vec3::splat(32.0), 1.0)]).expect("good");
    let mut met = Vec::new();
    occupants.front_to_back(Vec3::ZERO, |what| match what {
        Visit::Node(cube) => !cube.contains(Vec3::splat(50.0)),
        Visit::Occupant(id) => {
            met.push(id);
            true
        }
    });
    assert!(met.contains(&near) && met.contains(&both) && !met.contains(&far));
}

#[test]
fn a_primitive_is_in_eight_nodes_at_most() {
    let mut crowd = Crowd::new(5, 400);
    for boxes in &mut crowd.boxes {
        boxes.truncate(1);
    }
    let (occupants, _) = with(&crowd, DEPTH_MAX);
    for primitive in &occupants.tree.primitives {
        assert!((1..=8).contains(&primitive.nodes().len()));
    }
    assert!(occupants.node_count() <= 400 * 8 * usize::from(DEPTH_MAX) + 1);
}

/// Claim 2 of the paper, and its gain for several objects: in a row of carriages each enters the
/// nodes that the one before leaves.
#[test]
fn no_node_is_deleted_and_made_again() {
    let carriage = |place: f32| {
        let front = Aabb::around(Vec3::new(place, 20.3, 20.3), 0.24);
        [front, Aabb::new(front.min - 0.1, front.max - 0.1)]
    };
    let mut together = Occupants::new(Vec3::ZERO, 64.0, 10);
    let row: Vec<_> =
        (0..8).map(|i| together.insert(&carriage(40.1 + i as f32 * 2.0)).expect("good")).collect();
    let (mut single, mut naive) = (together.clone(), together.clone());
    for step in 1..20 {
        let boxes: Vec<_> = (0..8).map(|i| carriage(40.1 + (i - step) as f32 * 2.0)).collect();
        let moves: Vec<(_, &[Aabb])> =
            row.iter().zip(&boxes).map(|(&id, boxes)| (id, &boxes[..])).collect();
        together.move_all(&moves).expect("good");
        for (id, boxes) in moves {
            single.move_to(id, boxes).expect("good");
            naive.move_naively(id, boxes).expect("good");
        }
        assert_eq!(together.shape(), naive.shape());
    }
    let [together, single, naive] = [together, single, naive].map(|tree| tree.counters());
    assert!(together.created < single.created && single.created < naive.created);
    assert!(together.deleted < single.deleted && single.deleted < naive.deleted);
    assert!(single.visited < naive.visited);
}

#[test]
fn a_move_within_cells_changes_no_node() {
    let mut occupants = Occupants::new(Vec3::ZERO, 64.0, 10);
    let here = |x: f32| [Aabb::around(Vec3::new(x, 10.0, 10.0), 0.4)];
    let body = occupants.insert(&here(10.5)).expect("good");
    occupants.insert(&here(40.0)).expect("good");
    let before = occupants.counters();
    occupants.move_to(body, &here(10.55)).expect("good");
    assert_eq!(occupants.counters(), before);
    assert_eq!(occupants.primitives(body).copied().collect::<Vec<_>>(), here(10.55));
}

#[test]
fn invalid_input_changes_nothing() {
    let mut occupants = Occupants::new(Vec3::ZERO, 64.0, 10);
    let good = [Aabb::around(Vec3::splat(9.0), 1.0)];
    let body = occupants.insert(&good).expect("good");
    let before = occupants.shape();
    let mut check = |boxes: &[Aabb], expected| {
        assert_eq!(occupants.insert(boxes), Err(expected));
        assert_eq!(occupants.move_to(body, boxes), Err(expected));
        assert_eq!(occupants.move_all(&[(body, boxes)]), Err(expected));
        assert_eq!(occupants.shape(), before);
    };
    check(&[], OccupantError::NoPrimitive);
    check(&[Aabb::EMPTY], OccupantError::BadBox);
    check(&[Aabb::around(Vec3::NAN, 1.0)], OccupantError::BadBox);
    check(&[good[0], Aabb::around(Vec3::ZERO, f32::INFINITY)], OccupantError::BadBox);
    let stranger = OccupantId(7);
    assert_eq!(occupants.move_to(stranger, &good), Err(OccupantError::Unknown));
    assert_eq!(occupants.move_all(&[(body, &good), (body, &good)]), Err(OccupantError::Unknown));
    assert_eq!(occupants.primitives(stranger).count(), 0);
}
