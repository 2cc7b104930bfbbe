//! Verifies a compiled world: its PVS against rays through the original model.
//!
//! Pairs of points in empty space are sampled in two ways. *By volume*, points are uniform in
//! space, as people are. *By cell*, all cells are equally likely, so that small cells are tested
//! too.
//!
//! * A *miss* is a pair in sight that the PVS denies.
//! * The *over-send* is how many pairs the PVS holds for each pair in sight.
//! * An entry of the PVS, a pair of cells, is *loose* when none of many random lines between the
//!   two cells is free.
//!
//! The vis lump of a Quake map is measured on the same points.
//!
//! The original alone decides what is empty and what is in sight (`original`), never the cells. A
//! point may lie in no cell: inside a wall, or where nobody who began at a spawn point can look.
//! Two such points may see each other. When a point in a cell sees one without, that is a miss: the
//! space was not closed off.

mod boxes;
mod brushes;
mod entries;
mod exact;
mod fuzzy;
mod hull;
mod locate;
mod options;
mod original;
mod pairs;
mod report;
mod subject;

use sightline_world::World;

use fuzzy::Fuzzy;
use original::Original;
use pairs::Survey;
use subject::{Lump, Ours, Subject};

pub use options::VerifyOptions;
pub use report::{LooseEntries, Miss, PairCounts, PvsTally, VerifyReport, VerifySummary};

/// Why a world cannot be verified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// Every sampled point lies in something solid.
    #[error("no empty space was found to sample")]
    Full,
    /// The opaque triangles cannot be projected.
    #[error(transparent)]
    Surfaces(#[from] sightline_visibility::fuzzy::SurfaceError),
}

/// Verifies a world. `progress` hears the name of a step and the share of it that is done, from 0
/// to 1, from any thread.
///
/// # Errors
/// When the world has no empty space, and when fuzzy projection is asked for and impossible.
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
    let survey = Survey { original: &original, ours: &ours, own, options };
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
        entries.parted = Some(entries::count_parted(&entries, fuzzy, &told));
    }
    let own_entries = own.map(|own| {
        let clusters = subject::populated(own, &original, options.seed);
        entries::looseness(own, &original, &clusters, options, &|share| {
            progress("entries of the map's own", share);
        })
    });
    for counts in [&by_volume, &by_cell] {
        assert!(counts.sight <= counts.pairs, "pairs in sight are among the pairs");
        assert!(counts.pairs + counts.closed <= options.pairs, "each pair counts once");
    }
    assert!(entries.loose <= entries.entries, "loose entries are among the entries");
    let sampled = original.sampled();
    let cells_sampled = cells.len();
    Ok(VerifyReport { sampled, by_volume, by_cell, cells_sampled, entries, own_entries })
}

#[cfg(test)]
mod tests;
