//! Any inputs in any order: the engine does not panic, keeps nothing of those who left, says
//! nothing that its clients could not follow, and says the same on any number of threads.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

use glam::Vec3;
use proptest::{prelude::*, sample::select};
use sightline_world::{
    World,
    motion::{AvatarId, Pose, Report, ReportingState},
};

use super::{reference_model, rooms, stage};
use crate::{Config, Engine, Input, Margin, Output, Policy, TbvShape, Validity};

/// One step of a random session.
#[derive(Clone, Debug)]
enum Step {
    Handle(Input),
    /// Lets some time pass, and ticks.
    Tick(Duration),
    /// Ticks at a moment that is not after the present one.
    Back(Duration),
    /// All live and asked clients report honestly, each after a move.
    AllReport(Vec3),
    /// Asks for the explanation of two avatars.
    Ask(AvatarId, AvatarId),
}

const HOUR: Duration = Duration::from_secs(3_600);

fn avatar(ids: u32) -> impl Strategy<Value = AvatarId> {
    prop_oneof![30 => 0..ids, 1 => any::<u32>()].prop_map(AvatarId)
}

/// A coordinate within the world, at its bounds, as far as the wire goes, or beyond.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        20 => -2.0..122.0_f32,
        4 => 0.0..300.0_f32,
        4 => select(vec![0.0, 10.0, 20.0, 50.0, -0.0, 1e-40]),
        1 => select(vec![1e5, -1e5, 1e30, f32::MAX, f32::MIN, f32::INFINITY, f32::NAN]),
    ]
}

fn vector() -> impl Strategy<Value = Vec3> {
    (coordinate(), prop_oneof![4 => 0.0..6.0_f32, 1 => coordinate()], coordinate())
        .prop_map(|(x, y, z)| Vec3::new(x, y, z))
}

fn pose() -> impl Strategy<Value = Pose> {
    let velocity = prop_oneof![4 => Just(Vec3::ZERO), 2 => vector()];
    let angles = any::<[f32; 3]>();
    (vector(), velocity, angles).prop_map(|(eye, velocity, [yaw, pitch, yaw_rate])| Pose {
        eye,
        velocity,
        yaw,
        pitch,
        yaw_rate,
        falls: yaw > pitch,
    })
}

fn time() -> impl Strategy<Value = Duration> {
    prop_oneof![
        20 => Just(stage::TICK),
        3 => (0..5_000_u64).prop_map(Duration::from_millis),
        1 => select(vec![Duration::ZERO, Duration::from_nanos(1), HOUR, HOUR * 24 * 365 * 100]),
    ]
}

/// Any time at all.
fn span() -> impl Strategy<Value = Duration> {
    prop_oneof![2 => time(), 1 => Just(Duration::MAX)]
}

fn input(ids: u32) -> impl Strategy<Value = Input> {
    let avatar = || avatar(ids);
    let join = (avatar(), ".{0,40}", any::<[u8; 3]>(), prop::option::weighted(0.9, vector()));
    let join =
        join.prop_map(|(avatar, name, colour, place)| Input::Join { avatar, name, colour, place });
    let made = prop_oneof![4 => (0..10_000_u64).prop_map(Duration::from_millis), 1 => span()];
    let orders = prop_oneof![4 => 0..20_u32, 1 => any::<u32>()];
    let report = (avatar(), made, orders, pose());
    let report = report.prop_map(|(avatar, made, orders, pose)| Input::Report {
        avatar,
        report: Report { made, orders, pose },
    });
    let come_back = (avatar(), prop::option::of(vector()));
    let come_back = come_back.prop_map(|(avatar, place)| Input::Return { avatar, place });
    let relocate = (avatar(), pose()).prop_map(|(avatar, pose)| Input::Relocate { avatar, pose });
    let trip = prop_oneof![9 => (0..300_u64).prop_map(Duration::from_millis), 1 => span()];
    let trip = (avatar(), trip);
    let trip = trip.prop_map(|(avatar, round_trip)| Input::RoundTrip { avatar, round_trip });
    prop_oneof![
        8 => join,
        2 => avatar().prop_map(|avatar| Input::Leave { avatar }),
        2 => avatar().prop_map(|avatar| Input::Absent { avatar }),
        2 => come_back,
        6 => report,
        2 => relocate,
        1 => avatar().prop_map(|avatar| Input::Respawn { avatar }),
        2 => trip,
        1 => (avatar(), ".{0,10}").prop_map(|(avatar, text)| Input::Chat { avatar, text }),
    ]
}

