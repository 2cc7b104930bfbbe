//! Tests entries of a PVS: for how many of them is there no line of sight?

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rand::{SeedableRng, rngs::SmallRng};
use rayon::prelude::*;

use super::{
    fuzzy::Fuzzy,
    options::{VerifyOptions, seed_of},
    original::Original,
    report::LooseEntries,
    subject::{Populated, Subject, draw_in},
};

/// After this many draws without an entry, the PVS is taken to have none.
const DRAWS_MAX: usize = 1_000_000;

/// Tests random entries between places with empty space in them. All entries are equally likely.
pub(super) fn looseness(
    subject: &dyn Subject,
    original: &Original<'_>,
    places: &[Populated],
    options: &VerifyOptions,
    progress: &(dyn Fn(f32) + Sync),
) -> LooseEntries {
    let done = AtomicU32::new(0);
    let nothing = || LooseEntries { lines_max: options.lines, ..LooseEntries::default() };
    let one = |entry: u32| {
        let mut rng = SmallRng::seed_from_u64(seed_of(options.seed, 3, entry.into()));
        let found = entry_between(subject, places, &mut rng).map_or_else(nothing, |[from, to]| {
            let mut is_free = || {
                let mut point = |within| draw_in(subject, original, within, &mut rng).point;
                original.in_sight(point(from), point(to))
            };
            let free_at = (0..options.lines).find(|_| is_free());
            LooseEntries {
                entries: 1,
                loose: u32::from(free_at.is_none()),
                lines_max: options.lines,
                lines: free_at.map_or(options.lines, |before| before + 1).into(),
                parted: None,
                pairs: free_at.map_or_else(|| vec![[from.place, to.place]], |_| Vec::new()),
            }
        });
        progress((done.fetch_add(1, Relaxed) + 1) as f32 / options.entries as f32);
        found
    };
    // One entry at a time: loose entries take far longer than others.
    let all = (0..options.entries).into_par_iter().with_max_len(1).map(one);
    all.reduce(nothing, LooseEntries::and)
}

/// A random entry between two different places with empty space in them.
fn entry_between<'a>(
    subject: &dyn Subject,
    places: &'a [Populated],
    rng: &mut SmallRng,
) -> Option<[&'a Populated; 2]> {
    let populated = |place: u32| {
        let index = places.binary_search_by_key(&place, |populated| populated.place).ok()?;
        Some(&places[index])
    };
    (0..DRAWS_MAX).find_map(|_| {
        let [from, to] = subject.entry(rng).filter(|[from, to]| from != to)?;
        Some([populated(from)?, populated(to)?])
    })
}

/// Counts the loose entries for which fuzzy projection proves that no line is free.
pub(super) fn count_parted(
    entries: &LooseEntries,
    fuzzy: &Fuzzy<'_>,
    progress: &(dyn Fn(f32) + Sync),
) -> u32 {
    let done = AtomicU32::new(0);
    let is_parted = |pair: &&[u32; 2]| {
        let is_parted = fuzzy.parts(**pair);
        progress((done.fetch_add(1, Relaxed) + 1) as f32 / entries.pairs.len() as f32);
        is_parted
    };
    entries.pairs.par_iter().filter(is_parted).count() as u32
}
