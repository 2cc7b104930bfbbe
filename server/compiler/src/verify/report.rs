//! The figures of a verification.

use glam::Vec3;
use serde::Serialize;

/// The figures of a verification.
#[derive(Clone, Debug, Serialize)]
pub struct VerifyReport {
    /// The space that was sampled, in words.
    pub sampled: &'static str,
    /// Pairs of points that are uniform in space.
    pub by_volume: PairCounts,
    /// Pairs of points whose cells are all equally likely.
    pub by_cell: PairCounts,
    /// Cells with empty space in them. Only these are sampled by cell, and for entries.
    pub cells_sampled: usize,
    /// Tested entries of the PVS.
    pub entries: LooseEntries,
    /// Tested entries of the map's own vis lump.
    pub own_entries: Option<LooseEntries>,
}

/// The figures that tell whether a PVS is right, and how good it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VerifySummary {
    /// Pairs in sight that the PVS denies, in both samples.
    pub misses: u64,
    /// The over-send by volume. None when no pair is in sight.
    pub over_send: Option<f64>,
    /// The share of entries that are loose. None when no entry was tested.
    pub looseness: Option<f64>,
    /// The misses of the map's own vis lump.
    pub own_misses: Option<u64>,
    /// The over-send of the map's own vis lump.
    pub own_over_send: Option<f64>,
    /// The share of loose entries of the map's own vis lump.
    pub own_looseness: Option<f64>,
}

impl VerifyReport {
    /// The figures that matter most.
    pub fn summary(&self) -> VerifySummary {
        let (by_volume, by_cell) = (&self.by_volume, &self.by_cell);
        let own = by_volume.own.as_ref();
        VerifySummary {
            misses: by_volume.ours.misses + by_cell.ours.misses,
            over_send: by_volume.over_send(&by_volume.ours),
            looseness: self.entries.share(),
            own_misses: own.zip(by_cell.own.as_ref()).map(|(a, b)| a.misses + b.misses),
            own_over_send: own.and_then(|own| by_volume.over_send(own)),
            own_looseness: self.own_entries.as_ref().and_then(LooseEntries::share),
        }
    }
}

/// A pair in sight that a PVS denies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Miss {
    /// A point, in metres.
    pub from: Vec3,
    /// A point that is visible from the first one.
    pub to: Vec3,
    /// The cells or clusters in which the two points lie, if in any.
    pub places: [Option<u32>; 2],
}

/// Counts of sampled pairs of points.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PairCounts {
    /// The pairs that count.
    pub pairs: u64,
    /// Further pairs, which do not count: one point lies in no cell, and they are not in sight.
    pub closed: u64,
    /// Pairs in sight.
    pub sight: u64,
    /// Pairs that a PVS denies and rays take to be in sight, but that double precision shows
    /// blocked.
    pub grazing: u64,
    /// What the world's PVS says.
    pub ours: PvsTally,
    /// What the map's own vis lump says.
    pub own: Option<PvsTally>,
}

/// What a PVS says of sampled pairs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PvsTally {
    /// Pairs that the PVS holds.
    pub pvs: u64,
    /// Pairs in sight that the PVS denies.
    pub misses: u64,
    /// The first few misses.
    pub first_misses: Vec<Miss>,
}

impl PairCounts {
    /// The over-send: P(PVS) / P(sight). None when no pair was in sight.
    pub fn over_send(&self, tally: &PvsTally) -> Option<f64> {
        (self.sight > 0).then(|| tally.pvs as f64 / self.sight as f64)
    }

    /// The sum of both. Of the later misses only as many are kept as there is room for.
    pub(super) fn and(mut self, later: Self) -> Self {
        self.pairs += later.pairs;
        self.closed += later.closed;
        self.sight += later.sight;
        self.grazing += later.grazing;
        self.ours = self.ours.and(later.ours);
        self.own = match (self.own, later.own) {
            (Some(own), Some(later)) => Some(own.and(later)),
            (own, later) => own.or(later),
        };
        self
    }
}

impl PvsTally {
    pub(super) fn and(mut self, later: Self) -> Self {
        self.pvs += later.pvs;
        self.misses += later.misses;
        self.first_misses.extend(later.first_misses);
        self.first_misses.truncate(MISSES_SHOWN);
        self
    }

    /// Counts a miss.
    pub(super) fn miss(&mut self, miss: Miss) {
        self.misses += 1;
        if self.first_misses.len() < MISSES_SHOWN {
            self.first_misses.push(miss);
        }
    }
}

/// How many misses are kept to be shown.
const MISSES_SHOWN: usize = 5;

/// Counts of tested entries, and how many of them are loose.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LooseEntries {
    /// Tested entries: pairs of two different places that the PVS holds.
    pub entries: u32,
    /// Loose entries: no tried line between the two places was free.
    pub loose: u32,
    /// How many random lines are tried before an entry is called loose.
    pub lines_max: u32,
    /// All tried lines.
    pub lines: u64,
    /// Loose entries for which fuzzy projection proves that no line is free, with a box around one
    /// cell as the eyes and a box around the other as the target. None when it was not asked for.
    pub parted: Option<u32>,
    /// The loose entries, as pairs of places.
    #[serde(skip)]
    pub(super) pairs: Vec<[u32; 2]>,
}

impl LooseEntries {
    /// The share of entries that are loose. None when no entry was tested.
    pub fn share(&self) -> Option<f64> {
        (self.entries > 0).then(|| f64::from(self.loose) / f64::from(self.entries))
    }

    /// The sum of both.
    pub(super) fn and(mut self, mut other: Self) -> Self {
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
