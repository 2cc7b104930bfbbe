use glam::Vec3;
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_protocol::{
    message::ClientMessage,
    pose_stream::{ClientDatagram, PoseEncoder},
    quantise::{WireTbv, WireTolerance},
    text::{ChatLine, Name},
};
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::Body,
};

use super::{
    sending::{ACK_TICKS, ACK_TICKS_LOSSY},
    *,
};

const TICK: Duration = Duration::from_millis(50);

fn replica() -> Replica {
    Replica::new(AvatarId(1), TICK, Agility::of(&Body::PERSON, 4.0))
}

fn at(x: f32) -> Pose {
    Pose { eye: Vec3::new(x, 1.5, -x), ..Pose::default() }
}

fn entered() -> Replica {
    let mut replica = replica();
    let entered = ServerMessage::Entered { pose: (&at(0.0)).into(), tick: 1 };
    assert_eq!(replica.message(TICK, entered), Ok(Some(Event::Entered(at(0.0)))));
    replica
}

fn quiet(radius: f32, now: Duration) -> ServerMessage {
    quiet_with_notice(radius, now, Duration::ZERO)
}

fn quiet_with_notice(radius: f32, now: Duration, notice: Duration) -> ServerMessage {
    let within = Aabb::around(at(0.0).eye, radius);
    let tbv = Tbv { within, axes: Axes::WORLD, expiry: now + Duration::from_secs(1), notice };
    ServerMessage::Quiet { tbv: WireTbv::new(&tbv, now) }
}

/// The time and the place of the report that a client sends.
fn report(outgoing: Option<Outgoing>) -> (u32, f32) {
    let report = match outgoing {
        Some(Outgoing::Datagram(bytes)) => ClientDatagram::decode(&bytes).unwrap().report.unwrap(),
        Some(Outgoing::Message(ClientMessage::Report { report, .. })) => report,
        other => panic!("no report: {other:?}"),
    };
    (report.made, Pose::from(report.pose).eye.x)
}

fn live(millimetres: u16) -> ServerMessage {
    ServerMessage::Live { tolerance: WireTolerance { millimetres, angle: 20, ahead_ms: 200 } }
}

#[test]
fn a_client_outside_the_world_sends_nothing() {
    let mut replica = replica();
    assert_eq!(replica.tick(TICK, TICK), None);
    replica.message(TICK, ServerMessage::Ask).unwrap();
    assert_eq!((replica.tick(TICK, TICK), replica.answer(TICK)), (None, None));
}

#[test]
fn a_client_without_a_tolerance_reports_at_every_tick_in_datagrams() {
    let mut replica = entered();
    for i in 1..100 {
        replica.set_pose(at(i as f32));
        let sent = replica.tick(TICK * i, TICK);
        assert!(matches!(sent, Some(Outgoing::Datagram(_))));
        assert_eq!(report(sent), ((i - 1) * 64, i as f32));
    }
    replica.set_pose(Pose { yaw: f32::NAN, ..at(5.0) });
    assert_eq!(replica.pose(), at(99.0));
}

#[test]
fn a_live_client_reports_departures_on_the_stream() {
    let mut replica = entered();
    replica.message(TICK, live(100)).unwrap();
    let mut tick_at = |i: u32, x: f32| {
        replica.set_pose(at(x));
        replica.tick(TICK * i, TICK)
    };
    assert_eq!(report(tick_at(1, 0.0)), (0, 0.0), "the order allows less than none before it");
    assert_eq!((tick_at(2, 0.001), tick_at(3, 0.002)), (None, None));
    let departure = tick_at(4, 0.3);
    assert!(matches!(departure, Some(Outgoing::Message(_))));
    assert_eq!(report(departure).0, 3 * 64);
    replica.message(TICK * 4, live(50)).unwrap();
    assert_eq!(report(replica.answer(TICK * 4).map(Outgoing::Message)).0, 3 * 64 + 2);
}

#[test]
fn a_client_that_leaves_its_world_knows_nobody_and_reports_when_it_is_in_the_next() {
    let mut replica = entered();
    replica.message(TICK, live(100)).unwrap();
    replica.message(TICK, appear(2, 0.0, 1)).unwrap();
    replica.set_pose(at(2.0));
    let before = report(replica.tick(TICK * 9, TICK)).0;
    let from = replica.leave_world(Agility::of(&Body::PERSON, 9.0));
    assert!(from > before, "{from} after {before}");
    assert_eq!((replica.held_len(), replica.reporting_state()), (0, None));
    assert_eq!((replica.pose(), replica.tick(TICK * 10, TICK)), (at(2.0), None));
    let entered = ServerMessage::Entered { pose: (&at(2.0)).into(), tick: 40 };
    assert_eq!(replica.message(TICK * 10, entered), Ok(Some(Event::Entered(at(2.0)))));
    // At once, before the next tick, and still later than all before.
    let (made, x) = report(replica.tick(TICK * 9, TICK));
    assert!(made >= from && x == 2.0, "{made} from {from}");
    assert_eq!(replica.reporting_counts().ticks, 2, "both worlds count");
}

