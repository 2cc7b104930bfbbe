//! Light that varies over a patch: the points of a lattice, and what stands between them.

use glam::{Vec2, Vec3};
use rustc_hash::FxHashMap;

use super::{
    lattice::{Directions, Lattice},
    shell::Shell,
};

/// Points whose light differs by less than this need not be told apart.
const ALIKE: f32 = 0.04;
/// A point that moves the mean by less than this need not be looked at.
const SLIGHT: f32 = 0.015;
/// Points that are known weigh at least this much, so that one of them counts.
const WEIGHT_MIN: f32 = 1.0e-3;

/// What lies between a point and its neighbours: nothing to the next one in its row …
pub(super) const CLEAR_ALONG: u8 = 1;
/// … nothing to the one in the next row …
pub(super) const CLEAR_ACROSS: u8 = 2;
/// … and the point itself is not inside something solid.
pub(super) const OPEN: u8 = 4;

/// Light at the points of a lattice.
pub(super) struct Varying {
    directions: Directions,
    lattice: Lattice,
    /// Off the side that is lit.
    normal: Vec3,
    known: LatticePoints,
    light: Vec<Vec3>,
    /// Light inside squares where the points are too few, by the indices of their lowest points.
    fine: FxHashMap<u32, FineSquare>,
}

/// What is known of the points of a lattice, in their order.
pub(super) struct LatticePoints {
    pub(super) points: Vec<Vec3>,
    /// The share of the patch's area that is nearest to each point.
    pub(super) shares: Vec<f32>,
    /// The bits of what is clear around each point.
    pub(super) is_clear: Vec<u8>,
}

/// Light inside a square between four points: at the corners of `across` × `across` smaller
/// squares, row by row.
pub(super) struct FineSquare {
    pub(super) across: usize,
    pub(super) light: Vec<Vec3>,
}

impl FineSquare {
    /// The light at a place, from 0 to 1 each way.
    fn at(&self, part: Vec2) -> Vec3 {
        let at = (part * self.across as f32).clamp(Vec2::ZERO, Vec2::splat(self.across as f32));
        let low = at.as_usizevec2().min(glam::USizeVec2::splat(self.across - 1));
        let part = at - low.as_vec2();
        let get = |x: usize, y: usize| self.light[(low.y + y) * (self.across + 1) + low.x + x];
        let bottom = get(0, 0).lerp(get(1, 0), part.x);
        bottom.lerp(get(0, 1).lerp(get(1, 1), part.x), part.y)
    }
}

impl Varying {
    /// Points on a lattice without light.
    pub(super) fn new(
        directions: Directions,
        lattice: Lattice,
        normal: Vec3,
        known: LatticePoints,
    ) -> Self {
        let count = known.points.len();
        assert_eq!([known.shares.len(), known.is_clear.len()], [count; 2], "values for each point");
        let (light, fine) = (vec![Vec3::ZERO; count], FxHashMap::default());
        Self { directions, lattice, normal, known, light, fine }
    }

    /// All points, also those inside something solid.
    pub(super) fn points(&self) -> &[Vec3] {
        &self.known.points
    }

    /// A point, by its index. None when it lies inside something solid.
    pub(super) fn open_point(&self, index: usize) -> Option<Vec3> {
        (self.known.is_clear[index] & OPEN != 0).then(|| self.known.points[index])
    }

    /// The share of the area that is nearest to a point.
    pub(super) fn share(&self, index: usize) -> f32 {
        self.known.shares[index]
    }

    /// The column and the row of each point, in the order of their indices.
    pub(super) fn places(&self) -> impl Iterator<Item = (i32, i32)> {
        self.lattice.points()
    }

    /// The next point in the row of a point when nothing lies between them.
    pub(super) fn next_along(&self, index: usize, (column, row): (i32, i32)) -> Option<usize> {
        let next = self.lattice.index(column + 1, row);
        (self.known.is_clear[index] & CLEAR_ALONG != 0 && next != index).then_some(next)
    }

    /// The point in the next row when nothing lies between them.
    pub(super) fn next_across(&self, index: usize, (column, row): (i32, i32)) -> Option<usize> {
        let next = self.lattice.index(column, row + 1);
        (self.known.is_clear[index] & CLEAR_ACROSS != 0 && next != index).then_some(next)
    }

    /// The four points of each square with nothing between them, the lowest first.
    pub(super) fn whole_squares(&self) -> impl Iterator<Item = [usize; 4]> {
        self.lattice.points().map(|(column, row)| self.around(column, row)).filter(|around| {
            let all = around[0] != around[1] && around[0] != around[2] && around[1] != around[3];
            all && self.is_whole(around)
        })
    }

