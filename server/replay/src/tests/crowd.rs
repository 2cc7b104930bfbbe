//! A thousand people in one hall, in virtual time: what a few of them are shown of all others.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_engine::{Config, Engine, Input, Output};
use sightline_fixtures::two_rooms;
use sightline_protocol::{
    message::ServerMessage,
    outbound::Outbound,
    pose_stream::{DATAGRAM_BYTES_MAX, PoseDecoder},
    quantise::WirePose,
};
use sightline_world::{
    Cell, Cells, Node, Space, World,
    geometry::Aabb,
    motion::{AvatarId, Pose, Report},
    octree::Octree,
};

const PEOPLE: u32 = 1_000;
/// The side of the hall, in metres.
const SIDE_M: f32 = 60.0;
const TICKS: u32 = 140;
/// Until this tick the first poses of all are on their way.
const BEGIN: u32 = 50;
/// Those whose view is looked at.
const VIEWERS: [u32; 3] = [1, 400, 999];
/// As `docs/design/protocol.md` says: viewers see near avatars within this error, two ticks after a
/// departure; nobody is shown off by more for two seconds.
const NEAR_M: f32 = 10.0;
const NEAR_TICKS: u32 = 2;
const OFF_MAX_M: f32 = 1.0;
const OFF_TICKS: u32 = 40;
/// What rounding adds, in metres.
const ROUNDING_M: f32 = 0.03;

fn hall() -> World {
    let bounds = Aabb::new(Vec3::ZERO, Vec3::new(SIDE_M, 4.0, SIDE_M));
    let base = two_rooms::world();
    World {
        cells: Cells {
            bounds,
            tree: vec![Node::Leaf(sightline_world::CellId(0))],
            cells: vec![Cell { bounds, space: 0, portals: Vec::new() }],
            portals: Vec::new(),
            spaces: vec![Space { bounds, cells: 0..1, gates: Vec::new() }],
            gates: Vec::new(),
            pvs: vec![[0].into_iter().collect()],
            ..base.cells
        },
        octree: Octree::empty(bounds.min, SIDE_M, 1),
        ..base
    }
}

/// Somebody who takes another direction now and then, and says so.
struct Walker {
    pose: Pose,
    orders: u32,
    reported: u32,
    is_asked: bool,
}

impl Walker {
    fn new(random: &mut SmallRng) -> Self {
        let [x, z] = [0, 1].map(|_| random.random_range(1.0..SIDE_M - 1.0));
        let pose = Pose { eye: Vec3::new(x, 1.6, z), ..Pose::default() };
        Self { pose, orders: 0, reported: 0, is_asked: true }
    }

    /// Goes on for a tick. Returns the report that is due.
    fn step(&mut self, tick: u32, now: Duration, random: &mut SmallRng) -> Option<Report> {
        self.pose = self.pose.straight_on(Duration::from_millis(50));
        let eye = self.pose.eye;
        let is_out = !(1.0..SIDE_M - 1.0).contains(&eye.x) || !(1.0..SIDE_M - 1.0).contains(&eye.z);
        let turns = is_out || random.random_bool(0.2);
        if turns {
            let middle = (Vec3::new(SIDE_M / 2.0, 1.6, SIDE_M / 2.0) - eye).with_y(0.0);
            let (sin, cos) = random.random_range(0.0..std::f32::consts::TAU).sin_cos();
            let way = if is_out { middle.normalize() } else { Vec3::new(sin, 0.0, cos) };
            self.pose.velocity = way * random.random_range(0.9..1.7);
            self.pose.yaw = random.random_range(0.0..6.0);
        }
        let is_due = turns || self.is_asked || tick >= self.reported + 60;
        is_due.then(|| {
            (self.reported, self.is_asked) = (tick, false);
            Report { made: now, orders: self.orders, pose: self.pose }
        })
    }
}

/// What somebody knows of the others.
struct Viewer {
    outbound: Outbound,
    decoder: PoseDecoder,
    /// Each course that it was told, and its tick.
    known: BTreeMap<AvatarId, (u32, WirePose)>,
    /// How many ticks in a row each avatar is shown off by more than the viewer can hardly tell,
    /// and by more than the bound.
    off: BTreeMap<AvatarId, [u32; 2]>,
    /// The longest of these: of avatars near by, and of all.
    longest: [u32; 2],
    /// The sum of all errors as parts of the distance.
    error: f64,
}

impl Viewer {
    fn new(id: AvatarId) -> Self {
        let tick = Duration::from_millis(50);
        Self {
            outbound: Outbound::new(id, tick),
            decoder: PoseDecoder::new(tick),
            known: BTreeMap::new(),
            off: BTreeMap::new(),
            longest: [0; 2],
            error: 0.0,
        }
    }

    /// Takes in what the engine says.
    fn hear(&mut self, output: &Output, now: Duration) {
        if let Some(ServerMessage::Appear { avatar, pose, tick, .. }) =
            self.outbound.convert(output, now)
        {
            self.known.insert(avatar, (tick, pose));
        }
    }

    /// Is sent the datagram of a tick. Returns how many courses are in it.
    fn receive(&mut self, tick: u32) -> usize {
        let datagram = self.outbound.has_poses(tick).then(|| self.outbound.encode_poses(tick));
        let Some(datagram) = datagram.flatten() else { return 0 };
        assert!(datagram.len() <= DATAGRAM_BYTES_MAX);
        let update = self.decoder.decode(&datagram).unwrap().unwrap();
        self.known.extend(update.poses.iter().map(|(id, pose)| (*id, (tick, *pose))));
        let told = update.poses.len();
        self.outbound.acknowledge(self.decoder.ack());
        told
    }

