use std::{
    collections::BTreeMap,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_world::{Spawn, geometry::Aabb, motion::Body};

use super::*;
use sightline_compiler::{
    CompileOptions, compile,
    import::{bsp, glb},
    model::{Model, Surface, SurfaceMaterial},
};

/// A building of rooms in a square, compiled for real: inner walls with a door each, thick outer
/// ones, a floor and a ceiling.
struct House {
    world: Arc<World>,
    rooms: usize,
}

const ROOM_M: f32 = 6.0;
const DOOR_M: f32 = 1.2;

impl House {
    fn new(rng: &mut SmallRng, rooms: usize) -> Self {
        let side = rooms as f32 * ROOM_M;
        let slab = |low: f32, high: f32| {
            let out = Vec3::new(0.3, 0.0, 0.3);
            Aabb::new(Vec3::Y * low - out, Vec3::new(side, high, side) + out)
        };
        let mut boxes = vec![slab(-0.3, 0.0), slab(2.6, 2.9)];
        for line in 0..=rooms {
            let at = line as f32 * ROOM_M;
            for room in 0..rooms {
                let (from, to) = (room as f32 * ROOM_M, (room + 1) as f32 * ROOM_M);
                let inner = line > 0 && line < rooms;
                for axis in [0, 2] {
                    let door = from + rng.random_range(0.5..ROOM_M - 0.5 - DOOR_M);
                    let gaps = if inner && rng.random_bool(0.7) {
                        vec![(from, door), (door + DOOR_M, to)]
                    } else {
                        vec![(from, to)]
                    };
                    boxes.extend(gaps.into_iter().map(|(a, b)| wall(axis, at, a, b)));
                }
            }
        }
        let opaque: Vec<[Vec3; 3]> = boxes.iter().flat_map(faces).collect();
        let model = Model {
            title: "house".to_owned(),
            surfaces: vec![surface(&opaque)],
            is_lit: true,
            opaque,
            solids: Vec::new(),
            spawns: vec![Spawn { eye: Vec3::new(3.0, 1.6, 3.0), yaw: 0.0 }],
            places: Vec::new(),
            body: Body::PERSON,
            speed_max: 2.0,
            movers: Vec::new(),
            rooms: Vec::new(),
            nodes: Vec::new(),
            origin: None,
            warnings: Vec::new(),
        };
        let options = CompileOptions { voxel: Some(0.5), cell: Some(3.0), ..Default::default() };
        let (world, _) =
            compile(&model, &options, &|_, _| std::ops::ControlFlow::Continue(())).unwrap();
        Self { world: Arc::new(world), rooms }
    }

    /// A trace of people who walk about and turn where they would bump into something.
    fn trace(&self, rng: &mut SmallRng, people: u32, seconds: u32) -> Trace {
        let sight = sightline_oracle::Oracle::new(&self.world.mesh);
        let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
        let mut walkers: BTreeMap<u32, (Vec3, Vec3)> = (0..people)
            .map(|id| {
                let mut room = || (rng.random_range(0..self.rooms) as f32 + 0.5) * ROOM_M;
                (id, (Vec3::new(room(), 1.6, room()), Vec3::ZERO))
            })
            .collect();
        for k in 0..seconds * 10 {
            for (id, (eye, velocity)) in &mut walkers {
                let room = *velocity * 0.4;
                let may_go_on = sight.between(*eye, *eye + room) && !rng.random_bool(0.05);
                if !may_go_on {
                    // It stops, or else it starts.
                    let angle = rng.random_range(0.0..std::f32::consts::TAU);
                    let is_start = *velocity == Vec3::ZERO && rng.random_bool(0.7);
                    let speed = if is_start { 1.3 } else { 0.0 };
                    *velocity = Vec3::new(angle.cos(), 0.0, angle.sin()) * speed;
                    if !sight.between(*eye, *eye + *velocity * 0.4) {
                        *velocity = Vec3::ZERO;
                    }
                }
                let (at, v) = (*eye, *velocity);
                let _ = write!(rows, "{},{id},{},{},{},0,0,", k * 100, at.x, at.y, at.z);
                let _ = writeln!(rows, "{},{},{}", v.x, v.y, v.z);
                *eye += v * 0.1;
            }
        }
        Trace::read(rows.as_bytes()).unwrap()
    }
}

/// A wall 0.2 m thick across an axis at a place, from one place to another along the other axis.
fn wall(axis: usize, at: f32, from: f32, to: f32) -> Aabb {
    let (mut min, mut max) = (Vec3::ZERO, Vec3::Y * 2.6);
    (min[axis], max[axis]) = (at - 0.1, at + 0.1);
    (min[2 - axis], max[2 - axis]) = (from, to);
    Aabb::new(min, max)
}

/// The twelve triangles of a box.
fn faces(of: &Aabb) -> Vec<[Vec3; 3]> {
    let size = of.size();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (mut u, mut v) = (Vec3::ZERO, Vec3::ZERO);
        u[(axis + 1) % 3] = size[(axis + 1) % 3];
        v[(axis + 2) % 3] = size[(axis + 2) % 3];
        let mut across = Vec3::ZERO;
        across[axis] = size[axis];
        for corner in [of.min, of.min + across] {
            triangles.push([corner, corner + u, corner + u + v]);
            triangles.push([corner, corner + u + v, corner + v]);
        }
    }
    triangles
}

