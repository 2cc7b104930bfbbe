//! Rooms of an author, and what they do to interest and silence.

use std::collections::BTreeSet;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{
    World,
    geometry::Aabb,
    motion::{AvatarId, ReportingState},
    rooms::{ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
};

use super::stage::{Stage, row};
use crate::{Config, Input, Output, Policy, Reason};

fn room(name: &str, min: [f32; 3], max: [f32; 3]) -> Room {
    let shapes = vec![Shape::Box(Aabb::new(Vec3::from(min), Vec3::from(max)))];
    Room { name: name.to_owned(), shapes, ..Room::default() }
}

/// Five cells in a row, of 10 m each. The second has a private corner. The fourth does not see the
/// fifth, and the fifth sees the others only through a window.
pub(super) fn world() -> World {
    let corner = Room { sealed: true, ..room("corner", [12.0, 0.0, 2.0], [18.0, 3.0, 8.0]) };
    let hidden = ObjectSet { rooms: vec![RoomId(2)], ..ObjectSet::default() };
    let fourth = Room {
        sees: RoomVisibility::AllBut(hidden),
        ..room("fourth", [30.0, 0.0, 0.0], [40.0, 3.0, 10.0])
    };
    let pane = [[1.0, 4.0], [3.0, 4.0], [3.0, 6.0], [1.0, 6.0]];
    let window = Window {
        name: "west".to_owned(),
        corners: pane.map(|[y, z]| Vec3::new(40.0, y, z)).into(),
        behind: None,
    };
    let fifth =
        Room { windows: vec![window], ..room("fifth", [40.0, 0.0, 0.0], [50.0, 3.0, 10.0]) };
    World { rooms: Rooms::new(vec![corner, fourth, fifth], Vec::new()).unwrap(), ..row(5) }
}

fn sees(stage: &Stage, viewer: AvatarId) -> Vec<u32> {
    stage.client(viewer).sees.keys().map(|id| id.0).collect()
}

fn reason(stage: &Stage, viewer: AvatarId, avatar: AvatarId) -> Reason {
    stage.engine.explain(viewer, avatar).unwrap().reason
}

#[test]
fn a_hidden_set_takes_away_what_cells_give_one_way() {
    let mut stage = Stage::prompt(world());
    let (ada, bob) = (stage.join(1, 35.0), stage.join(2, 45.0));
    stage.ticks(5);
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![], vec![1]));
    assert_eq!(reason(&stage, ada, bob), Reason::Rooms);
    assert!(matches!(reason(&stage, bob, ada), Reason::Free(_)));
    // Beside the window, Ada is not in what the window shows.
    let cleo = stage.join_at(3, Vec3::new(40.5, 1.6, 9.0));
    let dora = stage.join_at(4, Vec3::new(39.0, 1.6, 9.5));
    stage.ticks(5);
    assert!(!sees(&stage, cleo).contains(&dora.0) && sees(&stage, cleo).contains(&bob.0));
    // Without rooms cells alone decide.
    let mut plain = Stage::prompt(row(5));
    let (ada, bob) = (plain.join(1, 35.0), plain.join(2, 45.0));
    plain.ticks(5);
    assert_eq!((sees(&plain, ada), sees(&plain, bob)), (vec![2], vec![1]));
}

#[test]
fn avatars_in_a_sealed_room_are_told_of_inside_only_under_every_policy() {
    for policy in [Policy::Tbv, Policy::Pvs, Policy::Broadcast] {
        let mut stage = Stage::new(world(), Config { policy, ..Config::default() });
        let (ada, bob, cleo) = (stage.join(1, 15.0), stage.join(2, 16.0), stage.join(3, 11.0));
        stage.ticks(5);
        let seen = [ada, bob, cleo].map(|id| sees(&stage, id));
        assert_eq!(seen, [vec![2], vec![1], vec![]], "{policy}");
        if policy != Policy::Broadcast {
            assert_eq!(reason(&stage, cleo, ada), Reason::Sealed);
        }
        // An avatar that comes in is told of the others, and they of it.
        stage.walk(cleo, 15.5);
        stage.ticks(2);
        assert_eq!((sees(&stage, cleo), sees(&stage, ada)), (vec![1, 2], vec![2, 3]), "{policy}");
    }
}

#[test]
fn an_avatar_behind_a_sealed_wall_keeps_nobody_from_falling_silent() {
    let mut stage = Stage::prompt(world());
    let config = Config { horizon_max: std::time::Duration::ZERO, ..stage.engine.config().clone() };
    stage = Stage::new(world(), config);
    // At 2 m/s nobody leaves the corner from its middle within a little more than a second.
    let (ada, bob) = (stage.join(1, 15.0), stage.join(2, 24.0));
    stage.ticks(40);
    for avatar in [ada, bob] {
        assert_eq!(stage.engine.state(avatar), Some(ReportingState::Quiet), "{avatar:?}");
    }
    let mut plain = Stage::new(row(5), stage.engine.config().clone());
    let (ada, _) = (plain.join(1, 15.0), plain.join(2, 24.0));
    plain.ticks(40);
    assert_eq!(plain.engine.state(ada), Some(ReportingState::Live));
}

