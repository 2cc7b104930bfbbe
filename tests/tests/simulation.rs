//! Two hundred simulations of the engine, and sixty with each fault.

use rayon::prelude::*;
use sightline_tests::simulation::{
    BuildingPool, DetectionRate, Fault, SimulationOutcome, outputs_by_tick, run, run_stations,
};

/// Simulations of the engine without faults.
const SEEDS: u64 = 200;
/// Simulations with each fault: the first of the seeds above.
const SEEDS_BROKEN: u64 = 60;
/// The least number of simulations in which each fault could act.
const ACTED_MIN: usize = 10;
const BUILDINGS: u64 = 40;
/// The same for several stations.
const SEEDS_OF_STATIONS: u64 = 34;
const SEEDS_OF_STATIONS_BROKEN: u64 = 27;
const BUILDINGS_OF_STATIONS: u64 = 24;
/// Seeds that once broke a promise, or seemed to, in pools of this number of buildings.
const ONCE_BROKEN_BUILDINGS: u64 = 200;
const ONCE_BROKEN: [(u64, &str); 11] = [
    (82, "a report overtook the word that its avatar was put elsewhere"),
    (3999, "an avatar stopped dead, of which its client told just after a tick of the server"),
    (5315, "a round trip that grew made a course late at the server"),
    (6017, "round trips that grew made a course late at the server and at the viewer"),
    (6275, "the engine knew that a report was late, and those who asked it did not"),
    (6633, "a report carried a later time than its own, by a part of a tick"),
    (6786, "two reports overtook the word that their avatar was put elsewhere"),
    (7135, "a body was taken to fill the box around a bent reach"),
    (9409, "an answer came at once and changed what the engine was asked about"),
    (9425, "a report that showed a smaller tolerance came with the order to be silent"),
    (9681, "a body was taken to fill the box around a bent reach, where all run"),
];

#[test]
fn promises_are_kept_and_injected_faults_are_found() {
    let pool = BuildingPool::new(BUILDINGS, &|| ());
    let outcomes: Vec<SimulationOutcome> =
        (0..SEEDS).into_par_iter().map(|seed| run(seed, &pool, Fault::None)).collect();
    let bad: Vec<String> =
        outcomes.iter().filter(|o| !o.is_good()).map(ToString::to_string).collect();
    assert!(bad.is_empty(), "{} of {SEEDS}:\n{}", bad.len(), bad.join("\n"));
    let sum = |of: fn(&SimulationOutcome) -> u64| outcomes.iter().map(of).sum::<u64>();
    let visible = sum(|o| o.report.oracle.as_ref().map_or(0, |oracle| oracle.pairs_visible));
    let hidden = sum(|o| o.observed.hidden_ticks);
    assert!(visible > 100_000, "too few visible pairs: {visible}");
    assert!(hidden > 1_000, "too little silence: {hidden}");
    for fault in Fault::ALL {
        let broken: Vec<SimulationOutcome> =
            (0..SEEDS_BROKEN).into_par_iter().map(|seed| run(seed, &pool, fault)).collect();
        let findings = DetectionRate::of(fault, outcomes.iter().zip(&broken));
        println!("{fault:?} was {findings}");
        assert!(findings.are_enough(fault), "{fault:?} was {findings}");
        assert!(findings.acted >= ACTED_MIN, "{fault:?} was {findings}");
    }
}

#[test]
fn seeds_that_once_broke_a_promise_keep_all() {
    for (seed, cause) in ONCE_BROKEN {
        let outcome = run(seed, &BuildingPool::only(seed, ONCE_BROKEN_BUILDINGS), Fault::None);
        assert!(outcome.is_good(), "{cause}: {outcome}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_outputs() {
    let pool = BuildingPool::new(2, &|| ());
    // One budget is enough for all sight tests, the other leaves most of them out.
    for (seed, sight_test_budget) in (0..).zip([300_000, 5_000]) {
        let one = outputs_by_tick(seed, &pool, 70, 1, sight_test_budget, 0);
        let told: usize = one.iter().map(Vec::len).sum();
        assert!(told > 5_000, "seed {seed}: too few outputs: {told}");
        for threads in [2, 3] {
            let several = outputs_by_tick(seed, &pool, 70, threads, sight_test_budget, 0);
            let differs = one.iter().zip(&several).position(|(one, several)| one != several);
            assert_eq!(differs, None, "seed {seed}: {threads} threads differ at that tick");
            assert_eq!(one.len(), several.len());
        }
    }
}

#[test]
fn one_station_gives_the_outputs_of_a_server_that_is_none() {
    let pool = BuildingPool::new(2, &|| ());
    for seed in 0..2 {
        let [none, one] =
            [0, 1].map(|stations| outputs_by_tick(seed, &pool, 24, 1, 300_000, stations));
        assert!(none.iter().map(Vec::len).sum::<usize>() > 1_000, "seed {seed}: too few outputs");
        assert!(none == one, "seed {seed}: a station differs");
    }
}

#[test]
fn several_stations_keep_all_promises_and_their_faults_are_found() {
    let pool = BuildingPool::new(BUILDINGS_OF_STATIONS, &|| ());
    let simulate = |seeds: u64, fault: Fault| -> Vec<SimulationOutcome> {
        (0..seeds).into_par_iter().map(|seed| run_stations(seed, &pool, fault)).collect()
    };
    let outcomes = simulate(SEEDS_OF_STATIONS, Fault::None);
    let bad: Vec<String> =
        outcomes.iter().filter(|o| !o.is_good()).map(ToString::to_string).collect();
    assert!(bad.is_empty(), "{} of {SEEDS_OF_STATIONS}:\n{}", bad.len(), bad.join("\n"));
    let abroad = |o: &SimulationOutcome| o.report.oracle.as_ref().map_or(0, |o| o.pairs_abroad);
    let abroad: u64 = outcomes.iter().map(abroad).sum();
    assert!(abroad > 10_000, "too few visible pairs at two stations: {abroad}");
    for fault in Fault::OF_STATIONS {
        let broken = simulate(SEEDS_OF_STATIONS_BROKEN, fault);
        let findings = DetectionRate::of(fault, outcomes.iter().zip(&broken));
        println!("{fault:?} was {findings}");
        assert!(findings.are_enough(fault) && findings.found > 0, "{fault:?} was {findings}");
    }
}
