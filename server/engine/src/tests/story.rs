//! Stories of a few people in a row of rooms.

use std::time::Duration;

use glam::Vec3;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState},
};

use super::stage::{Client, Stage, TICK, row};
use crate::{Config, Input, Margin, Output, Policy, Reason, TbvShape, Validity};

fn sees(stage: &Stage, viewer: AvatarId) -> Vec<u32> {
    let told: Vec<u32> = stage.client(viewer).sees.keys().map(|id| id.0).collect();
    let held: Vec<u32> = stage.engine.held_by(viewer).map(|id| id.0).collect();
    assert_eq!(told, held, "the client knows just what the engine thinks it knows");
    told
}

fn is_quiet(stage: &Stage, avatar: AvatarId) -> bool {
    let quiet = stage.engine.state(avatar) == Some(ReportingState::Quiet);
    assert_eq!(stage.client(avatar).quiet, stage.engine.tbv(avatar).filter(|_| quiet));
    quiet
}

#[test]
fn two_meet_part_fall_silent_meet_again_and_leave() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 15.0));
    stage.tick();
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![2], vec![1]));
    assert_eq!(stage.engine.counts().live, 2);

    stage.walk(bob, 16.0);
    assert!((stage.client(ada).sees[&bob].eye.x - 16.0).abs() < 1e-3, "its moves are told");

    // Room 3 is out of sight of room 0, and of all that either can reach within a second.
    stage.walk(bob, 35.0);
    stage.ticks(10);
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![], vec![]));
    assert!(is_quiet(&stage, ada) && is_quiet(&stage, bob));

    // While both stand still out of sight, each answers about once a second.
    let (reports, log) = (stage.reports, stage.log.len());
    stage.ticks(100);
    let answers = stage.reports - reports;
    assert!((8..=16).contains(&answers), "{answers} reports in 5 s");
    assert!(stage.log.len() - log <= 2 * answers + 2, "an ask and a new TBV for each");
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![], vec![]));

    // Bob comes back; Ada is asked before she can be seen and then reports again.
    stage.walk(bob, 15.0);
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![2], vec![1]));
    assert_eq!(stage.engine.state(ada), Some(ReportingState::Live));
    assert!(stage.client(ada).quiet.is_none());
    assert!(stage.engine.stats().reveals > 0);

    stage.leave(bob);
    stage.tick();
    assert_eq!(sees(&stage, ada), Vec::<u32>::new());
    assert_eq!(stage.engine.state(bob), None);
    stage.ticks(2);
    assert!(is_quiet(&stage, ada), "alone again");
}

#[test]
fn nothing_is_said_while_a_tbv_lasts() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 75.0));
    stage.tick();
    assert!(is_quiet(&stage, ada) && is_quiet(&stage, bob));
    let log = stage.log.len();
    stage.ticks(15);
    assert_eq!(&stage.log[log..], [], "no message either way for three quarters of a second");
    assert_eq!(stage.reports, 2, "only the first");
}

#[test]
fn an_avatar_is_asked_when_its_tbv_is_in_view_and_sent_only_if_it_is_there() {
    // Cy stands where Bob's TBV reaches but Bob himself does not.
    let mut stage = Stage::prompt(row(8));
    let bob = stage.join(2, 31.9);
    stage.tick();
    assert!(is_quiet(&stage, bob), "alone");
    let cy = stage.join(3, 15.0);
    stage.tick();
    assert_eq!(stage.engine.stats().reveals, 1, "his TBV meets room 2");
    assert_eq!(stage.engine.state(bob), Some(ReportingState::Asked));
    assert_eq!(sees(&stage, cy), Vec::<u32>::new());
    stage.ticks(5);
    assert_eq!(sees(&stage, cy), Vec::<u32>::new(), "his place was not sent");
    assert_eq!(
        stage.engine.state(bob),
        Some(ReportingState::Live),
        "his next TBV would be in view"
    );
}