fn surface(triangles: &[[Vec3; 3]]) -> Surface {
    Surface {
        positions: triangles.iter().flatten().copied().collect(),
        uvs: Vec::new(),
        colours: Vec::new(),
        triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        material: SurfaceMaterial { colour: [200; 3], texture: None, glass: false },
    }
}

fn options(policy: Policy, round_trip_ms: u64) -> ReplayOptions {
    let mut options = ReplayOptions::new(policy, Duration::from_millis(round_trip_ms));
    options.oracle = OracleStride::Every(Duration::from_millis(250));
    options
}

fn replay(world: &Arc<World>, trace: &Trace, options: &ReplayOptions) -> (ReplayReport, String) {
    let mut dump = Vec::new();
    let report = run(world, trace, options, Some(&mut dump), &mut |_| {}).unwrap();
    (report, String::from_utf8(dump).unwrap())
}

/// No miss, whatever the building, the walks and the round trip; and nothing is corrected.
#[test]
fn nothing_visible_is_missed_in_random_houses() {
    let mut quiet = 0.0;
    for seed in 0..12 {
        let mut rng = SmallRng::seed_from_u64(seed);
        let house = House::new(&mut rng, 3 + seed as usize % 3);
        let trace = house.trace(&mut rng, 8, 20);
        for (policy, round_trip_ms) in
            [(Policy::Tbv, 0), (Policy::Tbv, 70), (Policy::Tbv, 250), (Policy::Pvs, 100)]
        {
            let (report, _) = replay(&house.world, &trace, &options(policy, round_trip_ms));
            let oracle = report.oracle.as_ref().unwrap();
            let case = format!("seed {seed}, {policy} at {round_trip_ms} ms: {oracle:?}");
            assert_eq!(oracle.misses, 0, "{case}");
            assert!(
                oracle.pairs_visible > 0 && oracle.pairs_held >= oracle.pairs_visible,
                "{case}"
            );
            assert!(oracle.age_worst_ms <= oracle.age_bound_ms, "{case}");
            assert_eq!((report.corrections, report.jumps, report.outside), (0, 0, 0), "{case}");
            quiet += report.quiet_share;
        }
    }
    assert!(quiet > 1.0, "people are silent: {quiet}");
}

