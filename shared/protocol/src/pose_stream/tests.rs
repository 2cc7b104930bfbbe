use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use glam::Vec3;
use proptest::prelude::*;
use sightline_world::motion::{AvatarId, Pose};

use super::{encoder::RESEND_TICKS_MIN, *};
use crate::quantise::{COORDINATE_MAX, WirePosition};

const TICK: Duration = Duration::from_millis(50);

/// The datagram of a tick at which these avatars have new courses.
fn sent(encoder: &mut PoseEncoder, tick: u32, news: &[(AvatarId, Pose)]) -> Option<Vec<u8>> {
    encoder.tell(tick, Vec3::ZERO, news);
    encoder.encode(tick)
}

/// A generator of random numbers that depend on the seed alone.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % sides
    }

    fn signed(&mut self) -> f32 {
        self.roll(2_001) as f32 / 1_000.0 - 1.0
    }
}

/// An avatar that is on course mostly. Its course began with a pose at a tick.
#[derive(Clone, Copy, Default)]
struct Course {
    tick: u32,
    pose: WirePose,
}

impl Course {
    fn at(&self, tick: u32) -> WirePose {
        if tick == self.tick {
            return self.pose;
        }
        self.pose.straight_on(TICK * (tick - self.tick))
    }

    /// Takes a new course at a tick.
    fn depart(&mut self, tick: u32, dice: &mut Dice) {
        let mut pose = Pose::from(self.at(tick));
        pose.velocity = Vec3::new(dice.signed(), 0.0, dice.signed()) * 3.0;
        pose.yaw += dice.signed();
        pose.yaw_rate = dice.signed();
        pose.falls = dice.roll(5) == 0;
        pose.pitch = dice.signed();
        if dice.roll(25) == 0 {
            pose.eye = Vec3::new(dice.signed(), dice.signed(), dice.signed()) * 10_000.0;
        }
        *self = Self { tick, pose: (&pose).into() };
    }
}

/// A network path that loses, duplicates and reorders items. Each arrives at a tick of its own.
#[derive(Default)]
struct LossyPath<T> {
    on_the_way: Vec<(u32, T)>,
}

impl<T: Clone> LossyPath<T> {
    fn send(&mut self, item: T, tick: u32, loss_percent: u64, dice: &mut Dice) {
        for _ in 0..1 + u64::from(dice.roll(10) == 0) {
            if dice.roll(100) >= loss_percent {
                self.on_the_way.push((tick + dice.roll(12) as u32, item.clone()));
            }
        }
    }

    fn arrivals(&mut self, tick: u32) -> Vec<T> {
        let (now, later) =
            std::mem::take(&mut self.on_the_way).into_iter().partition(|(due, _)| *due <= tick);
        self.on_the_way = later;
        let now: Vec<(u32, T)> = now;
        now.into_iter().map(|(_, item)| item).collect()
    }
}

/// Whether a pose is another one but for rounding: a course that waited begins where it leads when
/// it is sent.
fn is_same(one: &WirePose, other: &WirePose) -> bool {
    let [a, b] = [one, other].map(|pose| pose.position.units());
    let is_near = a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 2);
    let is_turned = one.yaw.wrapping_sub(other.yaw).cast_signed().unsigned_abs() > 2;
    is_near && !is_turned && one.pitch == other.pitch && one.yaw_rate == other.yaw_rate
}

