//! Pairs of points: who is in sight, and what the PVS says.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rand::{SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    Miss, VerifyOptions,
    original::{Original, Spot},
    seed_of,
    subject::Subject,
};

/// Pairs that one generator makes, one after the other.
const PIECE: u64 = 4096;
/// So many misses are kept to be shown.
const MISSES_SHOWN: usize = 5;

/// What was found of some pairs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PairCounts {
    /// How many.
    pub pairs: u64,
    /// Further pairs that do not count, since a point of them is in no cell and they are not in sight.
    pub closed: u64,
    /// Pairs in sight.
    pub sight: u64,
    /// Pairs that rays took to be in sight and a PVS denied, but that are blocked without rounding.
    pub grazing: u64,
    /// Of the world's PVS.
    pub ours: PvsTally,
    /// Of the map's own vis lump.
    pub own: Option<PvsTally>,
}

/// How a PVS did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PvsTally {
    /// Pairs that it holds.
    pub pvs: u64,
    /// Pairs in sight that it denies.
    pub misses: u64,
    /// The first of them.
    pub first_misses: Vec<Miss>,
}

impl PairCounts {
    /// P(PVS) / P(sight); none when nothing was in sight.
    pub fn over_send(&self, tally: &PvsTally) -> Option<f64> {
        (self.sight > 0).then(|| tally.pvs as f64 / self.sight as f64)
    }

    /// Sums; of `later` only those misses are kept that there is room for.
    fn and(mut self, later: Self) -> Self {
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
    fn and(mut self, later: Self) -> Self {
        self.pvs += later.pvs;
        self.misses += later.misses;
        self.first_misses.extend(later.first_misses);
        self.first_misses.truncate(MISSES_SHOWN);
        self
    }

    fn miss(&mut self, miss: Miss) {
        self.misses += 1;
        if self.first_misses.len() < MISSES_SHOWN {
            self.first_misses.push(miss);
        }
    }
}

/// What pairs are tried against.
pub(super) struct Survey<'a> {
    pub original: &'a Original<'a>,
    pub ours: &'a dyn Subject,
    pub own: Option<&'a dyn Subject>,
    pub options: &'a VerifyOptions,
}

impl Survey<'_> {
    /// Tries pairs of spots that `draw` makes. `stage` keeps its random numbers apart from others.
    pub fn run(
        &self,
        stage: u64,
        draw: &(dyn Fn(&mut SmallRng) -> Option<Spot> + Sync),
        progress: &(dyn Fn(f32) + Sync),
    ) -> PairCounts {
        let VerifyOptions { pairs, seed, .. } = *self.options;
        let done = AtomicU64::new(0);
        let nothing =
            || PairCounts { own: self.own.map(|_| PvsTally::default()), ..PairCounts::default() };
        let pieces = (0..pairs.div_ceil(PIECE)).into_par_iter().map(|piece| {
            let mut rng = SmallRng::seed_from_u64(seed_of(seed, stage, piece));
            let mut found = nothing();
            for _ in 0..PIECE.min(pairs - piece * PIECE) {
                if let Some((from, to)) = draw(&mut rng).zip(draw(&mut rng)) {
                    self.pair(&from, &to, &mut found);
                }
            }
            let done = done.fetch_add(1, Relaxed) + 1;
            progress((done * PIECE) as f32 / pairs as f32);
            found
        });
        // Sums in the order of the pieces, so that the same misses are shown each time.
        pieces.reduce(nothing, PairCounts::and)
    }

    fn pair(&self, from: &Spot, to: &Spot, found: &mut PairCounts) {
        let ours = Verdict::of(self.ours, from, to);
        let outside = ours.places.iter().filter(|place| place.is_none()).count();
        if outside == 2 {
            found.closed += 1;
            return;
        }
        let own = self.own.map(|own| Verdict::of(own, from, to));
        let (from, to) = (from.point, to.point);
        let mut sight = self.original.in_sight(from, to);
        let is_denied = !ours.sees || own.is_some_and(|own| !own.sees);
        if sight && is_denied && !self.original.confirms(from, to) {
            found.grazing += 1;
            sight = false;
        }
        if outside == 1 && !sight {
            found.closed += 1;
            return;
        }
        found.pairs += 1;
        found.sight += u64::from(sight);
        let note = |tally: &mut PvsTally, verdict: Verdict| {
            tally.pvs += u64::from(verdict.sees);
            if sight && !verdict.sees {
                tally.miss(Miss { from, to, places: verdict.places });
            }
        };
        note(&mut found.ours, ours);
        if let Some((tally, verdict)) = found.own.as_mut().zip(own) {
            note(tally, verdict);
        }
    }
}

/// What a subdivision says of two points.
#[derive(Clone, Copy)]
struct Verdict {
    places: [Option<u32>; 2],
    sees: bool,
}

impl Verdict {
    fn of(subject: &dyn Subject, from: &Spot, to: &Spot) -> Self {
        let places = [from, to].map(|spot| subject.place(spot));
        let sees = matches!(places, [Some(from), Some(to)] if subject.sees(from, to));
        Self { places, sees }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_world::{Cells, Mesh, World, geometry::Aabb, motion::Body, octree::Octree};

    use super::*;

    /// One place to the right of the origin, and none to the left.
    struct Right;

    impl Subject for Right {
        fn places(&self) -> u32 {
            1
        }

        fn place(&self, spot: &Spot) -> Option<u32> {
            (spot.point.x > 0.0).then_some(0)
        }

        fn sees(&self, _: u32, _: u32) -> bool {
            true
        }

        fn draw(&self, _: u32, _: &mut SmallRng) -> Option<Vec3> {
            None
        }

        fn entry(&self, _: &mut SmallRng) -> Option<[u32; 2]> {
            None
        }
    }

    /// A world with a wall at the origin, or without.
    fn world(has_wall: bool) -> World {
        let bounds = Aabb::around(Vec3::ZERO, 4.0);
        let corners = [(-9.0, -9.0), (9.0, -9.0), (0.0, 20.0)];
        let triangles = if has_wall { vec![[0, 1, 2]] } else { Vec::new() };
        World {
            title: String::new(),
            octree: Octree::empty(Vec3::ZERO, 1.0, 1),
            cells: Cells::whole(bounds),
            mesh: Mesh { positions: corners.map(|(y, z)| Vec3::new(0.0, y, z)).into(), triangles },
            spawns: Vec::new(),
            body: Body::PERSON,
            speed_max: 1.0,
            movers: Vec::new(),
            rooms: Default::default(),
            origin: None,
        }
    }

    /// What is in no cell may see its like, as the inside of a wall does, but nobody may see it.
    #[test]
    fn points_without_a_cell_do_not_count_unless_they_are_seen() {
        let check = |has_wall: bool, misses: bool| {
            let world = world(has_wall);
            let original = Original::new(&world);
            let options = VerifyOptions { seed: 1, ..VerifyOptions::new(1_000) };
            let survey = Survey { original: &original, ours: &Right, own: None, options: &options };
            let found = survey.run(0, &|rng| original.draw(rng), &|_| ());
            assert_eq!(found.pairs + found.closed, 1_000);
            assert_eq!(found.ours.misses > 0, misses, "{found:?}");
            assert_eq!(found.pairs - found.ours.misses, found.ours.pvs, "{found:?}");
            assert!(found.closed > 100, "{found:?}");
        };
        check(true, false);
        check(false, true);
    }
}