#[test]
fn clients_are_asked_in_time_before_an_expiry_and_asked_again() {
    let mut stage = Stage::prompt(row(8));
    let ada = stage.join(1, 5.0);
    stage.tick();
    let tbv = stage.engine.tbv(ada).unwrap();
    let within = Aabb::around(Vec3::new(5.0, 1.6, 5.0), 2.01);
    assert_eq!(tbv.within, within, "two metres each way, and what rounding takes");
    while stage.engine.stats().expiries == 0 {
        stage.tick();
    }
    let asked_at = stage.now - TICK;
    assert!(asked_at + 2 * TICK <= tbv.expiry && asked_at + 5 * TICK >= tbv.expiry);

    // Ada does not answer. She is asked again, then dropped.
    let log = stage.log.len();
    for _ in 0..900 {
        stage.clients.get_mut(&ada).unwrap().asked = false;
        stage.tick();
    }
    let asks = stage.log[log..].iter().filter(|o| matches!(o, Output::Ask { .. })).count();
    assert_eq!(asks as u32 + 1, Config::default().asks_max);
    assert!(stage.client(ada).dropped.is_some());
    assert_eq!(stage.engine.state(ada), None);
}

#[test]
fn a_host_that_ticks_too_seldom_to_hear_anybody_drops_nobody() {
    let mut stage = Stage::prompt(row(2));
    let ada = stage.join(1, 5.0);
    stage.tick();
    stage.clients.remove(&ada).unwrap();
    for _ in 0..100 {
        stage.now += Duration::from_secs(3);
        stage.tick();
        let passed = (stage.now.as_millis() / TICK.as_millis()) as u32;
        assert_eq!(stage.engine.ticks(), passed, "numbers follow the time");
    }
    assert!(stage.engine.state(ada).is_some() && stage.engine.stats().drops == 0);
}

#[test]
fn a_live_client_that_falls_silent_is_asked_and_then_dropped() {
    let mut stage = Stage::prompt(row(2));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 15.0));
    stage.tick();
    let gone = stage.clients.remove(&ada).unwrap();
    stage.ticks(25);
    assert!(stage.log.contains(&Output::Ask { to: ada }));
    stage.ticks(900);
    assert_eq!(stage.engine.state(ada), None);
    assert_eq!(sees(&stage, bob), Vec::<u32>::new(), "and those who saw her are told");
    assert!(gone.dropped.is_none() && stage.engine.stats().drops == 1);
}

#[test]
fn a_tbv_lasts_until_its_client_leaves_and_leaving_unsaid_is_refused() {
    let config = Config {
        margin: Margin::Fixed(Duration::ZERO),
        ..Stage::prompt(row(2)).engine.config().clone()
    };
    let config = Config { validity: Validity::UntilLeft, shape: TbvShape::Reach, ..config };
    let mut stage = Stage::new(row(8), config);
    let ada = stage.join(1, 5.0);
    stage.ticks(3);
    let tbv = stage.engine.tbv(ada).unwrap();
    assert!(tbv.notice >= 3 * TICK && is_quiet(&stage, ada));
    // Pacing to and fro in it, she is silent until the TBV expires after eight seconds.
    let reports = stage.reports;
    for x in [5.5, 5.0, 4.5, 5.0] {
        stage.walk(ada, x);
    }
    assert_eq!(stage.reports, reports);
    // On her way through the building she reports in time whenever she leaves a TBV.
    stage.walk(ada, 35.0);
    let left = stage.reports - reports;
    assert!((5..30).contains(&left), "{left} reports in 30 m");
    assert_eq!((stage.client(ada).corrections, stage.engine.stats().refusals), (0, 0));
    stage.ticks(2);
    let tbv = stage.engine.tbv(ada).unwrap();
    assert!(tbv.contains(stage.client(ada).eye));

    // A client that leaves unsaid is put back, though its speed limit allows the distance.
    let client = stage.clients.get_mut(&ada).unwrap();
    let eye = Vec3::new(tbv.within.max.x + 0.5, 1.6, 5.0);
    let pose = Pose { eye, ..Pose::default() };
    stage.now += Duration::from_secs(4);
    let report = client.report(ada, stage.now, pose);
    stage.engine.handle(stage.now, report);
    assert_eq!(stage.engine.stats().refusals, 1);
    assert!(tbv.contains(stage.engine.pose(ada).unwrap().eye));
}

