//! Ways through rows of rooms, past solid walls, and in random mazes.

use std::collections::{BTreeMap, BTreeSet};

use glam::UVec3;
use proptest::prelude::*;
use sightline_world::{
    CellId, Polygon,
    octree::{Octree, Voxel, morton},
};

use super::*;
use crate::tests::stage::{self, narrow};

const EYE: f32 = 1.6;

fn at(x: f32, z: f32) -> Vec3 {
    Vec3::new(x, EYE, z)
}

/// The state in a space in which a body has room.
fn on(space: Option<u32>) -> WalkState {
    WalkState { space, is_stuck: false }
}

/// Walkways of a world, and the memory of a search.
struct Ways<'a> {
    world: &'a World,
    walkways: Walkways,
    search: WaySearch,
}

impl<'a> Ways<'a> {
    fn new(world: &'a World, fall_ratio: f32) -> Self {
        Self { world, walkways: Walkways::new(world, fall_ratio), search: WaySearch::default() }
    }

    fn state_at(&self, eye: Vec3) -> WalkState {
        self.walkways.state_at(self.world, eye)
    }

    /// The state at the end of a way, and the length of the way.
    fn find(
        &mut self,
        from: Vec3,
        state: WalkState,
        to: Vec3,
        longest_m: f32,
    ) -> Option<(WalkState, f32)> {
        let walk = Walk { from, state, to };
        let way = self.walkways.find_way(&mut self.search, self.world, &walk, longest_m)?;
        Some((way.state, way.length_m))
    }
}

/// The space at the end of a way, if there is such a way.
fn lead(world: &World, from: Vec3, to: Vec3, way_m: f32) -> Option<Option<u32>> {
    let mut ways = Ways::new(world, 1.0);
    let state = ways.state_at(from);
    ways.find(from, state, to, way_m).map(|(state, _)| state.space)
}

#[test]
fn a_way_leads_through_doors_and_not_through_walls() {
    // Doors of 1 m at opposite ends of the walls before and behind room 1.
    let mut world = stage::row(3);
    narrow(&mut world, 0, 2, [0.0, 1.0]);
    narrow(&mut world, 1, 2, [9.0, 10.0]);
    for (from, to, way_m, space) in [
        // In one room the movement budget alone decides.
        (at(1.0, 1.0), at(9.0, 9.0), 0.0, Some(0)),
        (at(9.9, 0.5), at(10.1, 0.5), 0.21, Some(1)),
        (at(9.9, 5.0), at(10.1, 5.0), 0.21, None),
        (at(9.9, 5.0), at(10.1, 5.0), 7.9, None),
        (at(9.9, 5.0), at(10.1, 5.0), 8.1, Some(1)),
        (at(9.9, 0.5), at(20.1, 0.5), 13.0, None),
        (at(9.9, 0.5), at(20.1, 0.5), 21.8, Some(2)),
    ] {
        let found = lead(&world, from, to, way_m);
        assert_eq!(found, space.map(Some), "{from} to {to} in {way_m} m");
        assert_eq!(lead(&world, to, from, way_m).is_some(), space.is_some(), "{to} back to {from}");
    }
}

#[test]
fn falls_count_for_less_and_jumps_cost_nothing_along_the_ground() {
    // Two storeys, joined all over.
    let floor = |y: f32| Aabb::new(Vec3::new(0.0, y, 0.0), Vec3::new(4.0, y + 3.0, 4.0));
    let tree = vec![
        Node::Axial { axis: 1, at: 3.0, sides: [1, 2] },
        Node::Leaf(CellId(0)),
        Node::Leaf(CellId(1)),
    ];
    let world = stage::world(tree, vec![floor(0.0), floor(3.0)], |_, _| true);
    let mut ways = Ways::new(&world, 4.0);
    let (low, high) = (Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, 5.0, 1.0));
    let mut is_led = |from: Vec3, to: Vec3, way_m: f32| {
        let state = ways.state_at(from);
        ways.find(from, state, to, way_m).is_some()
    };
    assert!(is_led(high, low, 1.01) && !is_led(high, low, 0.9));
    assert!(is_led(low, high, 4.01) && !is_led(low, high, 3.9));
    assert!(is_led(low, high + Vec3::X * 2.0, 4.01), "while it runs");
}