/// Walks avatars over a lossy path. Checks that every pose that arrives is on course, and that the
/// client knows the course of each avatar in the end.
fn check_walk(seed: u64, avatars: u32, loss_percent: u64, datagram_bytes_max: usize) {
    let mut dice = Dice(seed);
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    encoder.set_datagram_bytes_max(datagram_bytes_max);
    let mut courses: Vec<(AvatarId, Course)> =
        (0..avatars).map(|i| (AvatarId(i * 3), Course::default())).collect();
    let mut truth: BTreeMap<(u32, AvatarId), WirePose> = BTreeMap::new();
    let mut held: BTreeMap<AvatarId, (u32, Course)> = BTreeMap::new();
    let (mut down, mut up) = (LossyPath::default(), LossyPath::default());
    for tick in 1..400 {
        let moving = tick < 299;
        let mut news: Vec<(AvatarId, Pose)> = Vec::new();
        for (id, course) in &mut courses {
            let departs = [1, 298].contains(&tick) || moving && dice.roll(4) == 0;
            if departs {
                course.depart(tick, &mut dice);
                news.push((*id, course.at(tick).into()));
            }
        }
        let loss_percent = if tick < 300 { loss_percent } else { 0 };
        courses.iter().for_each(|(id, course)| {
            truth.insert((tick, *id), course.at(tick));
        });
        if let Some(datagram) = sent(&mut encoder, tick, &news) {
            assert!(datagram.len() <= datagram_bytes_max);
            down.send(datagram, tick, loss_percent, &mut dice);
        }
        assert!(encoder.sent.len() <= BASELINE_DISTANCE_MAX as usize);
        for datagram in down.arrivals(tick) {
            let Ok(Some(update)) = decoder.decode(&datagram) else { continue };
            for (id, pose) in &update.poses {
                let true_pose = truth[&(update.tick, *id)];
                assert!(is_same(&true_pose, pose), "{id:?} at tick {}: {pose:?}", update.tick);
                let heard = Course { tick: update.tick, pose: *pose };
                let newest = held.entry(*id).or_insert((0, heard));
                if newest.0 <= update.sequence {
                    *newest = (update.sequence, heard);
                }
            }
        }
        up.send(
            ClientDatagram { ack: decoder.ack(), report: None }.encode(),
            tick,
            loss_percent,
            &mut dice,
        );
        for datagram in up.arrivals(tick) {
            encoder.acknowledge(ClientDatagram::decode(&datagram).unwrap().ack);
        }
    }
    for (id, course) in &courses {
        let [held, true_pose] = [held[id].1, *course].map(|course| Pose::from(course.at(390)));
        assert!(held.eye.distance(true_pose.eye) < 0.2, "avatar {id:?} at the end");
        let off = held.velocity.distance(true_pose.velocity);
        assert!(off < 0.05, "avatar {id:?} at the end");
    }
    assert!(
        sent(&mut encoder, 400, &[]).is_none(),
        "everything was acknowledged, so nothing is sent"
    );
}

#[test]
fn one_avatar_and_many_are_known_in_the_end_with_and_without_loss() {
    for (seed, avatars, loss_percent) in
        [(0, 1, 0), (2_682_526_525_907_446_773, 9, 15), (2_329_486_698_009_734_267, 19, 29)]
    {
        check_walk(seed, avatars, loss_percent, DATAGRAM_BYTES_MAX);
    }
}