/// How reports go at successive ticks, with these places: on the stream, in a datagram, or not.
fn ways(replica: &mut Replica, from: u32, places: &[f32]) -> String {
    let way = |(i, x): (u32, &f32)| {
        replica.set_pose(at(*x));
        match replica.tick(TICK * i, TICK) {
            Some(Outgoing::Message(_)) => 's',
            Some(Outgoing::Datagram(_)) => 'd',
            None => '-',
        }
    };
    (from..).zip(places).map(way).collect()
}

#[test]
fn the_third_report_in_a_row_goes_in_a_datagram_and_the_last_one_on_the_stream_too() {
    let mut replica = entered();
    replica.message(TICK, live(100)).unwrap();
    assert_eq!(ways(&mut replica, 1, &[0.0, 0.0, 0.0, 0.0]), "s---");
    let jerky = [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(ways(&mut replica, 5, &jerky), "ssdd-s--");
}

#[test]
fn while_the_path_loses_messages_each_report_goes_twice() {
    let mut replica = entered();
    replica.message(TICK, live(100)).unwrap();
    assert_eq!(ways(&mut replica, 1, &[0.0, 0.0]), "s-");
    replica.hear_losses(TICK * 3, 1);
    assert_eq!(ways(&mut replica, 3, &[1.0, 1.0, 1.0, 1.0]), "s---", "one may be an accident");
    replica.hear_losses(TICK * 10, 2);
    replica.message(TICK * 10, live(50)).unwrap();
    let answer = replica.answer(TICK * 10).map(Outgoing::Message);
    replica.set_pose(at(1.0));
    let copy = replica.tick(TICK * 11, TICK);
    assert!(matches!(copy, Some(Outgoing::Datagram(_))));
    assert_eq!(report(copy), report(answer), "the same report");
    assert_eq!(ways(&mut replica, 12, &[2.0, 2.0, 2.0]), "ds-");
    replica.hear_losses(TICK * 1_010, 2);
    assert_eq!(ways(&mut replica, 1_020, &[4.0, 4.0, 4.0]), "s--", "long ago");
}

#[test]
fn acknowledgements_wait_for_a_report_unless_a_datagram_is_missing() {
    let (mut replica, mut encoder) = (entered(), PoseEncoder::new(TICK));
    replica.message(TICK, live(100)).unwrap();
    assert!(replica.tick(TICK, TICK).is_some());
    let mut datagram =
        |tick: u32| sent(&mut encoder, tick, &[(AvatarId(7), at(tick as f32))]).unwrap();
    replica.datagram(TICK * 2, &datagram(2)).unwrap();
    let waited = (2..40).position(|i| replica.tick(TICK * i, TICK).is_some());
    assert_eq!(waited, Some(ACK_TICKS as usize));
    datagram(50);
    replica.datagram(TICK * 51, &datagram(51)).unwrap();
    assert!(replica.tick(TICK * 51, TICK).is_some(), "one was lost");
    datagram(52);
    replica.datagram(TICK * 53, &datagram(53)).unwrap();
    assert!(replica.tick(TICK * 53, TICK).is_some(), "another one was lost");
    for tick in 54..57 {
        replica.datagram(TICK * tick, &datagram(tick)).unwrap();
        replica.tick(TICK * tick, TICK);
    }
    (57..60).for_each(|tick| drop(replica.tick(TICK * tick, TICK)));
    replica.datagram(TICK * 60, &datagram(60)).unwrap();
    let waited = (60..90).position(|i| replica.tick(TICK * i, TICK).is_some());
    assert_eq!(waited, Some(ACK_TICKS_LOSSY as usize), "the path loses datagrams");
}

#[test]
fn a_quiet_client_is_silent_until_asked_or_about_to_leave() {
    let mut replica = entered();
    replica.tick(TICK, TICK);
    replica.message(TICK, quiet(5.0, TICK)).unwrap();
    assert_eq!(replica.reporting_state(), Some(ReportingState::Quiet));
    for i in 2..20 {
        assert_eq!(replica.tick(TICK * i, TICK), None);
    }
    let now = TICK * 20;
    replica.message(now, ServerMessage::Ask).unwrap();
    assert_eq!(replica.reporting_state(), Some(ReportingState::Asked));
    assert_eq!(report(replica.answer(now).map(Outgoing::Message)).1, 0.0);
    assert_eq!((replica.answer(now), replica.tick(now, TICK)), (None, None), "once");
    replica.message(now, quiet(5.0, now)).unwrap();
    // The client looks one tick ahead: a fifth of a metre at 4 m/s.
    let place = |metres: f32| Pose {
        eye: at(0.0).eye + Vec3::X * metres,
        velocity: Vec3::X * 4.0,
        ..Pose::default()
    };
    replica.set_pose(place(4.75));
    assert_eq!(replica.tick(TICK * 21, TICK), None);
    replica.set_pose(place(4.85));
    assert!(replica.tick(TICK * 22, TICK).is_some());
    assert_eq!(replica.tick(TICK * 23, TICK), None, "the answer is on its way");
    assert_eq!(replica.tick(TICK * 24, TICK), None);
    assert!(replica.tick(TICK * 25, TICK).is_some(), "no answer came");
    replica.message(TICK * 25, live(100)).unwrap();
    assert!(replica.answer(TICK * 25).is_some());
}

#[test]
fn a_client_with_a_notice_reports_in_time_that_it_leaves() {
    let mut replica = entered();
    replica.tick(TICK, TICK);
    let notice = Duration::from_millis(200);
    replica.message(TICK, quiet_with_notice(5.0, TICK, notice)).unwrap();
    let mut tick_at = |metres: f32, speed: f32| {
        let eye = at(0.0).eye + Vec3::X * metres;
        replica.set_pose(Pose { eye, velocity: Vec3::X * speed, ..Pose::default() });
        replica.tick(TICK * 2, TICK)
    };
    // Within the notice a standing body gets 0.4 m away, and one that walks at 2 m/s 0.8 m.
    assert_eq!((tick_at(4.55, 0.0), tick_at(4.15, 2.0), tick_at(4.15, -2.0)), (None, None, None));
    assert!(tick_at(4.25, 2.0).is_some());
}

fn appear(avatar: u32, x: f32, since_sequence: u32) -> ServerMessage {
    ServerMessage::Appear {
        avatar: AvatarId(avatar),
        name: Name::new("Bo").unwrap(),
        colour: [1, 2, 3],
        pose: (&at(x)).into(),
        tick: 0,
        since_sequence,
    }
}

fn held(replica: &Replica) -> Vec<(u32, f32)> {
    replica.held(TICK).map(|held| (held.id.0, held.pose.eye.x)).collect()
}

/// The datagram of a tick at which these avatars have new courses.
fn sent(encoder: &mut PoseEncoder, tick: u32, news: &[(AvatarId, Pose)]) -> Option<Vec<u8>> {
    encoder.tell(tick, Vec3::ZERO, news);
    encoder.encode(tick)
}

#[test]
fn datagrams_set_the_clock_right_after_a_first_message_that_was_lost_and_sent_again() {
    let (mut replica, mut encoder) = (replica(), PoseEncoder::new(TICK));
    let entered = ServerMessage::Entered { pose: (&at(0.0)).into(), tick: 1 };
    replica.message(TICK * 9, entered).unwrap();
    assert_eq!(replica.server_time(TICK * 9), Duration::ZERO);
    encoder.tell_clock();
    replica.datagram(TICK * 10, &sent(&mut encoder, 8, &[]).unwrap()).unwrap();
    let corrected = TICK * 10 + BLEND;
    assert_eq!(replica.server_time(corrected), TICK * 6 + BLEND, "two ticks before tick 8");
}

#[test]
fn an_old_datagram_brings_no_avatar_back_and_an_early_one_is_not_lost() {
    let (mut replica, mut encoder) = (entered(), PoseEncoder::new(TICK));
    let first = sent(&mut encoder, 1, &[(AvatarId(7), at(1.0))]).unwrap();
    let since = encoder.next_sequence();
    let second = sent(&mut encoder, 2, &[(AvatarId(7), at(2.0))]).unwrap();
    replica.datagram(TICK, &second).unwrap();
    assert_eq!(held(&replica), [], "it has not appeared");
    replica.message(TICK, appear(7, 1.5, since)).unwrap();
    assert_eq!(held(&replica), [(7, 2.0)], "its pose was there before it");
    replica.datagram(TICK, &first).unwrap();
    assert_eq!(held(&replica), [(7, 2.0)], "of an earlier appearance");
    replica.message(TICK, ServerMessage::Vanish { avatar: AvatarId(7) }).unwrap();
    let third = sent(&mut encoder, 3, &[(AvatarId(7), at(3.0))]).unwrap();
    replica.datagram(TICK, &third).unwrap();
    assert_eq!(held(&replica), []);
}

#[test]
fn messages_become_events() {
    let mut replica = entered();
    let text = ChatLine::new("hello").unwrap();
    let said = ServerMessage::Chat { from: AvatarId(7), text };
    replica.message(TICK, appear(7, 0.0, 1)).unwrap();
    let chat = replica.message(TICK, said).unwrap().unwrap();
    assert!(matches!(chat, Event::Chat { name, text, .. } if name == "Bo" && text == "hello"));
    let correct = ServerMessage::Correct { pose: (&at(9.0)).into() };
    assert_eq!(replica.message(TICK, correct), Ok(Some(Event::Corrected(at(9.0)))));
    assert_eq!(replica.pose(), at(9.0));
    let refused = ServerMessage::Refused { reason: sightline_protocol::message::Refusal::Full };
    assert_eq!(replica.message(TICK, refused), Err(ReplicaError::OutOfPlace));
}

/// The largest speed at which a walker is shown, from one millisecond to the next, in metres a
/// second. It turns now and then. Datagrams take 30 ms and up to `jitter_ms` more.
fn shown_speed_max(jitter_ms: u64, loss: f64) -> f32 {
    let (mut replica, mut encoder) = (entered(), PoseEncoder::new(TICK));
    let mut random = SmallRng::seed_from_u64(7);
    let mut pose = at(0.0);
    let mut datagrams: Vec<(u64, Vec<u8>)> = Vec::new();
    let (mut before, mut fastest) = (None::<Vec3>, 0.0f32);
    for ms in 50..60_000u64 {
        let now = Duration::from_millis(ms);
        if ms == 90 {
            replica.message(now, appear(7, 0.0, 1)).unwrap();
        }
        if ms.is_multiple_of(50) {
            pose = pose.straight_on(TICK);
            let departs = random.random_bool(0.15);
            if departs {
                let (sin, cos) = random.random_range(0.0..6.0f32).sin_cos();
                pose.velocity = Vec3::new(cos, 0.0, sin) * WALK;
            }
            let told = if departs { vec![(AvatarId(7), pose)] } else { Vec::new() };
            if let Some(datagram) = sent(&mut encoder, (ms / 50) as u32, &told) {
                let arrival = ms + 30 + random.random_range(0..=jitter_ms);
                if !random.random_bool(loss) {
                    datagrams.push((arrival, datagram));
                }
            }
            if let Some(Outgoing::Datagram(bytes)) = replica.tick(now, TICK) {
                encoder.acknowledge(ClientDatagram::decode(&bytes).unwrap().ack);
            }
        }
        for (_, datagram) in datagrams.extract_if(.., |(at, _)| *at <= ms) {
            let _ = replica.datagram(now, &datagram);
        }
        let shown = replica.shown_avatars(now).first().map(|shown| shown.pose.eye);
        if let (Some(before), Some(shown)) = (before, shown) {
            fastest = fastest.max(shown.distance(before) * 1e3);
        }
        before = shown;
    }
    fastest
}

const WALK: f32 = 1.4;

#[test]
fn corrections_are_blended_and_nobody_leaps() {
    let even = shown_speed_max(0, 0.0);
    assert!(even < 1.05 * WALK, "{even} m/s where every course comes in time");
    let jittery = shown_speed_max(60, 0.0);
    assert!(jittery < 3.0 * WALK, "{jittery} m/s with jitter");
    let lossy = shown_speed_max(60, 0.1);
    assert!(lossy < 8.0 * WALK, "{lossy} m/s with loss");
}

#[test]
fn certainty_ages_while_a_datagram_is_missing_or_the_server_is_silent() {
    let (mut replica, mut encoder) = (entered(), PoseEncoder::new(TICK));
    replica.message(TICK, appear(7, 0.0, 1)).unwrap();
    replica.message(TICK, appear(8, 0.0, 1)).unwrap();
    let mut datagram =
        |tick: u32, avatar: u32| sent(&mut encoder, tick, &[(AvatarId(avatar), at(tick as f32))]);
    let certainty = |replica: &Replica, tick: u32| -> [u32; 2] {
        let ages: Vec<u32> =
            replica.held(TICK * tick).map(|held| held.certainty.as_millis() as u32).collect();
        [ages[0], ages[1]]
    };
    replica.datagram(TICK * 2, &datagram(2, 7).unwrap()).unwrap();
    assert_eq!(certainty(&replica, 2), [0, 0], "nothing else was said");
    assert_eq!(certainty(&replica, 4), [100, 100], "the server is silent");
    datagram(5, 7);
    replica.datagram(TICK * 6, &datagram(6, 8).unwrap()).unwrap();
    assert_eq!(certainty(&replica, 6), [200, 0], "a course of the first may be lost");
    replica.datagram(TICK * 7, &datagram(7, 7).unwrap()).unwrap();
    assert_eq!(certainty(&replica, 7), [0, 50]);
    for tick in 8..30 {
        replica.datagram(TICK * tick, &datagram(tick, 8).unwrap()).unwrap();
    }
    assert_eq!(certainty(&replica, 29), [0, 0], "the lost datagrams have come again");
}

/// A step of the server in a test.
#[derive(Clone, Debug)]
enum Step {
    Move(u8, i16),
    Toggle(u8),
    Tick,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0u8..6, any::<i16>()).prop_map(|(who, x)| Step::Move(who, x)),
        1 => (0u8..6).prop_map(Step::Toggle),
        3 => Just(Step::Tick),
    ]
}