/// Rooms from 0 to 10 m and from 10.5 to 20 m, and a wall of half a metre in between, with a door
/// in it if wanted.
fn walled(has_door: bool) -> World {
    let cell = |x: [f32; 2], z: [f32; 2]| {
        Aabb::new(Vec3::new(x[0], 0.0, z[0]), Vec3::new(x[1], 3.0, z[1]))
    };
    let mut bounds = vec![cell([0.0, 10.0], [0.0, 10.0]), cell([10.5, 20.0], [0.0, 10.0])];
    let mut in_wall = Node::Solid;
    if has_door {
        bounds.push(cell([10.0, 10.5], [0.0, 1.0]));
        in_wall = Node::Leaf(CellId(2));
    }
    let tree = vec![
        Node::Axial { axis: 0, at: 10.0, sides: [1, 2] },
        Node::Leaf(CellId(0)),
        Node::Axial { axis: 0, at: 10.5, sides: [3, 4] },
        Node::Axial { axis: 2, at: 1.0, sides: [5, 6] },
        Node::Leaf(CellId(1)),
        in_wall,
        Node::Solid,
    ];
    stage::world(tree, bounds, |_, _| true)
}

#[test]
fn eyes_poke_into_walls_but_not_through() {
    let world = walled(true);
    let mut ways = Ways::new(&world, 1.0);
    let mut state = ways.state_at(at(9.0, 5.0));
    // The eye may be as far in the wall as bodies poke into it. It keeps the space of its room.
    let mut from = at(9.0, 5.0);
    for (to, is_led) in [
        (at(10.05, 5.0), true),
        (at(10.1, 5.0), false),
        (at(10.25, 5.0), false),
        (at(10.45, 5.0), false),
        (at(10.55, 5.0), false),
        (at(10.03, 6.0), true),
        (at(9.9, 6.0), true),
    ] {
        let led = ways.find(from, state, to, 3.0);
        assert_eq!(led.is_some(), is_led, "{to}");
        if let Some((led, _)) = led {
            (from, state) = (to, led);
            assert_eq!(state, on(Some(0)), "{to}");
        }
    }
    // The way leads round the door post, and out of the wall on its other side.
    for (to, space) in [(at(10.2, 1.04), 2), (at(10.45, 0.9), 2), (at(10.46, 2.0), 1)] {
        let led = ways.find(at(10.1, 0.9), state, to, 20.0);
        state = led.expect("by the door").0;
        assert_eq!(state, on(Some(space)), "{to}");
    }
}

#[test]
fn an_avatar_put_into_a_wall_gets_out_on_any_side_and_then_stays_out() {
    let world = walled(false);
    for (out, beyond) in [(at(9.9, 5.0), at(10.6, 5.0)), (at(10.6, 5.0), at(9.9, 5.0))] {
        let mut ways = Ways::new(&world, 1.0);
        let inside = at(10.25, 5.0);
        let mut state = ways.state_at(inside);
        assert_eq!(state, on(None));
        let mut lead = |to| ways.find(inside, state, to, 0.1).expect("free").0;
        assert_eq!(lead(at(10.26, 7.0)), on(None));
        state = lead(out);
        assert_ne!(state, on(None));
        for to in [inside, beyond] {
            assert_eq!(ways.find(out, state, to, 100.0), None, "{to}");
        }
    }
}

