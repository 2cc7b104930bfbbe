//! Walls: an avatar that goes through a wall is put back. One that goes through the door beside it,
//! or that the host puts elsewhere, is not.

use glam::Vec3;
use sightline_world::motion::{AvatarId, Pose};

use super::stage::{Stage, narrow, row};
use crate::Input;

/// Two rooms with a door of a metre at one end of the wall, and an avatar in the first, 5 m from
/// it.
fn before_a_wall() -> (Stage, AvatarId) {
    let mut world = row(2);
    narrow(&mut world, 0, 2, [0.0, 1.0]);
    let mut stage = Stage::prompt(world);
    let ada = stage.join(1, 9.9);
    stage.join(2, 15.0);
    stage.tick();
    (stage, ada)
}

fn go(stage: &mut Stage, who: AvatarId, eye: Vec3) {
    stage.clients.get_mut(&who).unwrap().eye = eye;
    stage.tick();
}

#[test]
fn a_client_that_walks_through_a_wall_is_put_back_each_time_and_dropped_in_the_end() {
    let (mut stage, ada) = before_a_wall();
    let here = stage.client(ada).eye;
    for times in 1..=5 {
        stage.ticks(4);
        go(&mut stage, ada, here + Vec3::X * 0.2);
        assert_eq!(stage.client(ada).corrections, times);
        assert_eq!(stage.engine.pose(ada).unwrap().eye, here);
        go(&mut stage, ada, here);
    }
    let stats = stage.engine.stats();
    assert_eq!((stats.refusals, stats.walls), (5, 5));
    stage.clients.get_mut(&ada).unwrap().eye.x += 0.2;
    stage.ticks(30);
    assert!(stage.client(ada).dropped.is_some());
}

#[test]
fn a_long_silence_allows_a_detour_through_a_door_but_not_a_way_through_a_wall() {
    for (door, refused) in [([0.0, 1.0], 0), ([0.0, 0.0], 1)] {
        let mut world = row(2);
        narrow(&mut world, 0, 2, door);
        if door[1] == 0.0 {
            world.cells.spaces.iter_mut().for_each(|space| space.gates.clear());
            world.cells.cells.iter_mut().for_each(|cell| cell.portals.clear());
        }
        let mut stage = Stage::prompt(world);
        let ada = stage.join(1, 9.9);
        stage.tick();
        let mut gone = stage.clients.remove(&ada).unwrap();
        // The way round by the door is eight metres.
        stage.ticks(90);
        let pose = Pose { eye: Vec3::new(10.1, 1.6, 5.0), ..Pose::default() };
        let report = gone.report(ada, stage.now, pose);
        stage.engine.handle(stage.now, report);
        assert_eq!(stage.engine.stats().walls, refused, "door {door:?}");
    }
}

#[test]
fn a_door_and_the_host_lead_to_the_other_side() {
    let (mut stage, ada) = before_a_wall();
    for eye in [Vec3::new(9.9, 1.6, 0.9), Vec3::new(10.1, 1.6, 0.9), Vec3::new(10.1, 1.6, 5.0)] {
        while stage.client(ada).eye.distance(eye) > 1e-3 {
            let step = (eye - stage.client(ada).eye).clamp_length_max(0.095);
            let eye = stage.client(ada).eye + step;
            go(&mut stage, ada, eye);
        }
    }
    assert_eq!(stage.engine.stats().refusals, 0);
    let eye = Vec3::new(9.9, 1.6, 5.0);
    let pose = Pose { eye, ..Pose::default() };
    stage.engine.handle(stage.now, Input::Relocate { avatar: ada, pose });
    go(&mut stage, ada, eye);
    assert_eq!((stage.engine.stats().refusals, stage.engine.pose(ada).unwrap().eye), (0, eye));
    stage.ticks(4);
    go(&mut stage, ada, eye + Vec3::X * 0.2);
    assert_eq!(stage.engine.stats().walls, 1, "walls count again from there on");
}
