//! The movers of the building: a lift in the hall, and sliding doors.

use glam::Vec3;

use super::{
    mesh::{Paint, Scene, metres},
    plan::{OpeningKind, Plan, STOREY, SpaceKind, WallOpening},
};

const CABIN: Paint = Paint::opaque([198, 160, 58]);
const CABIN_RIM: Paint = Paint::opaque([70, 74, 82]);
const LEAF: Paint = Paint::opaque([150, 112, 74]);
/// Half the width of the lift's platform, in lattice units.
const CABIN_HALF: i32 = 56;
/// The speed of the lift, in metres per second.
const LIFT_SPEED: f32 = 1.2;
/// How long the lift stays at each storey, in seconds.
const LIFT_STAY_S: f32 = 4.0;
/// The number of sliding doors on each storey.
const DOORS_PER_STOREY: usize = 4;
/// The thickness of a door, in lattice units. Its wall is thicker.
const LEAF_THICKNESS: i32 = 4;
/// How long a door takes to open, in seconds.
const DOOR_S: f32 = 1.5;
/// How long a door stays open or closed, in seconds.
const DOOR_STAY_S: f32 = 6.0;

/// Adds the movers to the scene.
pub(super) fn build(plan: &Plan, scene: &mut Scene) {
    if plan.storeys > 1 && plan.void.is_some_and(|void| void.size(0) > 8 * CABIN_HALF) {
        lift(plan, scene);
    }
    for storey in 0..plan.storeys {
        let openings = plan.openings.get(storey).into_iter().flatten();
        let rooms = openings.filter(|opening| leads_to_room(plan, storey, opening));
        for (number, opening) in rooms.take(DOORS_PER_STOREY).enumerate() {
            door(plan, storey, number, opening, scene);
        }
    }
}

/// Adds the lift: an open platform beside the landmark, from the floor of the hall to the top
/// gallery.
fn lift(plan: &Plan, scene: &mut Scene) {
    let Some(void) = &plan.void else { return };
    let [x, z] = void.centre();
    let x = x + void.size(0) / 4;
    let mut way = Vec::new();
    let mut time_s = 0.0;
    let (ride_s, top) = (metres(STOREY) / LIFT_SPEED, plan.storeys - 1);
    for storey in (0..=top).chain((0..top).rev()) {
        let place = Vec3::Y * metres(plan.floor(storey));
        way.extend([(time_s, place), (time_s + LIFT_STAY_S, place)]);
        time_s += LIFT_STAY_S + ride_s;
    }
    let node = scene.mover("lift".into(), way);
    let (min, max) = ([x - CABIN_HALF, z - CABIN_HALF], [x + CABIN_HALF, z + CABIN_HALF]);
    scene.block(node, CABIN, [min[0], 2, min[1]], [max[0], 10, max[1]]);
    for [a, b] in [[min[0], min[0] + 4], [max[0] - 4, max[0]]] {
        scene.block(node, CABIN_RIM, [a, 70, min[1]], [b, 74, max[1]]);
        for [c, d] in [[min[1], min[1] + 4], [max[1] - 4, max[1]]] {
            scene.block(node, CABIN_RIM, [a, 10, c], [b, 70, d]);
        }
    }
}

fn leads_to_room(plan: &Plan, storey: usize, opening: &WallOpening) -> bool {
    let is_there = |door: &&super::PlanDoor| door.rect == opening.rect;
    opening.kind == OpeningKind::Door
        && plan.doors_on(storey).find(is_there).is_some_and(|door| {
            door.spaces.1.is_some() && plan.spaces[door.spaces.0].kind == SpaceKind::Room
        })
}

/// Adds a door that slides into the wall beside its opening. Each opens at a time of its own.
fn door(plan: &Plan, storey: usize, number: usize, opening: &WallOpening, scene: &mut Scene) {
    let (through, along) = (opening.axis, 1 - opening.axis);
    let [start, end] = opening.rect.span(along);
    let middle = (opening.rect.min[through] + opening.rect.max[through]) / 2;
    let axis = if along == 0 { Vec3::X } else { Vec3::Z };
    let open = axis * metres(end - start);
    let opens_s = DOOR_STAY_S + number as f32 * 1.7;
    let closes_s = opens_s + DOOR_S + DOOR_STAY_S;
    let way = vec![
        (0.0, Vec3::ZERO),
        (opens_s, Vec3::ZERO),
        (opens_s + DOOR_S, open),
        (closes_s, open),
        (closes_s + DOOR_S, Vec3::ZERO),
    ];
    let node = scene.mover(format!("door {storey}.{number}"), way);
    let floor = plan.floor(storey);
    let (mut min, mut max) = ([0, floor + opening.sill, 0], [0, floor + opening.head, 0]);
    (min[2 * along], max[2 * along]) = (start, end);
    (min[2 * through], max[2 * through]) =
        (middle - LEAF_THICKNESS / 2, middle + LEAF_THICKNESS / 2);
    scene.block(node, LEAF, min, max);
}
