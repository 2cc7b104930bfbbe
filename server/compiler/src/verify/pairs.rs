//! Tests pairs of points: whether they are in sight, and what the PVS says.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rand::{SeedableRng, rngs::SmallRng};
use rayon::prelude::*;

use super::{
    options::{VerifyOptions, seed_of},
    original::{Original, Spot},
    report::{Miss, PairCounts, PvsTally},
    subject::Subject,
};

/// How many pairs one random generator makes.
const PIECE: u64 = 4096;

/// What pairs of points are tested against.
pub(super) struct Survey<'a> {
    pub original: &'a Original<'a>,
    pub ours: &'a dyn Subject,
    pub own: Option<&'a dyn Subject>,
    pub options: &'a VerifyOptions,
}

impl Survey<'_> {
    /// Tests pairs of spots that `draw` makes. `stage` gives this sample random numbers of its own.
    pub(super) fn run(
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
        // The order of the sum is fixed, so that the same misses are shown each time.
        pieces.reduce(nothing, PairCounts::and)
    }

    /// Tests one pair.
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

/// What a subdivision says of a pair of points.
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

    /// A subdivision with one place, to the right of the origin.
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

    /// A world with or without a wall at the origin.
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
            light: None,
            origin: None,
        }
    }

    /// Two points without a cell may see each other, as two points inside a wall do. A point in a
    /// cell may not see one without.
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
