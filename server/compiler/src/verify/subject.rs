//! What is verified: a division of space into places, and who of them sees whom.
//!
//! All that the verifier knows of cells and their PVS is in [`Ours`].

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_world::{CellId, Cells, Origin, OriginTree};

use super::{
    original::{Boxes, Original, Spot, point_in},
    seed_of,
};

/// A place in which so many points found nothing empty is left out.
const TRIES_FIRST: usize = 1_000;
/// After so many points that were no use, the one that was found first will do.
const TRIES_MAX: usize = 100;
/// The PVS is unpacked when it takes no more words: 256 MiB.
const WORDS_MAX: usize = 1 << 25;

/// A subdivision with its PVS.
pub(super) trait Subject: Sync {
    /// How many places there are: cells or clusters.
    fn places(&self) -> u32;
    /// The place of a spot.
    fn place(&self, spot: &Spot) -> Option<u32>;
    /// Whether the PVS holds a pair of places.
    fn sees(&self, from: u32, to: u32) -> bool;
    /// A random point of a place, all equally likely; none when it was one of somewhere else.
    fn draw(&self, place: u32, rng: &mut SmallRng) -> Option<Vec3>;
    /// A random entry of the PVS, all equally likely; none when it was none.
    fn entry(&self, rng: &mut SmallRng) -> Option<[u32; 2]>;
}

/// The world's cells and its PVS.
pub(super) struct Ours<'a> {
    cells: &'a Cells,
    /// For each row of the PVS, the entries up to its end.
    entries: Vec<u64>,
    /// The PVS as one bit for each pair, row by row: several times as fast as the compressed rows.
    /// Empty when that would be large.
    bits: Vec<u64>,
    row_words: usize,
}

impl<'a> Ours<'a> {
    pub fn new(cells: &'a Cells) -> Self {
        let mut sum = 0;
        let entries = cells.pvs.iter().map(|row| {
            sum += row.len();
            sum
        });
        let entries = entries.collect();
        let row_words = cells.cells.len().div_ceil(64);
        let words = row_words * cells.cells.len();
        let mut bits = vec![0; if words <= WORDS_MAX { words } else { 0 }];
        for (bits, row) in bits.chunks_exact_mut(row_words.max(1)).zip(&cells.pvs) {
            row.iter().for_each(|to| bits[to as usize / 64] |= 1 << (to % 64));
        }
        Self { cells, entries, bits, row_words }
    }

    fn cell_at(&self, point: Vec3) -> Option<u32> {
        self.cells.at(point).map(|cell| cell.0)
    }
}

impl Subject for Ours<'_> {
    fn places(&self) -> u32 {
        self.cells.cells.len() as u32
    }

    fn place(&self, spot: &Spot) -> Option<u32> {
        self.cell_at(spot.point)
    }

    fn sees(&self, from: u32, to: u32) -> bool {
        let word = from as usize * self.row_words + to as usize / 64;
        match self.bits.get(word) {
            Some(word) => word & 1 << (to % 64) != 0,
            None => self.cells.sees(CellId(from), CellId(to)),
        }
    }

    fn draw(&self, place: u32, rng: &mut SmallRng) -> Option<Vec3> {
        let point = point_in(&self.cells.cells[place as usize].bounds, rng);
        let point = self.cells.axes.world(point);
        (self.cell_at(point) == Some(place)).then_some(point)
    }

    fn entry(&self, rng: &mut SmallRng) -> Option<[u32; 2]> {
        let entry = rng.random_range(0..*self.entries.last()?);
        let row = self.entries.partition_point(|&end| end <= entry);
        let before = if row == 0 { 0 } else { self.entries[row - 1] };
        let to = self.cells.pvs[row].select((entry - before) as u32)?;
        Some([row as u32, to])
    }
}

/// A Quake map's clusters and its vis lump.
pub(super) struct Lump<'a> {
    original: &'a Original<'a>,
    tree: &'a OriginTree,
    /// For each cluster, the boxes of its leafs.
    boxes: Vec<Boxes>,
}

impl<'a> Lump<'a> {
    /// None for a map that was never vised.
    pub fn new(origin: &'a Origin, original: &'a Original<'a>) -> Option<Self> {
        let tree = origin.tree.as_ref().filter(|tree| !tree.visible.is_empty())?;
        Some(Self { original, tree, boxes: Boxes::of_clusters(tree) })
    }
}

impl Subject for Lump<'_> {
    fn places(&self) -> u32 {
        self.tree.clusters
    }

    fn place(&self, spot: &Spot) -> Option<u32> {
        spot.cluster
    }

    fn sees(&self, from: u32, to: u32) -> bool {
        self.tree.sees(from, to)
    }

    fn draw(&self, place: u32, rng: &mut SmallRng) -> Option<Vec3> {
        let (leaf, point) = self.boxes[place as usize].draw(rng)?;
        (self.original.leaf_at(point) == Some(leaf)).then_some(point)
    }

    fn entry(&self, rng: &mut SmallRng) -> Option<[u32; 2]> {
        let pair = [(); 2].map(|()| rng.random_range(0..self.tree.clusters));
        self.sees(pair[0], pair[1]).then_some(pair)
    }
}

/// A place with empty space in it, and a spot of that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Populated {
    pub place: u32,
    first: Spot,
}

/// The places with empty space in them, ascending.
pub(super) fn populated(
    subject: &dyn Subject,
    original: &Original<'_>,
    seed: u64,
) -> Vec<Populated> {
    (0..subject.places())
        .into_par_iter()
        .filter_map(|place| {
            let mut rng = SmallRng::seed_from_u64(seed_of(seed, 2, place.into()));
            let first = draw_up_to(TRIES_FIRST, subject, original, place, &mut rng)?;
            Some(Populated { place, first })
        })
        .collect()
}

/// A spot of empty space in a place, all equally likely.
pub(super) fn draw_in(
    subject: &dyn Subject,
    original: &Original<'_>,
    within: &Populated,
    rng: &mut SmallRng,
) -> Spot {
    draw_up_to(TRIES_MAX, subject, original, within.place, rng).unwrap_or(within.first)
}

/// A spot of empty space in some place, each place as likely as another.
pub(super) fn draw_any(
    subject: &dyn Subject,
    original: &Original<'_>,
    places: &[Populated],
    rng: &mut SmallRng,
) -> Spot {
    let within = &places[rng.random_range(0..places.len())];
    draw_in(subject, original, within, rng)
}

fn draw_up_to(
    tries: usize,
    subject: &dyn Subject,
    original: &Original<'_>,
    place: u32,
    rng: &mut SmallRng,
) -> Option<Spot> {
    (0..tries).find_map(|_| original.spot(subject.draw(place, rng)?))
}
