//! Two hundred simulations, and what is broken on purpose.

use rayon::prelude::*;
use sightline_tests::simulation::{
    BuildingPool, DetectionRate, Fault, SimulationOutcome, outputs_by_tick, run,
};

/// Simulations of the engine as it is.
const SEEDS: u64 = 200;
/// Simulations of an engine that is broken on purpose: the first of these.
const SEEDS_BROKEN: u64 = 60;
/// In so many of which each fault could act.
const ACTED_MIN: usize = 10;
const BUILDINGS: u64 = 40;

#[test]
fn promises_are_kept_and_what_is_broken_is_found() {
    let pool = BuildingPool::new(BUILDINGS, &|| ());
    let outcomes: Vec<SimulationOutcome> =
        (0..SEEDS).into_par_iter().map(|seed| run(seed, &pool, Fault::None)).collect();
    let bad: Vec<String> =
        outcomes.iter().filter(|o| !o.is_good()).map(ToString::to_string).collect();
    assert!(bad.is_empty(), "{} of {SEEDS}:\n{}", bad.len(), bad.join("\n"));
    let sum = |of: fn(&SimulationOutcome) -> u64| outcomes.iter().map(of).sum::<u64>();
    let visible = sum(|o| o.report.oracle.as_ref().map_or(0, |oracle| oracle.pairs_visible));
    let hidden = sum(|o| o.seen.hidden_ticks);
    assert!(visible > 100_000, "there is something to miss: {visible}");
    assert!(hidden > 1_000, "there is silence: {hidden}");
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
fn any_number_of_threads_says_the_same() {
    let pool = BuildingPool::new(4, &|| ());
    // With enough for all looks, and with so little that most go without.
    for (seed, sight_test_budget) in (0..4).zip([300_000, 5_000].into_iter().cycle()) {
        let one = outputs_by_tick(seed, &pool, 70, [1, sight_test_budget]);
        let told: usize = one.iter().map(Vec::len).sum();
        assert!(told > 5_000, "seed {seed}: there is something to tell: {told}");
        for threads in [2, 3] {
            let several = outputs_by_tick(seed, &pool, 70, [threads, sight_test_budget]);
            let differs = one.iter().zip(&several).position(|(one, several)| one != several);
            assert_eq!(differs, None, "seed {seed}: {threads} threads differ at that tick");
            assert_eq!(one.len(), several.len());
        }
    }
}