    /// Compares what it is shown with the truth.
    fn look(&mut self, tick: u32, from: Vec3, truth: &[Walker], acuity_m: impl Fn(f32) -> f32) {
        for (id, (since, pose)) in &self.known {
            let true_eye = truth[id.0 as usize - 1].pose.eye;
            let away_m = from.distance(true_eye);
            let shown = pose.straight_on(Duration::from_millis(50) * (tick - since));
            let error_m = Vec3::from(shown.position).distance(true_eye);
            self.error += f64::from(error_m / away_m.max(1.0));
            let off = self.off.entry(*id).or_default();
            let is_off = [error_m > acuity_m(away_m) + ROUNDING_M, error_m > OFF_MAX_M];
            for (ticks, is_off) in off.iter_mut().zip(is_off) {
                *ticks = if is_off { *ticks + 1 } else { 0 };
            }
            if away_m <= NEAR_M {
                self.longest[0] = self.longest[0].max(off[0]);
            }
            self.longest[1] = self.longest[1].max(off[1]);
        }
    }
}

/// The naive reference: what does not fit waits, and goes in the order of ids.
#[derive(Default)]
struct Naive(BTreeSet<AvatarId>);

impl Naive {
    /// Takes this number of avatars.
    fn take(&mut self, count: usize) -> Vec<AvatarId> {
        let first: Vec<AvatarId> = self.0.iter().copied().take(count).collect();
        first.iter().for_each(|id| _ = self.0.remove(id));
        first
    }
}

#[test]
fn in_a_hall_of_a_thousand_those_near_by_are_shown_exactly_and_nobody_starves() {
    let mut random = SmallRng::seed_from_u64(3);
    let config = Config::default();
    let tick_time = config.tick;
    let mut engine = Engine::new(Arc::new(hall()), config);
    let mut walkers: Vec<Walker> = (0..PEOPLE).map(|_| Walker::new(&mut random)).collect();
    for (id, walker) in (1..).map(AvatarId).zip(&walkers) {
        let (name, place) = (id.0.to_string(), Some(walker.pose.eye));
        engine.handle(Duration::ZERO, Input::Join { avatar: id, name, colour: [0; 3], place });
        engine.handle(Duration::ZERO, Input::RoundTrip { avatar: id, round_trip: Duration::ZERO });
    }
    let mut viewers = VIEWERS.map(|id| (AvatarId(id), Viewer::new(AvatarId(id))));
    let mut naive = VIEWERS.map(|id| (Naive::default(), Viewer::new(AvatarId(id))));
    let (mut outputs, mut bytes_full) = (Vec::new(), 0);
    for tick in 1..=TICKS {
        let now = tick_time * (tick - 1);
        for (id, walker) in (1..).map(AvatarId).zip(&mut walkers) {
            if let Some(report) = walker.step(tick, now, &mut random) {
                engine.handle(now, Input::Report { avatar: id, report });
            }
        }
        engine.tick(now, &mut outputs);
        assert_eq!(engine.ticks(), tick);
        for output in outputs.drain(..) {
            let walker = &mut walkers[output.to().0 as usize - 1];
            match output {
                Output::Live { .. } | Output::Quiet { .. } => walker.orders += 1,
                Output::Ask { .. } => walker.is_asked = true,
                Output::Correct { .. } | Output::Drop { .. } => panic!("{output:?}"),
                _ => {}
            }
            let place = VIEWERS.iter().position(|id| *id == output.to().0);
            let Some(place) = place else { continue };
            let (reference, shown) = &mut naive[place];
            shown.hear(&output, now);
            if let Output::Poses { poses, .. } = &output {
                reference.0.extend(poses.iter().map(|(id, _)| *id));
            }
            viewers[place].1.hear(&output, now);
        }
        for ((id, viewer), (reference, shown)) in viewers.iter_mut().zip(&mut naive) {
            let from = walkers[id.0 as usize - 1].pose.eye;
            let told = viewer.receive(tick);
            bytes_full += usize::from(tick >= BEGIN && viewer.outbound.waiting_len() > 0);
            // It tells as many as the server's one, where each is by now.
            for told in reference.take(told) {
                let pose = WirePose::from(&walkers[told.0 as usize - 1].pose);
                shown.known.insert(told, (tick, pose));
            }
            if tick >= BEGIN {
                viewer.look(tick, from, &walkers, |away_m| engine.acuity_m(*id, away_m));
                shown.look(tick, from, &walkers, |away_m| engine.acuity_m(*id, away_m));
            }
        }
    }
    assert!(bytes_full > 50, "there is often too much for a datagram: {bytes_full}");
    for ((_, viewer), (_, naive)) in viewers.iter().zip(&naive) {
        assert_eq!(viewer.known.len(), PEOPLE as usize - 1);
        let [near, all] = viewer.longest;
        let [naive_near, naive_all] = naive.longest;
        println!("near {near} ticks, all {all}; naive {naive_near}, {naive_all}");
        println!("error {:.0}, naive {:.0}", viewer.error, naive.error);
        assert!(near <= NEAR_TICKS, "near by, off for {near} ticks");
        assert!(all <= OFF_TICKS, "off by more than {OFF_MAX_M} m for {all} ticks");
        assert!(naive_near > NEAR_TICKS && naive_all > OFF_TICKS, "the reference shows the fault");
        assert!(viewer.error < naive.error);
    }
}
