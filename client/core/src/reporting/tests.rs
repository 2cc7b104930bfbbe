use glam::Vec3;
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::Body,
};

use super::*;

const TICK: Duration = Duration::from_millis(50);
const TOLERANCE: Tolerance =
    Tolerance { metres: 0.1, radians: 0.1, ahead: Duration::from_millis(200) };

fn reporter() -> Reporter {
    Reporter::new(TICK, Agility::of(&Body::PERSON, 4.0))
}

fn live(tolerance: Tolerance) -> Reporter {
    let mut reporter = reporter();
    reporter.enter();
    reporter.expect_reports(tolerance);
    reporter
}

fn tbv(radius: f32) -> Tbv {
    let within = Aabb::around(Vec3::ZERO, radius);
    let (expiry, notice) = (Duration::from_secs(60), Duration::ZERO);
    Tbv { within, axes: Axes::WORLD, expiry, notice }
}

fn pose(x: f32) -> Pose {
    Pose { eye: Vec3::X * x, ..Pose::default() }
}

/// The reasons at successive ticks, with these places.
fn reasons(reporter: &mut Reporter, from: u32, places: &[f32]) -> Vec<Option<ReportReason>> {
    let ticks = (from..).zip(places);
    ticks.map(|(i, x)| Some(reporter.tick(TICK * i, &pose(*x), TICK)?.0)).collect()
}

#[test]
fn nothing_is_due_outside_the_world() {
    let mut reporter = reporter();
    reporter.ask();
    assert_eq!((reporter.due(TICK, &pose(0.0)), reporter.answer(TICK, &pose(0.0))), (None, None));
    reporter.enter();
    let expected = [Some(ReportReason::Asked), Some(ReportReason::EveryTick)];
    assert_eq!(reasons(&mut reporter, 1, &[0.0, 0.0]), expected);
}

#[test]
fn an_avatar_on_course_is_silent_and_one_that_departs_is_not() {
    let mut reporter = live(TOLERANCE);
    let walk: Vec<f32> = (0..16).map(|i| i as f32 * 0.06).collect();
    let mut expected = vec![None; 16];
    // The first report has no velocity yet.
    expected[0] = Some(ReportReason::Asked);
    expected[1] = Some(ReportReason::Departed);
    assert_eq!(reasons(&mut reporter, 0, &walk), expected);
    // It stands still: off by 5 cm, and then by 11.
    let stopped = reasons(&mut reporter, 16, &[0.91; 3]);
    assert_eq!(stopped, [None, Some(ReportReason::Departed), None]);
}

#[test]
fn an_avatar_on_course_reports_after_the_keep_alive() {
    let mut reporter = live(TOLERANCE);
    let reports = |reporter: &mut Reporter, speed: f32| {
        (1..200)
            .filter(|i| reporter.tick(TICK * *i, &pose(*i as f32 * speed), TICK).is_some())
            .count()
    };
    assert_eq!(reports(&mut reporter, 0.0), 3, "one at the beginning, and every four seconds");
    let mut reporter = live(TOLERANCE);
    assert_eq!(reports(&mut reporter, 0.06), 4, "two at the beginning");
    assert_eq!(reporter.counts(), ReportingCounts { ticks: 199, quiet: 0, on_course: 195 });
}

#[test]
fn a_turn_is_told_at_the_second_tick_and_one_that_is_taken_back_is_not() {
    let mut reporter = live(TOLERANCE);
    let yaws = [0.0, 0.0, 0.2, 0.0, 0.2, 0.2, 0.2];
    let ticks = (0..).zip(yaws);
    let reasons: Vec<Option<ReportReason>> = ticks
        .map(|(i, yaw)| Some(reporter.tick(TICK * i, &Pose { yaw, ..pose(0.0) }, TICK)?.0))
        .collect();
    let (asked, departed) = (Some(ReportReason::Asked), Some(ReportReason::Departed));
    assert_eq!(reasons, [asked, None, None, None, None, departed, None]);
}