fn step(ids: u32) -> impl Strategy<Value = Step> {
    let near = (-0.3..0.3_f32, -0.1..0.1_f32, -0.3..0.3_f32);
    prop_oneof![
        8 => input(ids).prop_map(Step::Handle),
        4 => time().prop_map(Step::Tick),
        1 => Just(Duration::MAX).prop_map(Step::Back),
        3 => near.prop_map(|(x, y, z)| Step::AllReport(Vec3::new(x, y, z))),
        1 => (avatar(ids), avatar(ids)).prop_map(|(one, other)| Step::Ask(one, other)),
    ]
}

/// Steps of a few people, who are often alone, or of so many that threads share the work.
fn steps() -> impl Strategy<Value = Vec<Step>> {
    select(vec![2, 5, 24]).prop_flat_map(|ids| prop::collection::vec(step(ids), 1..250))
}

fn policy() -> impl Strategy<Value = Policy> {
    let length = || prop_oneof![4 => 0.1..50.0_f32, 1 => coordinate()];
    prop_oneof![
        12 => Just(Policy::Tbv),
        2 => Just(Policy::Pvs),
        1 => Just(Policy::Broadcast),
        1 => length().prop_map(Policy::Radius),
        1 => length().prop_map(Policy::Grid),
        1 => (length(), length()).prop_map(|(edge, margin)| Policy::Region { edge, margin }),
        1 => prop_oneof![3 => 0..4_u32, 1 => Just(100)].prop_map(|doors| Policy::Room { doors }),
    ]
}

/// A configuration most of whose values are the defaults.
fn config() -> impl Strategy<Value = Config> {
    let usual = Config::default();
    let validity = prop_oneof![
        3 => Just(Validity::UntilLeft),
        1 => Just(Validity::Maximal),
        1 => Just(Validity::Adaptive),
        1 => span().prop_map(Validity::Constant),
    ];
    let margin = prop_oneof![
        9 => Just(usual.margin),
        1 => span().prop_map(Margin::Fixed),
        1 => (span(), span()).prop_map(|(first, most)| Margin::Measured { first, most }),
    ];
    let or = |usual: Duration| prop_oneof![24 => Just(usual), 1 => span()];
    let spans = (
        or(usual.tick),
        or(usual.validity_max),
        or(usual.horizon_max),
        or(usual.round_trip_initial),
        or(usual.silence_retry),
        or(usual.stall),
        or(usual.ask_timeout),
        or(usual.refusal_window),
    );
    let count =
        |usual: u32| prop_oneof![24 => Just(usual), 1 => select(vec![0, 1, 7, 100, u32::MAX])];
    let counts = (
        count(usual.sight_test_budget),
        count(usual.silence_budget),
        count(usual.sight_test_max),
        count(usual.hold_ticks),
        count(usual.asks_max),
        count(usual.refusals_max),
        prop_oneof![20 => 1..64_usize, 1 => select(vec![0, usize::MAX])],
        prop_oneof![20 => Just(1_000_usize), 1 => select(vec![0, 5, usize::MAX])],
    );
    let others = (
        prop_oneof![20 => Just(None), 1 => coordinate().prop_map(Some)],
        prop_oneof![20 => Just(usual.spare_m), 1 => coordinate()],
        select(vec![TbvShape::Reach, TbvShape::Reach, TbvShape::Sphere]),
    );
    (policy(), validity, margin, spans, counts, others).prop_map(
        |(policy, validity, margin, spans, counts, (speed_max, spare_m, shape))| Config {
            policy,
            validity,
            margin,
            tick: spans.0,
            validity_max: spans.1,
            horizon_max: spans.2,
            round_trip_initial: spans.3,
            silence_retry: spans.4,
            stall: spans.5,
            ask_timeout: spans.6,
            refusal_window: spans.7,
            sight_test_budget: counts.0,
            silence_budget: counts.1,
            sight_test_max: counts.2,
            hold_ticks: counts.3,
            asks_max: counts.4,
            refusals_max: counts.5,
            expiries_max: counts.6,
            avatars_max: counts.7,
            speed_max,
            spare_m,
            shape,
            ..Config::default()
        },
    )
}

