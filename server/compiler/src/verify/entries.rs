//! Entries of a PVS: for how many of them there seems to be no line of sight.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rand::{SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    VerifyOptions,
    fuzzy::Fuzzy,
    original::Original,
    seed_of,
    subject::{Populated, Subject, draw_in},
};

/// After so many draws that were no entry, there is taken to be none.
const DRAWS_MAX: usize = 1_000_000;

/// How many entries are loose.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LooseEntries {
    /// Entries that were tested: pairs of two places that the PVS holds.
    pub entries: u32,
    /// Those for which no line was free.
    pub loose: u32,
    /// An entry is loose when so many random lines were tried.
    pub lines_max: u32,
    /// All lines that were tried.
    pub lines: u64,
    /// The loose entries of which fuzzy projection shows that there is no line, with the one cell as the box of eyes
    /// and the other as what is seen, or the other way round; if it was asked.
    pub parted: Option<u32>,
    /// The loose entries.
    #[serde(skip)]
    pub(super) pairs: Vec<[u32; 2]>,
}

impl LooseEntries {
    /// The part of the entries that is loose; none when there were none.
    pub fn share(&self) -> Option<f64> {
        (self.entries > 0).then(|| f64::from(self.loose) / f64::from(self.entries))
    }

    /// How many loose entries fuzzy projection parts.
    pub(super) fn parted(&self, fuzzy: &Fuzzy<'_>, progress: &(dyn Fn(f32) + Sync)) -> u32 {
        let done = AtomicU32::new(0);
        let parts = |pair: &&[u32; 2]| {
            let is_parted = fuzzy.parts(**pair);
            progress((done.fetch_add(1, Relaxed) + 1) as f32 / self.pairs.len() as f32);
            is_parted
        };
        self.pairs.par_iter().filter(parts).count() as u32
    }

    fn and(mut self, mut other: Self) -> Self {
        self.pairs.append(&mut other.pairs);
        Self {
            entries: self.entries + other.entries,
            loose: self.loose + other.loose,
            lines_max: self.lines_max,
            lines: self.lines + other.lines,
            parted: None,
            pairs: self.pairs,
        }
    }
}

/// Tests random entries, all equally likely, between places with empty space in them.
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
    // One at a time, since the loose ones take far longer than the others.
    let all = (0..options.entries).into_par_iter().with_max_len(1).map(one);
    all.reduce(nothing, LooseEntries::and)
}

/// A random entry of two places that have empty space in them.
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