fn wire_pose() -> impl Strategy<Value = WirePose> {
    let unit = prop_oneof![-2_000..2_000, -COORDINATE_MAX..=COORDINATE_MAX];
    (proptest::array::uniform3(unit), any::<(u16, i16, [i16; 3], i16, bool)>()).prop_map(
        |(units, (yaw, pitch, velocity, yaw_rate, falls))| WirePose {
            position: WirePosition::new(units).unwrap(),
            yaw,
            pitch,
            velocity,
            yaw_rate,
            falls,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_pose_that_arrives_was_sent_whatever_is_lost(
        seed: u64,
        avatars in 1u32..30,
        loss_percent in 0u64..60,
        datagram_bytes_max in prop_oneof![Just(DATAGRAM_BYTES_MAX), 128usize..400],
    ) {
        check_walk(seed, avatars, loss_percent, datagram_bytes_max);
    }
}

proptest! {
    #[test]
    fn any_difference_decodes_to_the_pose(base in wire_pose(), pose in wire_pose()) {
        let mut out = Vec::new();
        entry::write_difference(&mut out, &base, &pose);
        let mut bytes = &out[1..];
        prop_assert_eq!(entry::read_difference(&mut bytes, out[0], &base), Ok(pose));
        prop_assert!(bytes.is_empty());
    }

    #[test]
    fn a_clients_datagram_decodes_to_itself(
        newest: u32, earlier: u32, made: u32, orders: u32, pose in wire_pose(),
    ) {
        for report in [None, Some(WireReport { made, orders, pose })] {
            let datagram = ClientDatagram { ack: Ack { newest, earlier }, report };
            prop_assert_eq!(ClientDatagram::decode(&datagram.encode()), Ok(datagram));
        }
    }

    #[test]
    fn any_bytes_are_a_valid_datagram_or_leave_the_decoder_unchanged(
        bytes in proptest::collection::vec(any::<u8>(), 0..1_300),
    ) {
        let mut decoder = primed().1;
        let before = decoder.clone();
        match decoder.decode(&bytes) {
            Ok(Some(update)) => {
                prop_assert!(update.poses.len() <= ENTRIES_MAX);
                prop_assert!(update.poses.is_sorted_by_key(|(id, _)| *id));
                prop_assert!(update.poses.iter().all(|(_, p)| Pose::from(*p).is_finite()));
            }
            Ok(None) | Err(_) => prop_assert_eq!(decoder.received, before.received),
        }
        let _ = ClientDatagram::decode(&bytes);
    }
}

/// A stream with three avatars that are all acknowledged.
fn primed() -> (PoseEncoder, PoseDecoder) {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let at = |x: f32| Pose { eye: Vec3::new(x, 1.6, -x), ..Pose::default() };
    let poses = [(AvatarId(0), at(1.0)), (AvatarId(7), at(2.0)), (AvatarId(300), at(3.0))];
    if let Some(datagram) = sent(&mut encoder, 1, &poses) {
        decoder.decode(&datagram).unwrap().unwrap();
    }
    encoder.acknowledge(decoder.ack());
    (encoder, decoder)
}

#[test]
fn late_acknowledgements_end_the_resending() {
    let (mut encoder, mut decoder) = primed();
    let mut acks = VecDeque::new();
    let mut datagrams = 0;
    for tick in 2..100 {
        let poses = if tick == 2 { moved(1.0).to_vec() } else { Vec::new() };
        if let Some(datagram) = sent(&mut encoder, tick, &poses) {
            decoder.decode(&datagram).unwrap().unwrap();
            acks.push_back((tick + 30, decoder.ack()));
            datagrams += 1;
        }
        while acks.front().is_some_and(|(due, _)| *due <= tick) {
            acks.pop_front().into_iter().for_each(|(_, ack)| encoder.acknowledge(ack));
        }
    }
    assert!((2..12).contains(&datagrams), "{datagrams} datagrams");
}

fn moved(metres: f32) -> [(AvatarId, Pose); 2] {
    let eye = Vec3::new(1.0 + metres, 1.6, -1.0);
    let turned = Pose { eye, yaw: metres, ..Pose::default() };
    [(AvatarId(0), turned), (AvatarId(7), turned)]
}

#[test]
fn every_flip_of_a_datagram_is_refused_or_valid() {
    let (mut encoder, decoder) = primed();
    let original = sent(&mut encoder, 2, &moved(0.2)).unwrap();
    let pose = WirePose::from(&moved(0.2)[0].1);
    let report = Some(WireReport { made: 3, orders: 1, pose });
    let from_client = ClientDatagram { ack: decoder.ack(), report }.encode();
    for flip in 1..=255u8 {
        for i in 0..original.len() {
            let mut bytes = original.clone();
            bytes[i] ^= flip;
            let mut copy = decoder.clone();
            if let Ok(Some(update)) = copy.decode(&bytes) {
                assert!(update.poses.iter().all(|(_, pose)| Pose::from(*pose).is_finite()));
            }
        }
        for i in 0..from_client.len() {
            let mut bytes = from_client.clone();
            bytes[i] ^= flip;
            if let Ok(datagram) = ClientDatagram::decode(&bytes) {
                assert_eq!(ClientDatagram::decode(&datagram.encode()), Ok(datagram));
            }
        }
    }
}

#[test]
fn a_departure_takes_six_to_fourteen_bytes_where_nothing_is_lost() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let mut dice = Dice(1);
    let mut poses: Vec<_> = (0..20).map(|i| (AvatarId(i), Pose::default())).collect();
    let (mut bytes, mut departures) = (0, 0);
    let mut delayed = VecDeque::new();
    // At first each course is sent twice.
    for tick in 1..=800 {
        if tick == 400 {
            (bytes, departures) = (0, 0);
        }
        let mut news = Vec::new();
        for (id, pose) in &mut poses {
            *pose = pose.straight_on(TICK);
            if dice.roll(20) == 0 {
                pose.yaw += dice.signed();
                pose.yaw_rate = 0.2 * dice.signed();
                pose.velocity = pose.forward().with_y(0.0) * 1.5;
                news.push((*id, *pose));
            }
        }
        departures += news.len();
        if let Some(datagram) = sent(&mut encoder, tick, &news) {
            bytes += datagram.len();
            decoder.decode(&datagram).unwrap();
        }
        delayed.push_back(decoder.ack());
        if delayed.len() > 2 {
            encoder.acknowledge(delayed.pop_front().unwrap());
        }
    }
    let each = bytes as f64 / departures as f64;
    assert!((6.0..14.0).contains(&each), "{each:.2} bytes for a departure");
}

#[test]
fn lost_poses_are_sent_again_and_known_poses_are_not() {
    let (mut encoder, mut decoder) = primed();
    let still = [(AvatarId(0), Pose { eye: Vec3::new(1.0, 1.6, -1.0), ..Pose::default() })];
    assert!(sent(&mut encoder, 2, &still).is_none());
    let lost = sent(&mut encoder, 3, &moved(0.5));
    assert!(lost.is_some());
    assert!(sent(&mut encoder, 4, &moved(0.5)).is_none(), "it may still be on the way");
    assert!(sent(&mut encoder, 5, &[]).is_some(), "a second copy, lost too");
    assert!((6..17).all(|tick| sent(&mut encoder, tick, &[]).is_none()));
    let again = sent(&mut encoder, 17, &[]);
    let update = decoder.decode(&again.unwrap()).unwrap().unwrap();
    assert_eq!(update.tick, 17);
    assert_eq!(update.poses.len(), 2);
    assert_eq!(update.pose(AvatarId(7)), Some(WirePose::from(&moved(0.5)[1].1)));
}

#[test]
fn each_course_is_sent_twice_and_again_at_once_when_a_gap_shows_that_both_were_lost() {
    let (mut encoder, mut decoder) = primed();
    assert!(sent(&mut encoder, 40, &moved(0.5)[..1]).is_some());
    assert!(sent(&mut encoder, 41, &[]).is_none());
    assert!(sent(&mut encoder, 42, &[]).is_some(), "both are lost");
    let next = sent(&mut encoder, 43, &moved(0.7)[1..]).unwrap();
    decoder.decode(&next).unwrap().unwrap();
    assert!(decoder.ack().has_gap());
    encoder.acknowledge(decoder.ack());
    let again = sent(&mut encoder, 44, &[]).unwrap();
    let update = decoder.decode(&again).unwrap().unwrap();
    assert_eq!(update.poses, [(AvatarId(0), WirePose::from(&moved(0.5)[0].1))]);
    encoder.acknowledge(decoder.ack());
    assert!((45..200).all(|tick| sent(&mut encoder, tick, &[]).is_none()));
}

#[test]
fn a_course_is_sent_again_when_its_acknowledgement_should_have_come() {
    let (mut encoder, mut decoder) = primed();
    let mut late = |ticks: u32, from: u32| {
        for round in 0..20 {
            let tick = from + 10 * round;
            let first = sent(&mut encoder, tick, &moved(tick as f32)[..1]).unwrap();
            decoder.decode(&first).unwrap().unwrap();
            let more = (tick + 1..=tick + ticks).flat_map(|tick| sent(&mut encoder, tick, &[]));
            for datagram in more {
                decoder.decode(&datagram).unwrap().unwrap();
            }
            encoder.acknowledge(decoder.ack());
        }
        let lost = from + 200;
        assert!(sent(&mut encoder, lost, &moved(0.5)[..1]).is_some());
        let again: Vec<u32> =
            (lost + 1..lost + 30).filter(|tick| sent(&mut encoder, *tick, &[]).is_some()).collect();
        encoder.acknowledge(decoder.ack());
        [again[0] - lost, again[1] - again[0]]
    };
    assert_eq!(late(4, 100), [2, 5]);
    assert_eq!(late(1, 400), [2, RESEND_TICKS_MIN]);
    assert_eq!(late(9, 700), [2, 10]);
}

#[test]
fn a_client_that_has_entered_gets_two_datagrams_for_its_clock_even_without_poses() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let told = |encoder: &mut PoseEncoder, decoder: &mut PoseDecoder, tick: u32| {
        sent(encoder, tick, &[]).map(|d| decoder.decode(&d).unwrap().unwrap().clone())
    };
    assert!(told(&mut encoder, &mut decoder, 9).is_none());
    encoder.tell_clock();
    let updates: Vec<_> =
        (10..200).flat_map(|tick| told(&mut encoder, &mut decoder, tick)).collect();
    assert_eq!(updates.iter().map(|update| update.tick).collect::<Vec<_>>(), [10, 12]);
    assert!(updates.iter().all(|update| update.poses.is_empty()));
    // Datagrams with poses will do.
    encoder.tell_clock();
    let poses = sent(&mut encoder, 300, &moved(0.5));
    let copy = sent(&mut encoder, 302, &[]);
    assert!(poses.is_some() && copy.is_some(), "the poses and their copy");
    assert!((303..312).all(|tick| sent(&mut encoder, tick, &[]).is_none()));
}

