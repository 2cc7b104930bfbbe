mod crowd;
mod house;

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    ops::ControlFlow,
    path::Path,
    sync::Arc,
    time::Duration,
};

use rand::{SeedableRng, rngs::SmallRng};
use sightline_compiler::{
    CompileOptions, LightMethod, compile,
    import::{bsp, glb},
    model::Model,
};
use sightline_engine::{Config, Margin, Policy};
use sightline_fixtures::shared_files::shared_file;

use super::*;
use house::House;

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

/// No visible avatar is missed and no claim is corrected, whatever the building, the walks and the
/// round trip.
#[test]
fn no_visible_avatar_is_missed_in_random_buildings() {
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

/// The claim of Sudarsky and Gotsman (1996, section 5), with the same people and walks: stations
/// without a server tell each other far less than everybody tells everybody, and miss nobody.
#[test]
fn peers_tell_each_other_less_than_a_broadcast_and_miss_nobody() {
    let mut rng = SmallRng::seed_from_u64(3);
    let house = House::new(&mut rng, 5);
    let trace = house.trace(&mut rng, 10, 20);
    let all = Configuration::all(3).map(|configuration| {
        let options = configuration.options(&options(Policy::Tbv, 100), 10);
        let (report, _) = replay(&house.world, &trace, &options);
        assert_eq!(report.oracle.as_ref().unwrap().misses, 0, "{configuration}");
        ConfigurationReport { configuration, report }
    });
    let [broadcast, server, network, peers] = &all;
    let stations = |of: &ConfigurationReport| of.report.stations.as_ref().map_or(0, |s| s.stations);
    assert_eq!([broadcast, server, network, peers].map(stations), [0, 0, 3, 10]);
    let words = |of: &ConfigurationReport| {
        let kinds = &of.report.stations.as_ref().unwrap().messages;
        kinds.iter().filter(|(kind, _)| **kind != "heartbeat").map(|(_, n)| *n).sum::<u64>()
    };
    let to_all = 10.0 * 9.0 * 20.0 * peers.report.seconds;
    assert!(words(network) > 0 && words(network) < words(peers));
    assert!((words(peers) as f64) < 0.5 * to_all, "{} of {to_all}", words(peers));
    let table = ConfigurationTable { rows: all.to_vec() }.to_string();
    assert_eq!(table.lines().count(), 5, "{table}");
    println!("{table}");
}

#[test]
fn two_runs_give_the_same_dump_and_it_agrees_with_the_figures() {
    let mut rng = SmallRng::seed_from_u64(7);
    let house = House::new(&mut rng, 5);
    let trace = house.trace(&mut rng, 10, 20);
    let (report, dump) = replay(&house.world, &trace, &options(Policy::Tbv, 100));
    let (_, again) = replay(&house.world, &trace, &options(Policy::Tbv, 100));
    assert!(dump == again);

    let mut held = BTreeSet::new();
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
fn absences_and_jumps_of_an_avatar_are_followed() {
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

/// Late messages excuse a miss; without them there is none. The same seed gives the same dump.
#[test]
fn loss_and_jitter_cause_no_misses_but_those_of_late_messages() {
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

/// A player who turns about every other tick is shown hardly worse when messages are lost: the
/// stream does not hold up what follows a lost report.
#[test]
fn a_lost_report_does_not_hold_up_those_that_follow_it() {
    let house = House::new(&mut SmallRng::seed_from_u64(1), 3);
    let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
    for k in 0..600_u32 {
        let turns = (k / 2 % 2 == 0) as u32 as f32;
        let (x, speed) = (3.0 + 0.2 * turns, 4.0 - 8.0 * turns);
        let _ = writeln!(rows, "{},1,{x:.3},1.6,2,0,0,{speed},0,0", k * 50);
        let _ = writeln!(rows, "{},2,3,1.6,4,0,0,0,0,0", k * 50);
    }
    let trace = Trace::read(rows.as_bytes()).unwrap();
    let mut options = options(Policy::Tbv, 200);
    options.network.loss = 0.05;
    options.config.margin = Config::default().margin;
    let (report, _) = replay(&house.world, &trace, &options);
    let oracle = report.oracle.as_ref().unwrap();
    assert_eq!((oracle.misses, report.corrections, report.jumps), (0, 0, 0), "{oracle:?}");
    assert!(report.reports_from_client > 5.0, "one of the two reports often: {report:?}");
    assert!(oracle.promised_error_p99_m < 0.4, "{oracle:?}");
}

/// Two people in one room. One stands; the other walks up and down at 1 m/s, and turns about every
/// six seconds.
fn two_in_a_room(by_exception: bool) -> (ReplayReport, String) {
    let mut rng = SmallRng::seed_from_u64(1);
    let house = House::new(&mut rng, 3);
    let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
    for k in 0..600_u32 {
        let (lap, part) = (k / 60, (k % 60) as f32 / 15.0);
        let (x, speed) = if lap % 2 == 0 { (1.0 + part, 0.667) } else { (5.0 - part, -0.667) };
        let _ = writeln!(rows, "{},1,{x:.3},1.6,2,0,0,{speed},0,0", k * 100);
        let _ = writeln!(rows, "{},2,3,1.6,4,0,0,0,0,0", k * 100);
    }
    let trace = Trace::read(rows.as_bytes()).unwrap();
    let mut options = options(Policy::Tbv, 100);
    options.config.by_exception = by_exception;
    replay(&house.world, &trace, &options)
}

/// With the bytes of the wire, a straight walk in sight costs hardly more reports than standing
/// still: at each end, and one every four seconds.
#[test]
fn an_avatar_on_a_straight_walk_reports_at_its_ends_and_every_four_seconds() {
    let (report, dump) = two_in_a_room(true);
    let oracle = report.oracle.as_ref().unwrap();
    assert_eq!((oracle.misses, oracle.stale, report.corrections, report.jumps), (0, 0, 0, 0));
    let reports = |id: &str| {
        let of_avatar = |line: &&str| line.ends_with(&format!(",,{id},report"));
        dump.lines().filter(of_avatar).count() as f64 / 60.0
    };
    let [walking, standing] = [reports("1"), reports("2")];
    assert!((0.3..1.0).contains(&walking), "{walking} reports a second");
    assert!((0.2..0.5).contains(&standing), "{standing} reports a second");
    assert!(report.course_share > 0.9 && report.quiet_share < 0.01, "{report:?}");
    assert!(oracle.shown_error_p99_m < 0.3, "{oracle:?}");
    assert!(oracle.promised_error_p99_m < 0.12, "off by the tolerance and a turn: {oracle:?}");
    assert!(oracle.floor_reports <= report.reports_from_client, "{oracle:?}");

    let (every_tick, _) = two_in_a_room(false);
    assert!((19.0..20.5).contains(&every_tick.reports_from_client), "{every_tick:?}");
    assert_eq!((every_tick.course_share, every_tick.oracle.as_ref().unwrap().stale), (0.0, 0));
    let oracle = every_tick.oracle.as_ref().unwrap();
    assert!(oracle.promised_error_p50_m < 0.01 && oracle.promised_error_p99_m < 0.04, "{oracle:?}");
    assert!(report.bytes_to_client * 5.0 < every_tick.bytes_to_client, "{report:?}");
}

/// A walk of ten laps in sight has ten straight courses. Nobody else needs more than one.
#[test]
fn the_floor_is_one_report_for_each_straight_course_in_sight() {
    let (report, _) = two_in_a_room(true);
    let oracle = report.oracle.unwrap();
    let courses = oracle.floor_reports * 2.0 * (report.seconds - 0.25);
    assert!((10.5..12.5).contains(&courses), "{courses} courses: {oracle:?}");
    assert!(oracle.floor_hidden_share < 0.01, "{oracle:?}");
}

#[test]
fn the_figures_of_a_report_agree_with_each_other() {
    let mut rng = SmallRng::seed_from_u64(9);
    let house = House::new(&mut rng, 4);
    let trace = house.trace(&mut rng, 8, 10);
    let run = |(policy, by_exception)| {
        let mut options = options(policy, 100);
        options.config.by_exception = by_exception;
        replay(&house.world, &trace, &options).0
    };
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
        let shares = report.quiet_share + report.course_share;
        assert!(shares < 1.0 && report.by_exception == (report.course_share > 0.0), "{case}");
        let reporting = report.reports_from_client * report.tick_ms / 1e3;
        assert!((shares + reporting - 1.0).abs() < 0.02, "{case}");
        assert!(oracle.shown_error_p50_m <= oracle.shown_error_p99_m, "{case}");
        assert!(oracle.floor_reports <= report.reports_from_client, "{case}");
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

/// Checks that no avatar is missed in the first seconds of a trace.
fn check_no_misses(model: &Model, trace: &Path, length: Duration, stride: Duration) {
    let coarse = CompileOptions {
        voxel: Some(1.0),
        cell: Some(3.0),
        light: LightMethod::None,
        ..Default::default()
    };
    let go_on = |_, _| ControlFlow::Continue(());
    let world = Arc::new(compile(model, &coarse, &go_on).unwrap().0);
    let trace = Trace::open(trace).unwrap();
    for round_trip_ms in [0, 100] {
        let mut options = options(Policy::Tbv, round_trip_ms);
        options.length = Some(length);
        options.oracle = OracleStride::Every(stride);
        let (report, _) = replay(&world, &trace, &options);
        let oracle = report.oracle.unwrap();
        assert!(oracle.pairs_visible > 100, "there is something to miss: {oracle:?}");
        assert_eq!((oracle.misses, report.corrections), (0, 0), "{oracle:?}");
        assert!(oracle.age_worst_ms <= oracle.age_bound_ms, "{oracle:?}");
    }
}

#[test]
fn no_pedestrian_in_four_hundred_rooms_is_missed() {
    let Some(building) = shared_file("traces/rooms400.glb") else { return };
    let Some(trace) = shared_file("traces/rooms400-60.csv.gz") else { return };
    let model = glb::read(&building).unwrap();
    let (length, stride) = (Duration::from_secs(6), Duration::from_millis(200));
    check_no_misses(&model, &trace, length, stride);
}

#[test]
fn no_bot_that_jumps_or_is_thrown_about_is_missed() {
    let Some(map) = shared_file("maps/oa_dm2.bsp") else { return };
    let Some(trace) = shared_file("traces/oa_dm2-32.csv.gz") else { return };
    let model = bsp::read(&map, &[]).unwrap();
    let (length, stride) = (Duration::from_secs(4), Duration::from_millis(100));
    check_no_misses(&model, &trace, length, stride);
}