/// The yaws at successive ticks at which there is a report, and the rates of turning in them.
fn turns_told(yaws: &[f32]) -> Vec<(usize, f32)> {
    let mut reporter = live(TOLERANCE);
    let report_at = |(i, yaw): (usize, &f32)| {
        let pose = Pose { yaw: *yaw, ..pose(0.0) };
        let (_, report) = reporter.tick(TICK * i as u32, &pose, TICK)?;
        Some((i, report.pose.yaw_rate))
    };
    yaws.iter().enumerate().filter_map(report_at).collect()
}

#[test]
fn a_large_turn_is_told_at_once_and_a_flick_is_not_taken_to_go_on() {
    let turn = turns_told(&[0.0, 0.0, 0.3, 0.6, 0.9, 1.2, 1.5]);
    let [(0, _), (3, rate)] = turn[..] else { panic!("{turn:?}") };
    assert!((rate - 6.0).abs() < 0.02, "an even turn goes on at {rate} radians a second");
    assert_eq!(turns_told(&[0.0, 0.0, 1.0, 1.0, 1.0]), [(0, 0.0), (2, 0.0)]);
}

#[test]
fn a_finer_tolerance_asks_for_a_report_and_a_coarser_one_does_not() {
    let mut reporter = live(TOLERANCE);
    assert!(reporter.tick(TICK, &pose(0.0), TICK).is_some());
    reporter.expect_reports(Tolerance { metres: 0.2, ..TOLERANCE });
    assert_eq!(reporter.answer(TICK, &pose(0.0)), None);
    reporter.expect_reports(Tolerance { metres: 0.2, radians: 0.05, ..TOLERANCE });
    assert_eq!(reporter.answer(TICK, &pose(0.0)), None, "no region depends on turns");
    reporter.expect_reports(TOLERANCE);
    let now = TICK + TICK / 4;
    let report = reporter.answer(now, &pose(0.0)).expect("less is allowed");
    assert_eq!((report.made, report.orders), (TICK / 4, 4));
    assert_eq!(reporter.answer(now, &pose(0.0)), None, "once");
}

#[test]
fn reports_at_ticks_are_stamped_with_the_tick_however_late_it_is() {
    let mut reporter = live(Tolerance::NONE);
    let late_ms = [0, 10, 40, 0, -3, 20];
    for (i, late_ms) in (0..).zip(late_ms) {
        let now = Duration::from_millis((1_000 + 50 * i + late_ms) as u64);
        let (_, report) = reporter.tick(now, &pose(0.0), TICK).expect("at every tick");
        assert_eq!(report.made, TICK * i as u32, "{late_ms}");
    }
}

#[test]
fn a_report_that_leaves_the_tbv_waits_for_its_answer() {
    let mut reporter = live(Tolerance::NONE);
    reasons(&mut reporter, 0, &[0.9]);
    reporter.expect_silence(tbv(1.0));
    assert_eq!(reasons(&mut reporter, 1, &[0.9]), [None]);
    let leaving = Some(ReportReason::Leaving);
    let expected = [leaving, None, None, leaving, None, None, leaving];
    assert_eq!(reasons(&mut reporter, 2, &[1.1; 7]), expected);
    assert_eq!(reporter.due(TICK * 9, &pose(1.1)), leaving, "it is due all the time");
    reporter.expect_silence(tbv(2.0));
    assert_eq!(reasons(&mut reporter, 9, &[2.1]), [leaving], "a new TBV waits for nothing");
}

#[test]
fn the_end_of_the_validity_is_reported_unasked() {
    let mut reporter = live(Tolerance::NONE);
    reasons(&mut reporter, 0, &[0.0]);
    reporter.expect_silence(Tbv { expiry: TICK * 4, ..tbv(1.0) });
    let expired = Some(ReportReason::Expired);
    assert_eq!(reasons(&mut reporter, 1, &[0.0; 4]), [None, None, None, expired]);
}

#[test]
fn an_ask_is_settled_once() {
    let mut reporter = live(Tolerance::NONE);
    reasons(&mut reporter, 0, &[0.0]);
    reporter.expect_silence(tbv(1.0));
    reporter.ask();
    assert_eq!(reporter.due(TICK, &pose(0.0)), Some(ReportReason::Asked));
    assert!(reporter.answer(TICK, &pose(0.0)).is_some());
    assert_eq!(reporter.answer(TICK, &pose(0.0)), None);
    assert_eq!(reasons(&mut reporter, 2, &[0.0]), [None]);
}