#[test]
fn forgotten_avatars_are_not_sent() {
    let (mut encoder, mut decoder) = primed();
    sent(&mut encoder, 2, &moved(0.5));
    encoder.forget(AvatarId(0));
    let again = sent(&mut encoder, 22, &[]).unwrap();
    let update = decoder.decode(&again).unwrap().unwrap();
    assert_eq!(update.poses.iter().map(|(id, _)| id.0).collect::<Vec<_>>(), [7]);
}

#[test]
fn duplicate_and_stale_datagrams_are_ignored() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let datagrams: Vec<_> = (1..=200)
        .flat_map(|tick| sent(&mut encoder, tick, &[(AvatarId(1), moved(tick as f32)[0].1)]))
        .collect();
    assert!(decoder.decode(&datagrams[5]).unwrap().is_some());
    assert!(decoder.decode(&datagrams[5]).unwrap().is_none());
    assert!(decoder.decode(&datagrams[2]).unwrap().is_some(), "late but new");
    assert!(decoder.decode(&datagrams[199]).unwrap().is_some());
    assert!(decoder.decode(&datagrams[3]).unwrap().is_none(), "too old");
    assert_eq!(decoder.received.len(), 1);
    assert_eq!(decoder.newest(AvatarId(1), 200).map(|(_, tick, _)| tick), Some(200));
    assert_eq!(decoder.newest(AvatarId(1), 201), None);
}

