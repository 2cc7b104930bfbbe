//! What is verified: a subdivision of space into places, with a PVS.
//!
//! [`Ours`] is all that the verifier knows of cells; [`Lump`] is the vis lump of a map.

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_world::{CellId, Cells, Origin, OriginTree};

use super::{
    boxes::{Boxes, point_in},
    options::seed_of,
    original::{Original, Spot},
};

/// A place is left out when none of this many points in it is empty.
const TRIES_FIRST: usize = 1_000;
/// After this many points that are not empty, the first spot of the place is used again.
const TRIES_MAX: usize = 100;
/// The PVS is unpacked when it takes at most this many words: 256 MiB.
const WORDS_MAX: usize = 1 << 25;

/// A subdivision with its PVS.
pub(super) trait Subject: Sync {
    /// How many places there are: cells or clusters.
    fn places(&self) -> u32;
    /// The place of a spot, if it lies in one.
    fn place(&self, spot: &Spot) -> Option<u32>;
    /// Whether the PVS holds a pair of places.
    fn sees(&self, from: u32, to: u32) -> bool;
    /// A uniform random point of a place. None when the drawn point lies elsewhere.
    fn draw(&self, place: u32, rng: &mut SmallRng) -> Option<Vec3>;
    /// A uniform random entry of the PVS. None when the drawn pair is no entry.
    fn entry(&self, rng: &mut SmallRng) -> Option<[u32; 2]>;
}

/// The cells of the world, and its PVS.
pub(super) struct Ours<'a> {
    cells: &'a Cells,
    /// For each row of the PVS, the number of entries up to its end.
    entries: Vec<u64>,
    /// The PVS as one bit for each pair, row by row: several times as fast as the compressed rows.
    /// Empty when it would be too large.
    bits: Vec<u64>,
    row_words: usize,
}

impl<'a> Ours<'a> {
    pub(super) fn new(cells: &'a Cells) -> Self {
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
    /// The vis lump of a map; none when the map has none.
    pub(super) fn new(origin: &'a Origin, original: &'a Original<'a>) -> Option<Self> {
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

/// A place with empty space in it, and one empty spot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Populated {
    pub place: u32,
    first: Spot,
}

/// The places with empty space in them, in ascending order.
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

/// A random spot of empty space in a place.
pub(super) fn draw_in(
    subject: &dyn Subject,
    original: &Original<'_>,
    within: &Populated,
    rng: &mut SmallRng,
) -> Spot {
    draw_up_to(TRIES_MAX, subject, original, within.place, rng).unwrap_or(within.first)
}

/// A random spot of empty space in a random place. All places are equally likely.
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