proptest! {
    /// Messages arrive in order and late; datagrams are lost, late and doubled. At the end the
    /// replica holds exactly the avatars and poses that the server holds.
    #[test]
    fn a_replica_converges_to_what_the_server_holds(
        steps in proptest::collection::vec(step(), 1..300),
        fates in proptest::collection::vec((0u8..100, 0u32..8, 0u32..8), 1..200),
        loss_percent in 0u8..60,
    ) {
        let (mut replica, mut encoder) = (entered(), PoseEncoder::new(TICK));
        let mut model: BTreeMap<u32, f32> = BTreeMap::new();
        let mut poses = [0f32; 6];
        let mut stream = std::collections::VecDeque::new();
        let mut datagrams: Vec<(u32, Vec<u8>)> = Vec::new();
        let mut acks: Vec<(u32, Vec<u8>)> = Vec::new();
        let (mut tick, mut updates) = (0u32, BTreeMap::new());
        let settle = std::iter::repeat_n(Step::Tick, 60);
        let lossy = steps.len();
        for (i, step) in steps.into_iter().chain(settle).enumerate() {
            let (luck, late, stream_late) = fates[i % fates.len()];
            let late = if i < lossy { late } else { 0 };
            match step {
                Step::Move(who, x) => {
                    poses[who as usize] = f32::from(x) / 16.0;
                    if let Some(known) = model.get_mut(&who.into()) {
                        *known = poses[who as usize];
                        updates.insert(AvatarId(who.into()), at(*known));
                    }
                }
                Step::Toggle(who) => {
                    let (id, x) = (AvatarId(who.into()), poses[who as usize]);
                    let message = if model.remove(&id.0).is_some() {
                        encoder.forget(id);
                        updates.remove(&id);
                        ServerMessage::Vanish { avatar: id }
                    } else {
                        model.insert(id.0, x);
                        appear(id.0, x, encoder.next_sequence())
                    };
                    stream.push_back((tick + stream_late, message));
                }
                Step::Tick => {
                    tick += 1;
                    let poses: Vec<_> = std::mem::take(&mut updates).into_iter().collect();
                    if let Some(datagram) = sent(&mut encoder, tick, &poses) {
                        if i >= lossy || luck >= loss_percent {
                            datagrams.push((tick + late, datagram.clone()));
                        }
                        if luck % 5 == 0 {
                            datagrams.push((tick + late / 2, datagram));
                        }
                    }
                    while stream.front().is_some_and(|(due, _)| *due <= tick) {
                        replica.message(TICK * tick, stream.pop_front().unwrap().1).unwrap();
                    }
                    for (_, datagram) in datagrams.extract_if(.., |(due, _)| *due <= tick) {
                        let _ = replica.datagram(TICK * tick, &datagram);
                    }
                    if let Some(Outgoing::Datagram(ack)) = replica.tick(TICK * tick, TICK)
                        && (i >= lossy || luck >= loss_percent)
                    {
                        acks.push((tick + late, ack));
                    }
                    for (_, ack) in acks.extract_if(.., |(due, _)| *due <= tick) {
                        encoder.acknowledge(ClientDatagram::decode(&ack).unwrap().ack);
                    }
                }
            }
        }
        prop_assert_eq!(held(&replica), model.into_iter().collect::<Vec<_>>());
    }
}