fn world() -> impl Strategy<Value = World> {
    prop_oneof![
        2 => any::<u64>().prop_map(reference_model::world_of),
        2 => (2..30_u32).prop_map(stage::row),
        1 => (0..1_u32).prop_map(|_| rooms::world()),
    ]
}

/// An engine, and what its clients know.
struct Outside {
    engine: Engine,
    now: Duration,
    /// The avatars that each client has been told of.
    sees: BTreeMap<AvatarId, BTreeSet<AvatarId>>,
    /// When each avatar's last report was made.
    made: BTreeMap<AvatarId, Duration>,
    outputs: Vec<Output>,
}

impl Outside {
    fn new(world: &Arc<World>, config: &Config, threads: usize) -> Self {
        let config = Config { threads, ..config.clone() };
        Self {
            engine: Engine::new(Arc::clone(world), config),
            now: Duration::ZERO,
            sees: BTreeMap::new(),
            made: BTreeMap::new(),
            outputs: Vec::new(),
        }
    }

    /// Takes a step, and returns what came out.
    fn step(&mut self, step: &Step) -> &[Output] {
        self.outputs.clear();
        match step {
            Step::Handle(input) => self.handle(input.clone()),
            Step::Tick(time) => {
                self.now += *time;
                self.tick(self.now);
            }
            Step::Back(time) => self.tick(self.now.saturating_sub(*time)),
            Step::AllReport(way) => self.all_report(*way),
            Step::Ask(one, other) => {
                let asked = self.engine.explain(*one, *other).map(|e| e.to_string().is_empty());
                assert_ne!(asked, Some(true));
                let _ = (self.engine.tbv(*one), self.engine.pose(*other));
            }
        }
        &self.outputs
    }

    fn handle(&mut self, input: Input) {
        match &input {
            Input::Report { avatar, report } => {
                let known = self.made.entry(*avatar).or_default();
                *known = (*known).max(report.made);
            }
            Input::Leave { avatar } => {
                self.sees.remove(avatar);
                self.made.remove(avatar);
            }
            Input::Return { avatar, .. } => {
                self.sees.entry(*avatar).and_modify(BTreeSet::clear);
                self.made.remove(avatar);
            }
            _ => {}
        }
        self.engine.handle(self.now, input);
    }

    fn all_report(&mut self, way: Vec3) {
        let is_heard = |id: &AvatarId| {
            matches!(self.engine.state(*id), Some(ReportingState::Live | ReportingState::Asked))
        };
        let heard: Vec<AvatarId> = self.engine.avatars().filter(is_heard).collect();
        for (turn, avatar) in (0..).zip(heard) {
            let way = if turn % 2 == 0 { way } else { -way };
            let Some(pose) = self.engine.pose(avatar) else { continue };
            let made = self.made.get(&avatar).copied().unwrap_or_default();
            let made = made.saturating_add(Duration::from_micros(1)).max(self.now);
            let pose = Pose { eye: pose.eye + way, velocity: way / 0.05, ..pose };
            let report = Report { made, orders: turn, pose };
            self.handle(Input::Report { avatar, report });
        }
    }