#[test]
fn a_stuck_avatar_gets_out_through_a_narrow_gate_and_not_back() {
    // A window of half a metre between two rooms, and a pane of 5 cm behind it.
    let mut world = stage::row(2);
    narrow(&mut world, 0, 1, [1.4, 1.9]);
    let pane = (0..60).flat_map(|y| (0..200).map(move |z| UVec3::new(201, y, z)));
    let voxels = pane.map(|at| Voxel { key: morton(at), ..Voxel::default() });
    world.octree = Octree::from_voxels(Vec3::ZERO, 0.05, 9, voxels.collect()).expect("small");
    let mut ways = Ways::new(&world, 1.0);
    let (before, behind) = (at(9.5, 5.0), at(10.6, 5.0));
    for (from, to, is_led) in
        [(before, behind, false), (behind, before, false), (at(10.1, 5.0), before, true)]
    {
        let state = ways.state_at(from);
        assert_eq!(ways.walkways.clearance_of(state).is_none(), is_led, "{from}");
        let led = ways.find(from, state, to, 2.0);
        assert_eq!(led.is_some(), is_led, "{from} to {to}");
        if let Some((state, _)) = led {
            assert_eq!(state, on(Some(0)));
            assert_eq!(ways.find(to, state, behind, 2.0), None, "back");
        }
    }
}

/// A maze: a square of rooms of 4 m each, with doors in some walls.
#[derive(Clone, Debug)]
struct Maze {
    side: u32,
    /// For each wall where its door begins and ends, if it has one.
    doors: Vec<Option<[f32; 2]>>,
}

const ROOM_M: f32 = 4.0;
/// The step of the lattice on which the reference model walks, in metres.
const STEP_M: f32 = 0.25;

fn maze() -> impl Strategy<Value = Maze> {
    let door = prop::option::weighted(0.6, (0..11_u8, 2..6_u8)).prop_map(|door| {
        let metres = |steps: u8| f32::from(steps) * STEP_M;
        door.map(|(begin, width)| [metres(begin), metres((begin + width).min(16))])
    });
    (2..5_u32).prop_flat_map(move |side| {
        let walls = 2 * side * (side - 1);
        let doors = prop::collection::vec(door.clone(), walls as usize);
        doors.prop_map(move |doors| Maze { side, doors })
    })
}

impl Maze {
    fn world(&self) -> World {
        let bounds = (0..self.side * self.side).map(|i| {
            let corner = Vec3::new((i % self.side) as f32, 0.0, (i / self.side) as f32) * ROOM_M;
            Aabb::new(corner, corner + Vec3::new(ROOM_M, 3.0, ROOM_M))
        });
        let mut tree = Vec::new();
        self.split(&mut tree, [0, self.side], [0, self.side]);
        let mut world = stage::world(tree, bounds.collect(), |_, _| true);
        let joints = world.cells.portals.len();
        assert_eq!(joints, self.doors.len(), "corners do not join");
        for (joint, door) in (0..joints).zip(&self.doors) {
            let Polygon::Rectangle { axis, bounds } = world.cells.portals[joint].polygon else {
                unreachable!("hand-made worlds join in rectangles")
            };
            let along = 2 - usize::from(axis);
            let [begin, end] = door.unwrap_or([0.0; 2]).map(|m| bounds.min[along] + m);
            narrow(&mut world, joint, along, [begin, end]);
        }
        close(&mut world);
        world
    }

    /// Halves a rectangle of rooms until it is a single room.
    fn split(&self, tree: &mut Vec<Node>, x: [u32; 2], z: [u32; 2]) -> u32 {
        let index = tree.len();
        let (wide, deep) = (x[1] - x[0], z[1] - z[0]);
        if wide == 1 && deep == 1 {
            tree.push(Node::Leaf(CellId(z[0] * self.side + x[0])));
            return index as u32;
        }
        tree.push(Node::Solid);
        let (axis, range) = if wide >= deep { (0, x) } else { (2, z) };
        let middle = (range[0] + range[1]) / 2;
        let sides = [[range[0], middle], [middle, range[1]]].map(|half| {
            let (x, z) = if axis == 0 { (half, z) } else { (x, half) };
            self.split(tree, x, z)
        });
        tree[index] = Node::Axial { axis, at: middle as f32 * ROOM_M, sides };
        index as u32
    }
}