#[test]
fn acks_cover_exactly_the_received_datagrams() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let came = [1, 2, 5, 9, 20, 33, 40];
    for tick in 1..=40 {
        let datagram = sent(&mut encoder, tick, &[(AvatarId(1), moved(tick as f32)[0].1)]).unwrap();
        if came.contains(&tick) {
            decoder.decode(&datagram).unwrap().unwrap();
        }
    }
    let ack = decoder.ack();
    let covered: Vec<u32> = (0..=50).filter(|sequence| ack.covers(*sequence)).collect();
    assert_eq!(covered, [9, 20, 33, 40], "those within 32 of the newest");
    assert!(!Ack::default().covers(0));
}

#[test]
fn an_ack_of_a_datagram_that_was_never_sent_is_ignored() {
    let (mut encoder, mut decoder) = primed();
    sent(&mut encoder, 2, &moved(0.5));
    encoder.acknowledge(Ack { newest: 99, earlier: u32::MAX });
    let resent = sent(&mut encoder, 22, &[]).unwrap();
    assert!(decoder.decode(&resent).is_ok());
}

#[test]
fn a_client_that_never_acknowledges_costs_bounded_memory() {
    let mut encoder = PoseEncoder::new(TICK);
    let crowd = |tick: u32| -> Vec<_> {
        (0..500).map(|i| (AvatarId(i), moved((tick + i) as f32)[0].1)).collect()
    };
    for tick in 1..100 {
        sent(&mut encoder, tick, &crowd(tick));
        let held: usize = encoder.sent.iter().map(|sent| sent.poses.len()).sum();
        assert_eq!(held, encoder.sent_poses);
        assert!(held <= 4_096 && encoder.avatars.len() + encoder.waiting.len() <= 1_000);
    }
}

