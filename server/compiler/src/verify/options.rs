//! How much is sampled, and with which seeds.

/// How much is sampled.
#[derive(Clone, Copy, Debug)]
pub struct VerifyOptions {
    /// Pairs of points in each of the two samples.
    pub pairs: u64,
    /// Entries of the PVS that are tested for looseness.
    pub entries: u32,
    /// An entry is loose when none of this many random lines is free.
    pub lines: u32,
    /// The same seed gives the same report, on any number of threads.
    pub seed: u64,
    /// Whether fuzzy projection examines the loose entries.
    pub fuzzy: bool,
}

impl VerifyOptions {
    /// Options for a number of pairs, with enough entries to know their looseness to a third of one
    /// per cent.
    pub fn new(pairs: u64) -> Self {
        Self { pairs, entries: 2_000, lines: 100_000, seed: 1, fuzzy: false }
    }
}

/// The seed of one piece of work. Each piece has a generator of its own.
pub(super) fn seed_of(seed: u64, stage: u64, piece: u64) -> u64 {
    // The generator mixes its seed. This only keeps the seeds of pieces different.
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ stage << 56 ^ piece
}
