//! Whether a compiled world keeps its promise: its PVS against rays through the original.
//!
//! Pairs of points in empty space are sampled twice: *by volume*, uniformly, which is what two
//! people in the building are; and *by cell*, each cell as likely as another, so that small cells
//! are tested too. A pair in sight that the PVS denies is a *miss*. How often the PVS says yes for
//! each pair in sight is the *over-send*. An entry of the PVS, a pair of cells, for which no line
//! out of many random ones is free is *loose*. For a world from a Quake map, its own vis lump is
//! measured on the same points, beside ours.
//!
//! What is empty, and what is in sight, is decided by the original alone (`original`), never by
//! the cells. A point may lie in no cell: inside a wall, or where nobody who began at a spawn point
//! can look. Two such points see each other and nobody minds; but when somebody in a cell sees one,
//! it is not closed off, and that is a miss.

mod brushes;
mod entries;
mod exact;
mod fuzzy;
mod hull;
mod locate;
mod original;
mod pairs;
mod subject;

use glam::Vec3;
use serde::Serialize;
use sightline_world::World;

pub use entries::LooseEntries;
pub use pairs::{PairCounts, PvsTally};

use fuzzy::Fuzzy;
use original::Original;
use subject::{Lump, Ours, Subject};

/// How much is sampled.
#[derive(Clone, Copy, Debug)]
pub struct VerifyOptions {
    /// Pairs of points, for each of the two ways to sample them.
    pub pairs: u64,
    /// Entries of the PVS that are tested for looseness.
    pub entries: u32,
    /// An entry is loose when so many random lines find nothing.
    pub lines: u32,
    /// The same seed gives the same report, on any number of threads.
    pub seed: u64,
    /// Whether loose entries are put to fuzzy projection too.
    pub fuzzy: bool,
}

impl VerifyOptions {
    /// As many pairs, and enough entries to know the looseness to a third of a per cent.
    pub fn new(pairs: u64) -> Self {
        Self { pairs, entries: 2_000, lines: 100_000, seed: 1, fuzzy: false }
    }
}

/// Why nothing can be verified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// No point was found that the original leaves empty.
    #[error("no empty space was found to sample")]
    Full,
    /// The opaque triangles are no surfaces to be projected.
    #[error(transparent)]
    Surfaces(#[from] sightline_visibility::fuzzy::SurfaceError),
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct VerifyReport {
    /// What space was sampled, in words.
    pub sampled: &'static str,
    /// Pairs uniform in space.
    pub by_volume: PairCounts,
    /// Pairs of which each cell is as likely as another.
    pub by_cell: PairCounts,
    /// Cells in which there is empty space; only these are sampled by cell, and for entries.
    pub cells_sampled: usize,
    /// Of the PVS.
    pub entries: LooseEntries,
    /// Of the map's own vis lump.
    pub own_entries: Option<LooseEntries>,
}

/// What decides whether a PVS is right, and how good it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VerifySummary {
    /// Pairs in sight that the PVS denies, of both ways to sample.
    pub misses: u64,
    /// By volume; none when no pair is in sight.
    pub over_send: Option<f64>,
    /// The share of entries that are loose; none when none was tested.
    pub looseness: Option<f64>,
    /// The same for the map's own vis lump.
    pub own_misses: Option<u64>,
    /// Likewise.
    pub own_over_send: Option<f64>,
    /// Likewise.
    pub own_looseness: Option<f64>,
}

impl VerifyReport {
    /// Its principal figures.
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
    /// Another that it sees.
    pub to: Vec3,
    /// The cells or clusters they lie in, if in any.
    pub places: [Option<u32>; 2],
}

/// Verifies a world. `progress` is told what is being done and its share, from 0 to 1, from any
/// thread.
///
/// # Errors
/// When there is no empty space in it, or fuzzy projection was asked for and cannot be.
pub fn verify(
    world: &World,
    options: &VerifyOptions,
    progress: &(dyn Fn(&str, f32) + Sync),
) -> Result<VerifyReport, VerifyError> {
    let original = Original::new(world);
    let ours = Ours::new(&world.cells);
    let lump = world.origin.as_ref().and_then(|origin| Lump::new(origin, &original));
    let own = lump.as_ref().map(|lump| lump as &dyn Subject);
    let cells = subject::populated(&ours, &original, options.seed);
    if cells.is_empty() {
        return Err(VerifyError::Full);
    }
    let survey = pairs::Survey { original: &original, ours: &ours, own, options };
    let by_volume = survey.run(0, &|rng| original.draw(rng), &|share| {
        progress("pairs by volume", share);
    });
    let by_cell =
        survey.run(1, &|rng| Some(subject::draw_any(&ours, &original, &cells, rng)), &|share| {
            progress("pairs by cell", share)
        });
    let fuzzy = options.fuzzy.then(|| Fuzzy::new(world)).transpose()?;
    let told = |share: f32| progress("entries", share);
    let mut entries = entries::looseness(&ours, &original, &cells, options, &told);
    if let Some(fuzzy) = &fuzzy {
        let told = |share: f32| progress("fuzzy projection", share);
        entries.parted = Some(entries.parted(fuzzy, &told));
    }
    let own_entries = own.map(|own| {
        let clusters = subject::populated(own, &original, options.seed);
        entries::looseness(own, &original, &clusters, options, &|share| {
            progress("entries of the map's own", share);
        })
    });
    let sampled = original.sampled();
    let cells_sampled = cells.len();
    Ok(VerifyReport { sampled, by_volume, by_cell, cells_sampled, entries, own_entries })
}

/// A seed for one piece of work, so that no two threads share a generator.
fn seed_of(seed: u64, stage: u64, piece: u64) -> u64 {
    // The generator spreads its seed itself; this only keeps the pieces apart.
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ stage << 56 ^ piece
}

#[cfg(test)]
mod tests;