#[test]
fn a_quiet_client_may_report_and_its_claim_is_judged() {
    let mut stage = Stage::prompt(row(8));
    let ada = stage.join(1, 5.0);
    stage.ticks(4);
    let tbv = stage.engine.tbv(ada).unwrap();
    let report = |stage: &mut Stage, x: f32| {
        let pose = Pose { eye: Vec3::new(x, 1.6, 5.0), ..Pose::default() };
        let report = stage.clients.get_mut(&ada).unwrap().report(ada, stage.now, pose);
        stage.engine.handle(stage.now, report);
    };
    report(&mut stage, 5.2);
    stage.tick();
    assert_eq!(stage.engine.tbv(ada), Some(tbv), "inside: taken in, and silent as before");
    assert_eq!(stage.engine.pose(ada).unwrap().eye.x, 5.2);
    report(&mut stage, 9.0);
    stage.tick();
    assert_eq!(stage.client(ada).corrections, 1);
    assert_eq!(stage.engine.pose(ada).unwrap().eye.x, 5.2);
    // A report that arrives just before the ask counts as the answer.
    while stage.now + 3 * TICK <= tbv.expiry {
        stage.tick();
    }
    assert_eq!((stage.engine.tbv(ada), stage.engine.stats().expiries), (Some(tbv), 0));
    report(&mut stage, 6.4);
    stage.tick();
    assert_eq!(stage.engine.tbv(ada).unwrap().within.centre().x, 6.4);
    assert_eq!(stage.engine.stats().expiries, 0);
}

#[test]
fn an_avatar_that_the_host_puts_elsewhere_is_seen_there() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 75.0));
    stage.ticks(3);
    assert!(is_quiet(&stage, bob));
    let eye = Vec3::new(12.0, 1.6, 5.0);
    let pose = Pose { eye, ..Pose::default() };
    stage.clients.get_mut(&bob).unwrap().eye = eye;
    stage.engine.handle(stage.now, Input::Relocate { avatar: bob, pose });
    stage.ticks(2);
    assert_eq!((sees(&stage, ada), sees(&stage, bob)), (vec![2], vec![1]));
    let nowhere = Pose { eye: Vec3::splat(f32::NAN), ..Pose::default() };
    stage.engine.handle(stage.now, Input::Relocate { avatar: bob, pose: nowhere });
    assert_eq!(stage.engine.pose(bob).unwrap().eye, eye);
}

#[test]
fn an_avatar_that_respawns_is_at_a_spawn_point_and_seen_there_alone() {
    let mut stage = Stage::prompt(row(8));
    let spawn = stage.engine.world().spawns[0];
    let (ada, bob) = (stage.join(1, spawn.eye.x), stage.join(2, 75.0));
    let cy = stage.join(3, 74.0);
    stage.ticks(3);
    assert_eq!((sees(&stage, ada), sees(&stage, cy)), (vec![], vec![2]));
    stage.clients.get_mut(&bob).unwrap().eye = spawn.eye;
    stage.engine.handle(stage.now, Input::Respawn { avatar: bob });
    stage.ticks(3);
    assert_eq!(stage.engine.pose(bob).unwrap().eye, spawn.eye);
    assert_eq!(stage.clients[&bob].corrections, 1, "its client is told once");
    assert_eq!((sees(&stage, ada), sees(&stage, cy)), (vec![2], vec![]));
    stage.engine.handle(stage.now, Input::Respawn { avatar: AvatarId(99) });
}

#[test]
fn chat_reaches_all_who_see_the_speaker_and_the_speaker() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob, cy) = (stage.join(1, 5.0), stage.join(2, 15.0), stage.join(3, 45.0));
    stage.tick();
    let text = "x".repeat(1_000);
    stage.engine.handle(stage.now, Input::Chat { avatar: bob, text });
    stage.engine.handle(stage.now, Input::Chat { avatar: AvatarId(99), text: "?".to_owned() });
    stage.tick();
    let heard = |who| stage.client(who).heard.iter().map(String::len).collect::<Vec<_>>();
    assert_eq!((heard(ada), heard(bob), heard(cy)), (vec![256], vec![256], vec![]));
}