    fn tick(&mut self, at: Duration) {
        let mut outputs = Vec::new();
        self.engine.tick(at, &mut outputs);
        outputs.iter().for_each(|output| self.hear(output));
        for (avatar, sees) in &self.sees {
            let held: BTreeSet<AvatarId> = self.engine.held_by(*avatar).collect();
            assert_eq!(&held, sees, "of {avatar:?}");
            assert!(
                sees.iter().all(|id| self.engine.state(*id).is_some()),
                "a held avatar is present"
            );
        }
        let counts = self.engine.counts();
        assert_eq!(counts.live + counts.quiet + counts.asked, self.engine.avatars().count());
        self.outputs = outputs;
    }

    /// Takes in an output as its client does.
    fn hear(&mut self, output: &Output) {
        match output {
            Output::Entered { to, pose, .. } => {
                assert!(pose.is_finite());
                if self.engine.state(*to).is_some() {
                    self.sees.entry(*to).or_default();
                }
            }
            Output::Appear { to, avatar, pose, .. } => {
                assert!(pose.is_finite() && to != avatar);
                assert!(self.engine.state(*avatar).is_some(), "an avatar that appears is present");
                let is_new = self.sees.get_mut(to).expect("the client is in").insert(*avatar);
                assert!(is_new, "{avatar:?} appears to {to:?} once");
            }
            Output::Vanish { to, avatar } => {
                let seen = self.sees.get_mut(to).is_none_or(|sees| sees.remove(avatar));
                assert!(seen, "{avatar:?} vanishes from {to:?} but had not appeared");
            }
            Output::Poses { to, poses, .. } => {
                let sees = self.sees.get(to).expect("the client is in");
                assert!(poses.is_sorted_by(|(one, _), (other, _)| one < other));
                assert!(poses.iter().all(|(id, pose)| sees.contains(id) && pose.is_finite()));
            }
            Output::Quiet { to, tbv } => {
                assert!(self.sees.contains_key(to));
                let pose = self.engine.pose(*to).expect("the client is in");
                // Whoever moves is where its course leads by now.
                let stands = pose.velocity == Vec3::ZERO && !pose.falls;
                assert!(!stands || tbv.contains(pose.eye), "{tbv:?} {pose:?}");
            }
            Output::Correct { pose, .. } => assert!(pose.is_finite()),
            Output::Drop { to, .. } => {
                self.sees.remove(to);
                self.made.remove(to);
            }
            Output::Live { .. } | Output::Ask { .. } | Output::Chat { .. } => {}
        }
    }

    /// All leave, and nothing is kept of them except whose turn it is.
    fn empty(&mut self) {
        let all: Vec<AvatarId> = self.engine.avatars().collect();
        for avatar in all {
            self.handle(Input::Leave { avatar });
        }
        self.tick(self.now);
        assert!(self.sees.is_empty());
        let world = Arc::clone(self.engine.world());
        let mut new = Engine::new(world, self.engine.config().clone());
        new.tick(self.now, &mut Vec::new());
        let horizons = |engine: &Engine| format!("{:?}", engine.horizons);
        assert_eq!(horizons(&self.engine), horizons(&new));
        let [named, named_at_first] =
            [&self.engine, &new].map(|e| format!("{e:?}").matches("AvatarId(").count());
        assert_eq!(named, named_at_first, "an avatar that left is still named");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_inputs_in_any_order_are_survived(
        world in world(),
        config in config(),
        steps in steps(),
    ) {
        let world = Arc::new(world);
        let mut engines = [1, 2].map(|threads| Outside::new(&world, &config, threads));
        for step in &steps {
            let outputs = engines.each_mut().map(|engine| format!("{:?}", engine.step(step)));
            prop_assert_eq!(&outputs[0], &outputs[1], "one thread and two agree");
        }
        engines.iter_mut().for_each(Outside::empty);
    }
}