    /// Adds light inside a square.
    pub(super) fn refine(&mut self, lowest: usize, square: FineSquare) {
        assert_eq!(square.light.len(), (square.across + 1).pow(2), "light at each corner");
        self.fine.insert(lowest as u32, square);
    }

    /// Sets the light at all points: where it is not known, that of the neighbours, or the mean,
    /// which is not taken to be less than `least`.
    pub(super) fn set_light(&mut self, known: &[Option<Vec3>], least: Vec3) {
        let all = || known.iter().flatten();
        let mean = all().sum::<Vec3>() / all().count().max(1) as f32;
        let fill = |(at, (column, row)): (usize, (i32, i32))| {
            known[at].unwrap_or_else(|| {
                let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)]
                    .map(|(x, y)| known[self.lattice.index(column + x, row + y)]);
                let count = beside.iter().flatten().count() as f32;
                let sum = beside.iter().flatten().sum::<Vec3>();
                if count > 0.0 { sum / count } else { mean.max(least) }
            })
        };
        self.light = self.lattice.points().enumerate().map(fill).collect();
    }

    /// The index of the nearest open point that a place just off the patch sees.
    pub(super) fn nearest(&self, place: Vec3, shell: &Shell) -> Option<usize> {
        let (around, weights) = self.weights(place);
        let mut order = [0, 1, 2, 3];
        order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
        let by_weight = order.map(|i| around[i]);
        if self.is_whole(&around) {
            return Some(by_weight[0]);
        }
        by_weight.into_iter().find(|&at| {
            let is_open = self.known.is_clear[at] & OPEN != 0;
            is_open && shell.is_clear(place, self.known.points[at], self.normal)
        })
    }

    /// The light at a place.
    pub(super) fn at(&self, place: Vec3, shell: &Shell) -> Vec3 {
        let (around, weights) = self.weights(place);
        if !self.is_whole(&around) {
            return self.at_wall(place, around, weights, shell);
        }
        match self.fine.get(&(around[0] as u32)) {
            Some(square) => {
                let place = self.directions.place(place);
                square.at(place - place.floor())
            }
            None => self.mean(around, weights),
        }
    }

    fn around(&self, column: i32, row: i32) -> [usize; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(x, y)| self.lattice.index(column.saturating_add(x), row.saturating_add(y)))
    }

    /// The four points around a place, and how much each counts there.
    fn weights(&self, place: Vec3) -> ([usize; 4], [f32; 4]) {
        let place = self.directions.place(place);
        let low = place.floor();
        let part = place - low;
        let weights = [
            (1.0 - part.x) * (1.0 - part.y),
            part.x * (1.0 - part.y),
            (1.0 - part.x) * part.y,
            part.x * part.y,
        ];
        (self.around(low.x as i32, low.y as i32), weights)
    }

    /// Whether nothing lies between the four points of a square.
    fn is_whole(&self, around: &[usize; 4]) -> bool {
        let has = |i: usize, bits: u8| self.known.is_clear[around[i]] & bits == bits;
        has(0, CLEAR_ALONG | CLEAR_ACROSS) && has(1, CLEAR_ACROSS) && has(2, CLEAR_ALONG)
    }

    /// The light at a place where a wall may stand between the points around it.
    fn at_wall(&self, place: Vec3, around: [usize; 4], weights: [f32; 4], shell: &Shell) -> Vec3 {
        let open = std::array::from_fn(|i| {
            if self.known.is_clear[around[i]] & OPEN != 0 {
                weights[i].max(WEIGHT_MIN)
            } else {
                0.0
            }
        });
        let lights = (0..4).filter(|&i| open[i] > 0.0).map(|i| self.light[around[i]]);
        let ends = lights.fold((Vec3::MAX, Vec3::MIN), |ends, x| (ends.0.min(x), ends.1.max(x)));
        if ends.0.x > ends.1.x {
            return self.mean(around, weights);
        }
        if (ends.1 - ends.0).max_element() < ALIKE {
            return self.mean(around, open);
        }
        let (mean, all) = (self.mean(around, open), open.iter().sum::<f32>());
        let seen = std::array::from_fn(|i| {
            let at = around[i];
            let away = (self.light[at] - mean).abs().max_element();
            let is_slight = open[i] * away < SLIGHT * all;
            let is_seen = || shell.is_clear(place, self.known.points[at], self.normal);
            if open[i] > 0.0 && (is_slight || is_seen()) { open[i] } else { 0.0 }
        });
        let any = seen.iter().any(|weight| *weight > 0.0);
        self.mean(around, if any { seen } else { open })
    }

    fn mean(&self, around: [usize; 4], weights: [f32; 4]) -> Vec3 {
        let sum: f32 = weights.iter().sum();
        around.iter().zip(weights).map(|(&at, weight)| self.light[at] * weight).sum::<Vec3>() / sum
    }
}