#[test]
fn the_dump_is_the_same_twice_and_adds_up() {
    let mut rng = SmallRng::seed_from_u64(7);
    let house = House::new(&mut rng, 5);
    let trace = house.trace(&mut rng, 10, 20);
    let (report, dump) = replay(&house.world, &trace, &options(Policy::Tbv, 100));
    let (_, again) = replay(&house.world, &trace, &options(Policy::Tbv, 100));
    assert!(dump == again);

    let mut held = std::collections::BTreeSet::new();
    let mut counts = BTreeMap::new();
    let mut last = 0;
    for line in dump.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [t, viewer, avatar, what] = fields[..] else { panic!("{line}") };
        let t: u64 = t.parse().unwrap();
        assert!(t >= last, "{line}");
        last = t;
        *counts.entry(what).or_insert(0_u64) += 1;
        match what {
            "enter" => assert!(held.insert((viewer, avatar)), "{line}"),
            "leave" => assert!(held.remove(&(viewer, avatar)), "{line}"),
            "update" => assert!(held.contains(&(viewer, avatar)), "{line}"),
            _ => assert!(viewer.is_empty(), "{line}"),
        }
    }
    assert_eq!(
        (counts["report"], counts.get("ask").copied().unwrap_or_default()),
        (report.reports, report.asks)
    );
    assert!(counts["enter"] > 0 && counts["leave"] > 0);
}

#[test]
fn whoever_is_absent_or_jumps_is_followed() {
    let mut rng = SmallRng::seed_from_u64(1);
    let house = House::new(&mut rng, 3);
    let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
    for k in 0..60 {
        let _ = writeln!(rows, "{},1,3,1.6,3,0,0,0,0,0", k * 100);
        // Away for a second, then back elsewhere; a jump later on.
        let x = if k < 20 {
            4.0
        } else if k < 45 {
            15.0
        } else {
            4.5
        };
        if !(20..30).contains(&k) {
            let _ = writeln!(rows, "{},2,{x},1.6,3,0,0,0,0,0", k * 100);
        }
    }
    let trace = Trace::read(rows.as_bytes()).unwrap();
    let (report, dump) = replay(&house.world, &trace, &options(Policy::Tbv, 100));
    assert_eq!((report.jumps, report.corrections), (1, 0));
    let oracle = report.oracle.unwrap();
    assert_eq!(oracle.misses, 0);
    let held_at = |ms: u64| {
        let mut held = false;
        for line in dump.lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            if fields[0].parse::<u64>().unwrap() > ms {
                break;
            }
            held = match (fields[1], fields[2], fields[3]) {
                ("1", "2", "enter") => true,
                ("1", "2", "leave") => false,
                _ => held,
            };
        }
        held
    };
    assert!(held_at(1_000) && !held_at(2_500) && held_at(5_500));
}

/// What is late by loss is excused, what is not late is not missed; and chance has a seed.
#[test]
fn loss_and_jitter_make_late_but_not_blind() {
    let mut rng = SmallRng::seed_from_u64(3);
    let house = House::new(&mut rng, 4);
    let trace = house.trace(&mut rng, 10, 20);
    let even = options(Policy::Pvs, 20);
    let mut options = options(Policy::Tbv, 20);
    let (spread, jitter) = (Duration::from_millis(200), Duration::from_millis(20));
    let network = NetworkConditions::default();
    options.network =
        NetworkConditions { spread, jitter, loss: 0.05, duplication: 0.05, seed: 1, ..network };
    options.config.margin = Margin::Fixed(jitter);
    let (report, dump) = replay(&house.world, &trace, &options);
    let (_, again) = replay(&house.world, &trace, &options);
    assert!(dump == again);
    options.network.seed = 2;
    assert!(dump != replay(&house.world, &trace, &options).1);
    let oracle = report.oracle.unwrap();
    assert_eq!((oracle.misses, oracle.stale, report.corrections), (0, 0, 0), "{oracle:?}");
    let (even, _) = replay(&house.world, &trace, &even);
    assert!(report.reports < even.reports, "{} of {} came", report.reports, even.reports);
}

