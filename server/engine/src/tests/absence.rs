//! Clients whose links break.

use glam::Vec3;
use sightline_world::motion::{AvatarId, ReportingState};

use super::stage::{Client, Stage, row};
use crate::{Input, Output, bit_set::BitSet, claims::Clearance};

/// The link of a client breaks: it neither hears nor says anything.
fn lose(stage: &mut Stage, avatar: AvatarId) -> Client {
    stage.engine.handle(stage.now, Input::Absent { avatar });
    stage.clients.remove(&avatar).unwrap()
}

/// A client comes back, or another one in its place, which knows nothing.
fn come_back(stage: &mut Stage, avatar: AvatarId, eye: Vec3) {
    stage.engine.handle(stage.now, Input::Return { avatar, place: Some(eye) });
    stage.clients.insert(avatar, Client { eye, ..Client::default() });
}

#[test]
fn an_absent_avatar_stands_in_sight_and_comes_back_unnoticed() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 14.0));
    stage.walk(bob, 14.9);
    stage.clients.get_mut(&bob).unwrap().eye.x += 0.09;
    stage.tick();
    assert!(stage.client(ada).sees[&bob].velocity.x > 1.0, "he walks");
    lose(&mut stage, bob);
    let log = stage.log.len();
    stage.ticks(1_200);
    let stands = stage.client(ada).sees[&bob];
    assert!((stands.eye.x - 15.0).abs() < 0.2 && stands.velocity == Vec3::ZERO, "{stands:?}");
    assert_eq!(stage.engine.state(bob), Some(ReportingState::Live), "a minute later");
    let expects = |output: &&Output| match output {
        Output::Ask { to } | Output::Live { to, .. } | Output::Quiet { to, .. } => *to == bob,
        Output::Drop { .. } => true,
        _ => false,
    };
    let expected: Vec<&Output> = stage.log[log..].iter().filter(expects).collect();
    assert!(expected.is_empty(), "nothing is expected of nobody: {expected:?}");
    // Cy comes near, and is told of him.
    let cy = stage.join(3, 25.0);
    stage.ticks(2);
    assert!(stage.client(cy).sees.contains_key(&bob));

    let log = stage.log.len();
    come_back(&mut stage, bob, stands.eye);
    stage.ticks(2);
    assert_eq!(stage.client(bob).sees.len(), 2, "he is told anew who is in sight");
    let others = stage.log[log..].iter().filter(|output| output.to() != bob);
    let notices = |output: &Output| matches!(output, Output::Appear { .. } | Output::Vanish { .. });
    assert!(!others.into_iter().any(notices), "{:?}", &stage.log[log..]);
    stage.walk(bob, 17.0);
    assert_eq!(stage.client(bob).corrections, 0);
    assert!((stage.client(ada).sees[&bob].eye.x - 17.0).abs() < 0.1, "he walks on");
    stage.leave(bob);
    stage.tick();
    assert!(stage.client(ada).sees.is_empty());
}

#[test]
fn who_was_quiet_comes_back_where_it_was() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 75.0));
    stage.tick();
    assert_eq!(stage.engine.state(bob), Some(ReportingState::Quiet));
    let region = stage.engine.whereabouts(bob).unwrap();
    lose(&mut stage, bob);
    stage.ticks(100);
    let place = Vec3::new(74.0, 1.6, 5.0);
    assert!(region.contains(place));
    come_back(&mut stage, bob, place);
    stage.ticks(50);
    assert_eq!((stage.client(bob).eye, stage.client(bob).corrections), (place, 0));
    assert_eq!(stage.engine.state(bob), Some(ReportingState::Quiet), "out of sight again");
    assert!(stage.client(ada).sees.is_empty());
}

#[test]
fn nobody_comes_back_behind_a_wall() {
    let mut stage = Stage::prompt(row(8));
    let bob = stage.join(2, 9.5);
    // No body fits through from the first cell into the second.
    let mut gates = BitSet::default();
    gates.insert(0);
    stage.engine.building.walkways.clearance = Clearance::with_narrow_gates(gates);
    stage.tick();
    for (claimed, found) in [(10.5, 9.5), (9.0, 9.0), (10.5, 9.0)] {
        lose(&mut stage, bob);
        stage.tick();
        come_back(&mut stage, bob, Vec3::new(claimed, 1.6, 5.0));
        stage.tick();
        assert_eq!(stage.engine.pose(bob).map(|pose| pose.eye.x), Some(found), "{claimed}");
    }
}

/// Another client takes the avatar over while the first one is still connected. Its clock begins
/// anew.
#[test]
fn another_client_takes_an_avatar_over() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 15.0));
    stage.ticks(10);
    let place = stage.client(bob).eye;
    come_back(&mut stage, bob, place);
    stage.ticks(10);
    stage.walk(bob, 16.0);
    assert_eq!((stage.client(bob).sees.len(), stage.client(bob).corrections), (1, 0));
    assert!((stage.client(ada).sees[&bob].eye.x - 16.0).abs() < 1e-2);
}
