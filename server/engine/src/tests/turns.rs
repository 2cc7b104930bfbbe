//! Turns: avatars that try in vain to fall silent do not keep others from their turn.

use std::{ops::Range, time::Duration};

use glam::Vec3;
use sightline_world::{
    CellId, Node, World,
    geometry::Aabb,
    motion::{AvatarId, ReportingState},
};

use super::stage::{Stage, world};
use crate::{Config, Margin};

const CELL_M: f32 = 10.0;
/// The wall between two rooms, in metres.
const WALL_M: f32 = 1.0;
/// The number of long rooms: three cells in a row, each of which sees its neighbours.
const LONG: u32 = 20;
const CELLS: u32 = 3;
/// How far an avatar is from the middle cell, in metres. It does not see into that cell, but soon
/// could.
const AWAY_M: f32 = 1.1;
/// The number of closed rooms of one cell. By the PVS they see each other in pairs, but every line
/// is blocked.
const CLOSED: u32 = 12;
const FIRST_CLOSED: u32 = LONG * CELLS;
/// Avatars in closed rooms have the ids from this one on.
const FIRST_HIDDEN: u32 = 2 * LONG;

/// All rooms, in a row along x.
fn building() -> World {
    let (mut tree, mut cells, mut x) = (Vec::new(), Vec::new(), 0.0);
    for id in 0..FIRST_CLOSED + CLOSED {
        let low = Vec3::new(x, 0.0, 0.0);
        x += CELL_M;
        cells.push(Aabb::new(low, Vec3::new(x, 3.0, CELL_M)));
        put(&mut tree, x, Node::Leaf(CellId(id)));
        if room(id) != room(id + 1) {
            x += WALL_M;
            put(&mut tree, x, Node::Solid);
        }
    }
    tree.push(Node::Solid);
    let is_closed = |cell: u32| cell >= FIRST_CLOSED;
    world(tree, cells, |a, b| {
        a.abs_diff(b) == 1 && (room(a) == room(b) || is_closed(a) && room(a) / 2 == room(b) / 2)
    })
}

fn room(cell: u32) -> u32 {
    (cell / CELLS).min(LONG) + cell.saturating_sub(FIRST_CLOSED)
}

/// Adds a leaf that extends along x up to a coordinate.
fn put(tree: &mut Vec<Node>, at: f32, what: Node) {
    let next = tree.len() as u32 + 1;
    tree.extend([Node::Axial { axis: 0, at, sides: [next, next + 1] }, what]);
}

/// Two avatars at the ends of each long room, which try at each tick, and one in each closed room.
fn crowd(silence_budget: u32) -> Stage {
    let margin = Margin::Fixed(Duration::ZERO);
    let silence_retry = Duration::ZERO;
    let config = Config { silence_budget, silence_retry, margin, ..Config::default() };
    let mut stage = Stage::new(building(), config);
    let cells = &stage.engine.world().cells.cells;
    let starts: Vec<f32> = cells.iter().map(|cell| cell.bounds.min.x).collect();
    for room in 0..LONG {
        let start = starts[(room * CELLS) as usize];
        stage.join(2 * room, start + CELL_M - AWAY_M);
        stage.join(2 * room + 1, start + 2.0 * CELL_M + AWAY_M);
    }
    for (id, start) in (FIRST_HIDDEN..).zip(&starts[FIRST_CLOSED as usize..]) {
        stage.join(id, start + 0.5 * CELL_M);
    }
    stage
}

/// How many of the avatars with these ids are silent.
fn quiet(stage: &Stage, ids: Range<u32>) -> usize {
    let is_quiet = |id: &u32| stage.engine.state(AvatarId(*id)) == Some(ReportingState::Quiet);
    ids.filter(is_quiet).count()
}

#[test]
fn every_avatar_gets_its_turn_though_others_use_up_the_budget_at_each_tick() {
    let (restless, hidden) = (0..FIRST_HIDDEN, FIRST_HIDDEN..FIRST_HIDDEN + CLOSED);
    let mut stage = crowd(Config::default().silence_budget);
    stage.tick();
    let silent = [restless.clone(), hidden.clone()].map(|ids| quiet(&stage, ids));
    assert_eq!(silent, [0, CLOSED as usize], "with enough budget, all fall silent at once");
    // The avatars in long rooms want twice as much at each tick.
    let mut stage = crowd(2_000);
    for tick in 0..40 {
        stage.tick();
        assert_eq!(stage.engine.silence_budget.left, 0, "at tick {tick}");
    }
    let silent = [restless, hidden].map(|ids| quiet(&stage, ids));
    assert_eq!(silent, [0, CLOSED as usize]);
}