#[test]
fn an_opaque_room_hides_whom_no_window_before_it_shows() {
    // The screen stands across the third cell, from wall to wall.
    let told = |window_x: Option<f32>| {
        let pane = [[1.0, 2.0], [2.5, 2.0], [2.5, 8.0], [1.0, 8.0]];
        let window = |x: f32| Window {
            name: "pane".to_owned(),
            corners: pane.map(|[y, z]| Vec3::new(x, y, z)).into(),
            behind: None,
        };
        let screen = Room {
            opaque: true,
            windows: window_x.map(window).into_iter().collect(),
            ..room("screen", [22.0, 0.0, 0.0], [24.0, 3.0, 10.0])
        };
        let rooms = Rooms::new(vec![screen], Vec::new()).unwrap();
        let mut stage = Stage::prompt(World { rooms, ..row(5) });
        let (ada, bob) = (stage.join(1, 15.0), stage.join(2, 28.0));
        stage.ticks(5);
        let told = [sees(&stage, ada), sees(&stage, bob)];
        if told[0].is_empty() {
            assert_eq!(reason(&stage, ada, bob), Reason::Rooms);
        }
        // Who walks into the screen is beside nobody's wall any more.
        stage.walk(bob, 23.0);
        stage.ticks(2);
        assert_eq!(sees(&stage, ada), [2]);
        told
    };
    assert_eq!(told(None), [[], []] as [[u32; 0]; 2]);
    assert_eq!(told(Some(22.0)), [vec![2], vec![]], "the window faces Ada");
    assert_eq!(told(Some(24.0)), [vec![], vec![1]], "the window faces Bob");
}

/// Eight people who walk about, in and out of the corner, and talk.
struct Crowd {
    stage: Stage,
    index: RoomIndex,
    random: SmallRng,
    goals: Vec<Vec3>,
    /// The avatars that may hear each chat message.
    said: Vec<BTreeSet<AvatarId>>,
}

const PEOPLE: u32 = 8;

impl Crowd {
    fn new(seed: u64) -> Self {
        let mut random = SmallRng::seed_from_u64(seed);
        let world = world();
        let index = RoomIndex::new(&world);
        let mut stage = Stage::prompt(world);
        let goals = (0..PEOPLE).map(|id| {
            let at = place(&mut random);
            stage.join_at(id, at);
            at
        });
        let goals = goals.collect();
        Self { stage, index, random, goals, said: Vec::new() }
    }

    fn step(&mut self) {
        for (id, goal) in (0..).map(AvatarId).zip(&mut self.goals) {
            let eye = &mut self.stage.clients.get_mut(&id).unwrap().eye;
            if eye.distance(*goal) < 0.1 {
                *goal = place(&mut self.random);
            }
            *eye += (*goal - *eye).clamp_length_max(0.095);
        }
        let before = self.stage.log.len();
        self.stage.tick();
        self.check(before);
        let speaker = AvatarId(self.random.random_range(0..PEOPLE));
        let text = self.said.len().to_string();
        self.stage.engine.handle(self.stage.now, Input::Chat { avatar: speaker, text });
        let agrees = |id: &AvatarId| self.agree(*id, speaker);
        let hearers = (0..PEOPLE).map(AvatarId).filter(agrees).collect();
        self.said.push(hearers);
    }

    fn agree(&self, one: AvatarId, other: AvatarId) -> bool {
        let seal =
            |id: AvatarId| self.index.sealed_rooms_at(self.stage.engine.pose(id).unwrap().eye);
        seal(one).agrees(&seal(other))
    }

    /// Checks that no output tells a client of an avatar behind a seal, and that every avatar that
    /// the rooms show is told of.
    fn check(&self, before: usize) {
        for output in &self.stage.log[before..] {
            match output {
                Output::Appear { to, avatar, .. } => assert!(self.agree(*to, *avatar)),
                Output::Poses { to, poses, .. } => {
                    assert!(poses.iter().all(|(avatar, _)| self.agree(*to, *avatar)));
                }
                Output::Chat { to, text, .. } => {
                    assert!(self.said[text.parse::<usize>().unwrap()].contains(to));
                }
                _ => {}
            }
        }
        let world = self.stage.engine.world();
        let place = |region: &Aabb| self.index.overlap(&world.cells, &[*region]);
        for (id, client) in &self.stage.clients {
            assert!(
                client.sees.keys().all(|other| self.agree(*id, *other)),
                "no avatar behind a seal is held"
            );
            for (other, seen) in self.stage.clients.iter().filter(|(other, _)| *other != id) {
                let body = world.body.around(seen.eye);
                let by_cells = world.cells.at(client.eye).zip(world.cells.at(seen.eye));
                let is_seen = self.agree(*id, *other)
                    && by_cells.is_some_and(|(from, to)| world.cells.sees(from, to))
                    && self.index.may_see(&place(&Aabb::around(client.eye, 0.0)), &place(&body));
                assert!(!is_seen || client.sees.contains_key(other), "{id:?} misses {other:?}");
            }
        }
    }
}

fn place(random: &mut SmallRng) -> Vec3 {
    // Half of the places are near the corner, so that avatars often go through it.
    let across = if random.random_bool(0.5) { 8.0..22.0 } else { 0.5..49.5 };
    Vec3::new(random.random_range(across), 1.6, random.random_range(0.5..9.5))
}

/// No pose, appearance, name or chat leaks, and no avatar is missed that the rooms show.
#[test]
fn a_sealed_room_leaks_nothing_in_a_thousand_walks() {
    let (mut inside, mut told) = (0, 0);
    for seed in 0..1_000 {
        let mut crowd = Crowd::new(seed);
        for _ in 0..40 {
            crowd.step();
            let stage = &crowd.stage;
            inside += stage
                .clients
                .values()
                .filter(|c| !crowd.index.sealed_rooms_at(c.eye).is_open())
                .count();
            told += stage.clients.values().map(|client| client.sees.len()).sum::<usize>();
        }
    }
    assert!(inside > 10_000 && told > 100_000, "{inside} inside, {told} told");
}