/// Removes joints of no width.
fn close(world: &mut World) {
    let is_open = |index: &u32| {
        let bounds = world.cells.gates[*index as usize].polygon.bounds();
        bounds.size().x.max(bounds.size().z) > 0.0
    };
    let open: Vec<u32> = (0..world.cells.gates.len() as u32).filter(is_open).collect();
    world.cells.spaces.iter_mut().for_each(|space| space.gates.retain(|gate| open.contains(gate)));
    world.cells.cells.iter_mut().for_each(|cell| cell.portals.retain(|gate| open.contains(gate)));
}

/// The reference model: the shortest way to each point of a lattice. Each step goes to a
/// neighbouring point in the same room or through a door.
fn walked(world: &World, side: u32, from: [i32; 2]) -> BTreeMap<[i32; 2], f32> {
    let place = |[x, z]: [i32; 2]| at((x as f32 + 0.5) * STEP_M, (z as f32 + 0.5) * STEP_M);
    let size = (side as f32 * ROOM_M / STEP_M) as i32;
    let can_step = |a: Vec3, b: Vec3| {
        let [here, there] = [a, b].map(|p| world.cells.at_own(p).expect("rooms fill it"));
        let middle = (a + b) * 0.5;
        let joins = |gate: &u32| {
            let gate = &world.cells.gates[*gate as usize];
            gate.spaces.contains(&there.0) && gate.polygon.bounds().contains(middle)
        };
        here == there || world.cells.spaces[here.0 as usize].gates.iter().any(joins)
    };
    let mut far = BTreeMap::from([(from, 0.0_f32)]);
    let mut open = BTreeSet::from([(0, from)]);
    while let Some((_, here)) = open.pop_first() {
        let so_far = far[&here];
        for [dx, dz] in [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]] {
            let next = [here[0] + dx, here[1] + dz];
            let is_inside = next.iter().all(|i| (0..size).contains(i));
            let come = so_far + STEP_M * (dx as f32).hypot(dz as f32);
            if is_inside
                && can_step(place(here), place(next))
                && far.get(&next).is_none_or(|known| come < *known - 1e-4)
            {
                far.insert(next, come);
                open.insert((come.to_bits(), next));
            }
        }
    }
    far
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// No way that can be walked is denied, and no way is granted where nobody can walk.
    #[test]
    fn ways_lead_wherever_one_can_walk(
        maze in maze(),
        from in (0..64_i32, 0..64_i32),
        spare in 0.0..2.0_f32,
    ) {
        let world = maze.world();
        let size = (maze.side as f32 * ROOM_M / STEP_M) as i32;
        let from = [from.0 % size, from.1 % size];
        let place = |[x, z]: [i32; 2]| at((x as f32 + 0.5) * STEP_M, (z as f32 + 0.5) * STEP_M);
        let far = walked(&world, maze.side, from);
        let mut ways = Ways::new(&world, 1.0);
        let state = ways.state_at(place(from));
        for x in (0..size).step_by(3) {
            for z in (0..size).step_by(3) {
                let to = place([x, z]);
                let mut lead = |way_m| ways.find(place(from), state, to, way_m);
                match far.get(&[x, z]) {
                    Some(way_m) => {
                        let (led, led_m) = lead(way_m + 1e-3 + spare).expect("it was walked");
                        prop_assert_eq!(led, on(world.cells.at_own(to).map(|c| c.0)));
                        prop_assert!(led_m <= way_m + 1e-3, "{} of {}", led_m, way_m);
                    }
                    None => prop_assert_eq!(lead(1e6), None, "{:?} to {:?}", from, [x, z]),
                }
            }
        }
    }
}