#[test]
fn an_avatar_that_asks_for_a_spawn_point_faces_as_the_spawn_point_says() {
    let mut stage = Stage::new(row(2), Config::default());
    let spawns = stage.engine.world().spawns.clone();
    let rounded = stage.join_at(1, spawns[1].eye + Vec3::splat(0.001));
    let beside = stage.join_at(2, spawns[1].eye + Vec3::Z);
    let yaw = |avatar| stage.engine.pose(avatar).unwrap().yaw;
    assert_eq!((yaw(rounded), yaw(beside)), (spawns[1].yaw, 0.0));
}

#[test]
fn joins_are_placed_bounded_and_never_doubled() {
    let config = Config { avatars_max: 3, ..Config::default() };
    let mut stage = Stage::new(row(2), config);
    let spawns = stage.engine.world().spawns.clone();
    let ada = stage.join_at(1, Vec3::new(f32::NAN, 0.0, 0.0));
    let bob = stage.join_at(2, Vec3::new(500.0, 0.0, 0.0));
    assert_eq!(stage.engine.pose(ada).unwrap().eye, spawns[0].eye);
    assert_eq!(stage.engine.pose(bob).unwrap().eye, spawns[1].eye);
    let name = "ß".repeat(100);
    let join = Input::Join { avatar: ada, name: name.clone(), colour: [0; 3], place: None };
    stage.engine.handle(stage.now, join);
    let cy = AvatarId(3);
    let join = Input::Join { avatar: cy, name, colour: [0; 3], place: None };
    stage.engine.handle(stage.now, join);
    assert_eq!(stage.engine.pose(cy).unwrap().eye, spawns[0].eye);
    let full = stage.join(4, 5.0);
    stage.tick();
    assert!(stage.client(full).dropped.is_some());
    assert_eq!(stage.engine.avatars().count(), 3);
    assert!(stage.log.iter().any(|o| matches!(o, Output::Appear { avatar, name, .. }
        if *avatar == cy && name.chars().count() == 32)));
    // Inputs about avatars that are not present are ignored.
    stage.engine.handle(stage.now, Input::Leave { avatar: full });
    let report = Client::default().report(full, stage.now, Pose::default());
    stage.engine.handle(stage.now, report);
    let round_trip = Duration::MAX;
    stage.engine.handle(stage.now, Input::RoundTrip { avatar: full, round_trip });
}

#[test]
fn a_client_that_persists_in_false_claims_is_dropped() {
    let mut stage = Stage::prompt(row(2));
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 15.0));
    stage.tick();
    stage.clients.get_mut(&ada).unwrap().eye.x = 19.0;
    stage.ticks(19);
    assert_eq!(stage.client(bob).sees[&ada].eye.x, 5.0, "no claim came through");
    assert!(stage.client(ada).dropped.is_none());
    stage.ticks(2);
    assert!(stage.client(ada).dropped.is_some());
    assert_eq!(sees(&stage, bob), Vec::<u32>::new());
}

#[test]
fn other_policies_know_no_walls_and_no_silence() {
    for (policy, seen) in [
        (Policy::Broadcast, vec![2, 3, 4]),
        (Policy::Radius(30.0), vec![2, 3]),
        (Policy::Grid(12.0), vec![2]),
        (Policy::Region { edge: 12.0, margin: 1.5 }, vec![2]),
        (Policy::Room { doors: 0 }, vec![2, 3, 4]),
        (Policy::Pvs, vec![2]),
        (Policy::Tbv, vec![2]),
    ] {
        let mut stage = Stage::new(row(8), Config { policy, ..Config::default() });
        let ada = stage.join(1, 5.0);
        let (_, _, eve) = (stage.join(2, 13.0), stage.join(3, 34.0), stage.join(4, 75.0));
        stage.ticks(20);
        assert_eq!(sees(&stage, ada), seen, "{policy}");
        assert_eq!(is_quiet(&stage, eve), policy == Policy::Tbv, "{policy}");
    }
}