#[test]
fn what_a_host_reads_adds_up() {
    let mut rng = SmallRng::seed_from_u64(9);
    let house = House::new(&mut rng, 4);
    let trace = house.trace(&mut rng, 8, 10);
    let run = |policy| replay(&house.world, &trace, &options(policy, 100)).0;
    let reports: Vec<ReplayReport> = Comparison::POLICIES.into_iter().map(run).collect();
    for report in &reports {
        let oracle = report.oracle.as_ref().unwrap();
        let case = format!("{}: {report:?}", report.policy);
        assert!(report.messages_to_client <= report.messages_to_client_worst, "{case}");
        assert!(report.bytes_from_client <= report.bytes_from_client_worst, "{case}");
        assert!(oracle.pairs_foreseen <= oracle.pairs_held, "{case}");
        assert!(oracle.over_send_horizon <= oracle.over_send || oracle.misses > 0, "{case}");
        let clients = report.clients.iter();
        let total = clients.map(|client| client.messages_to as f64).sum::<f64>();
        let seconds = report.clients.iter().map(|client| client.seconds).sum::<f64>();
        assert!((total / seconds / report.messages_to_client - 1.0).abs() < 1e-6, "{case}");
        assert!(report.enters >= report.leaves && report.enters > 0, "{case}");
        assert!(report.left_tbv == 0 || report.policy == "tbv", "{case}");
        assert!((report.enters_per_s - report.enters as f64 / 10.0).abs() < 0.2, "{case}");
        let always = oracle.hidden_reports > 0.99;
        assert!(always || report.policy == "tbv", "{case}");
        assert!(oracle.hidden_share > 0.0 && oracle.hidden_share < 1.0, "{case}");
    }
    let table = Comparison { reports }.to_string();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines.len(), 1 + Comparison::POLICIES.len());
    assert!(lines.iter().all(|line| line.chars().count() == lines[0].chars().count()), "{table}");
}

/// The folder of test data beside a checkout, if it is there.
fn shared() -> Option<PathBuf> {
    let named = std::env::var_os("SIGHTLINE_SHARED").map(PathBuf::from);
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    let found = [named, Some(beside)].into_iter().flatten().find(|path| path.is_dir());
    if found.is_none() {
        println!("skipped: ../shared is absent");
    }
    found
}

/// Whether nobody is missed in some seconds of a trace, looked at every so often.
fn nobody_is_missed(model: &Model, trace: &Path, [seconds, stride_ms]: [u64; 2]) {
    let coarse = CompileOptions { voxel: Some(1.0), cell: Some(3.0), ..Default::default() };
    let go_on = |_, _| std::ops::ControlFlow::Continue(());
    let world = Arc::new(compile(model, &coarse, &go_on).unwrap().0);
    let trace = Trace::open(trace).unwrap();
    for round_trip_ms in [0, 100] {
        let mut options = options(Policy::Tbv, round_trip_ms);
        options.length = Some(Duration::from_secs(seconds));
        options.oracle = OracleStride::Every(Duration::from_millis(stride_ms));
        let (report, _) = replay(&world, &trace, &options);
        let oracle = report.oracle.unwrap();
        assert!(oracle.pairs_visible > 100, "there is something to miss: {oracle:?}");
        assert_eq!((oracle.misses, report.corrections), (0, 0), "{oracle:?}");
        assert!(oracle.age_worst_ms <= oracle.age_bound_ms, "{oracle:?}");
    }
}

#[test]
fn pedestrians_in_four_hundred_rooms_are_not_missed() {
    let Some(shared) = shared() else { return };
    let bytes = fs::read(shared.join("traces/rooms400.glb")).unwrap();
    let model = glb::read_slice(&bytes, None, "rooms400").unwrap();
    nobody_is_missed(&model, &shared.join("traces/rooms400-60.csv.gz"), [6, 200]);
}

#[test]
fn bots_that_jump_and_are_thrown_about_are_not_missed() {
    let Some(shared) = shared() else { return };
    let model = bsp::read(&shared.join("maps/oa_dm2.bsp"), &[]).unwrap();
    nobody_is_missed(&model, &shared.join("traces/oa_dm2-32.csv.gz"), [4, 100]);
}