/// 1,000 avatars on a square of 60 m around the viewer, who all turn and walk at a tick.
fn crowd(tick: u32) -> Vec<(AvatarId, Pose)> {
    let mut dice = Dice(tick.into());
    let mut pose = || Pose {
        eye: Vec3::new(dice.signed(), 0.0, dice.signed()) * 30.0,
        velocity: Vec3::new(dice.signed(), 0.0, dice.signed()),
        yaw: dice.signed(),
        ..Pose::default()
    };
    (0..1_000).map(|i| (AvatarId(7 * i + 3), pose())).collect()
}

#[test]
fn what_does_not_fit_waits_and_the_nearest_go_first() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let news = crowd(1);
    let near = |(_, pose): &&(AvatarId, Pose)| pose.eye.length() < NEAR_M;
    let near_count = news.iter().filter(near).count();
    assert!((60..120).contains(&near_count), "{near_count}");
    let mut known: BTreeMap<AvatarId, u32> = BTreeMap::new();
    for tick in 1..40 {
        let datagram = sent(&mut encoder, tick, if tick == 1 { &news } else { &[] });
        let Some(datagram) = datagram else { break };
        assert!(datagram.len() <= DATAGRAM_BYTES_MAX, "{}", datagram.len());
        let is_full = datagram.len() > DATAGRAM_BYTES_MAX - 40;
        assert!(encoder.waiting.is_empty() || is_full, "no room is left");
        let update = decoder.decode(&datagram).unwrap().unwrap();
        for (id, _) in &update.poses {
            known.entry(*id).or_insert(tick);
        }
        encoder.acknowledge(decoder.ack());
    }
    assert_eq!(known.len(), 1_000, "nobody starves");
    assert!(news.iter().filter(near).all(|(id, _)| known[id] <= 2));
    let last = known.values().max();
    assert!(last <= Some(&20), "{last:?}");
    let mean = |from: f32, to: f32| {
        let of = news.iter().filter(|(_, pose)| (from..to).contains(&pose.eye.length()));
        let ticks: Vec<u32> = of.map(|(id, _)| known[id]).collect();
        f64::from(ticks.iter().sum::<u32>()) / ticks.len() as f64
    };
    assert!(mean(10.0, 15.0) < mean(20.0, 30.0), "the larger on the screen, the sooner");
}

#[test]
fn where_there_is_always_too_much_everybody_has_a_turn_before_long() {
    let (mut encoder, mut decoder) = (PoseEncoder::new(TICK), PoseDecoder::new(TICK));
    let mut known: BTreeMap<AvatarId, u32> = BTreeMap::new();
    let mut longest = 0;
    for tick in 1..200 {
        // All change their courses at each tick, and the nearest alone would fill the datagram.
        let near = |(id, pose): (AvatarId, Pose)| {
            let eye = pose.eye * if id.0 % 4 == 0 { 0.1 } else { 1.0 };
            (id, Pose { eye, ..pose })
        };
        let news: Vec<_> = crowd(tick).into_iter().map(near).collect();
        let datagram = sent(&mut encoder, tick, &news).unwrap();
        for (id, _) in &decoder.decode(&datagram).unwrap().unwrap().poses {
            longest = longest.max(tick - known.insert(*id, tick).unwrap_or(0));
        }
        encoder.acknowledge(decoder.ack());
    }
    assert_eq!(known.len(), 1_000);
    let within = OVERDUE.as_millis() as u32 / 50 + 2 * 1_000 / 50;
    assert!(longest <= within, "{longest} ticks");
}