#[test]
fn explanations_name_what_decided() {
    let mut stage = Stage::prompt(row(8));
    let (ada, bob, cy) = (stage.join(1, 5.0), stage.join(2, 15.0), stage.join(3, 25.0));
    stage.ticks(2);
    let reason = |stage: &Stage, viewer, avatar| {
        let explanation = stage.engine.explain(viewer, avatar).unwrap();
        assert_eq!(explanation.is_held, sees(stage, viewer).contains(&avatar.0));
        assert!(!explanation.to_string().is_empty());
        explanation.reason
    };
    assert!(matches!(reason(&stage, ada, bob), Reason::Free(_)));
    assert_eq!(reason(&stage, ada, cy), Reason::Cells);
    assert_eq!(stage.engine.explain(ada, AvatarId(9)), None);
    stage.leave(bob);
    stage.leave(cy);
    let dee = stage.join(4, 75.0);
    stage.ticks(4);
    assert_eq!(reason(&stage, ada, dee), Reason::Silence);
}

/// How many ticks pass between the last pose of an avatar that walks out of sight and its
/// vanishing.
fn kept_for(hold_ticks: u32) -> u32 {
    let margin = Margin::Fixed(Duration::ZERO);
    let round_trip_initial = Duration::ZERO;
    let by_exception = false;
    let config =
        Config { hold_ticks, margin, round_trip_initial, by_exception, ..Config::default() };
    let mut stage = Stage::new(row(8), config);
    let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 18.0));
    stage.ticks(2);
    let mut news = stage.engine.ticks();
    while sees(&stage, ada) == [bob.0] {
        let said = stage.log.len();
        stage.clients.get_mut(&bob).unwrap().eye.x += 0.095;
        stage.tick();
        let is_news = |output: &Output| matches!(output, Output::Poses { to, .. } if *to == ada);
        if stage.log[said..].iter().any(is_news) {
            news = stage.engine.ticks();
        } else if let Some(explanation) = stage.engine.explain(ada, bob) {
            let reasons: &[Reason] = match explanation.is_held {
                true => &[Reason::Held, Reason::Blocked],
                false => &[Reason::Cells, Reason::Blocked, Reason::Silence],
            };
            assert!(reasons.contains(&explanation.reason), "{explanation}");
        }
    }
    stage.engine.ticks() - news
}

#[test]
fn an_avatar_that_was_just_in_sight_is_kept_but_its_moves_are_not_told() {
    assert_eq!([0, 1, 2, 5].map(kept_for), [1, 1, 2, 5]);
}

/// How far from a viewer's room a running avatar is when the viewer is told of it, in metres. The
/// avatar claims only a part of its velocity.
fn told_of_at(claimed: f32) -> f32 {
    let mut world = row(8);
    world.speed_max = 6.0;
    let (margin, trip) = (Margin::Fixed(Duration::ZERO), Duration::from_millis(200));
    let policy = Policy::Pvs;
    let config = Config { margin, policy, round_trip_initial: trip, ..Config::default() };
    let mut stage = Stage::new(world, config);
    let (viewer, runner) = (stage.join(1, 2.0), AvatarId(2));
    let mut eye = Vec3::new(45.0, 1.6, 5.0);
    let (name, place) = ("runner".to_owned(), Some(eye));
    stage.engine.handle(stage.now, Input::Join { avatar: runner, name, colour: [0; 3], place });
    let velocity = Vec3::NEG_X * 5.7;
    let mut client = Client::default();
    loop {
        stage.tick();
        if !sees(&stage, viewer).is_empty() {
            break;
        }
        eye += velocity * TICK.as_secs_f32();
        let pose = Pose { eye, velocity: velocity * claimed, ..Pose::default() };
        stage.engine.handle(stage.now, client.report(runner, stage.now, pose));
    }
    assert_eq!(stage.engine.stats().refusals, 0);
    eye.x
}

#[test]
fn an_avatar_that_hides_its_speed_is_told_of_no_later() {
    let honest = told_of_at(1.0);
    assert!((20.5..24.0).contains(&honest), "{honest}");
    // The margin ahead of a walker is worth a tick; a false velocity would be worth a metre.
    let liars = [0.0, -1.0].map(told_of_at);
    assert!(liars.iter().all(|told| *told >= honest - 0.3), "{honest} {liars:?}");
}
