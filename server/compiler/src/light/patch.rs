//! The light of one patch.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    lattice::{Directions, Lattice, Piece},
    patches::normal,
    shell::{Fan, Shell},
};
use crate::model::Surface;

/// The least light of a place, from 0 to 1, so that walls stay visible.
const DARKEST: f32 = 0.3;
/// A patch shows its front, unless less than this share of light reaches it and more reaches its
/// back: such a patch is inside something solid, or lies on something. One rule for the whole patch
/// keeps light even: the back of a wall may be outdoors.
const COVERED: f32 = 0.25;
/// A patch that is smaller than this share of the spacing has the same light everywhere.
const SMALL: f32 = 0.5;
/// Points whose light differs by less than this need not be told apart.
const ALIKE: f32 = 0.04;
/// A point that moves the mean by less than this need not be looked at.
const SLIGHT: f32 = 0.015;
/// Points that are known weigh at least this much, so that one of them counts.
const WEIGHT_MIN: f32 = 1.0e-3;

/// What lies between a point and its neighbours: nothing to the next one in its row …
const CLEAR_ALONG: u8 = 1;
/// … nothing to the one in the next row …
const CLEAR_ACROSS: u8 = 2;
/// … and the point itself is not inside something solid.
const OPEN: u8 = 4;

/// Light on a patch, as factors on sRGB colours.
pub(super) enum Patch {
    /// The same everywhere.
    Even(f32),
    /// Light at the points of a lattice.
    Varying(Box<Varying>),
}

/// See [`Patch::Varying`].
pub(super) struct Varying {
    directions: Directions,
    lattice: Lattice,
    /// Off the side that is lit.
    normal: Vec3,
    points: Vec<Vec3>,
    light: Vec<f32>,
    is_clear: Vec<u8>,
}

/// A patch without light.
pub(super) struct Part {
    /// Its triangles, by their numbers in the surface.
    pub(super) triangles: Vec<u32>,
    normal: Vec3,
    shape: Shape,
}

enum Shape {
    /// A small patch, by a point inside.
    Small(Vec3),
    Large {
        directions: Directions,
        lattice: Lattice,
        points: Vec<Option<Vec3>>,
    },
}

/// The parts of a group of triangles in one plane: all in one, or each on its own when they lie far
/// apart.
pub(super) fn parts(surface: &Surface, group: &[u32], along: Vec3, spacing: f32) -> Vec<Part> {
    if let Some(part) = part(surface, group, along, spacing) {
        return vec![part];
    }
    group.chunks(1).filter_map(|alone| part(surface, alone, along, spacing)).collect()
}

fn part(surface: &Surface, group: &[u32], along: Vec3, spacing: f32) -> Option<Part> {
    let corners_of = |&triangle: &u32| surface.corners_of(triangle as usize);
    let normal = normal(group.first().and_then(corners_of)?)?;
    let directions = Directions::new(normal, along, spacing);
    let pieces: Vec<Piece> = group
        .iter()
        .filter_map(corners_of)
        .map(|corners| Piece { corners, places: corners.map(|corner| directions.place(corner)) })
        .collect();
    let places = || pieces.iter().flat_map(|piece| piece.places);
    let size = places().reduce(|a, b| a.max(b))? - places().reduce(|a, b| a.min(b))?;
    let shape = if size.max_element() < SMALL {
        let area = |piece: &Piece| {
            let [a, b, c] = piece.corners;
            (b - a).cross(c - a).length()
        };
        let largest = pieces.iter().max_by(|a, b| area(a).total_cmp(&area(b)))?;
        Shape::Small(largest.corners.iter().sum::<Vec3>() / 3.0)
    } else {
        let lattice = Lattice::around(&pieces)?;
        let points = lattice.places(&pieces);
        Shape::Large { directions, lattice, points }
    };
    Some(Part { triangles: group.to_vec(), normal, shape })
}

impl Part {
    /// The patch with light.
    pub(super) fn lit(self, shell: &Shell) -> Patch {
        let Self { shape, normal, .. } = self;
        match shape {
            Shape::Small(at) => {
                let (fan, open) = best_side(shell, normal, &[Some(at)]);
                Patch::Even(open[0].map_or(DARKEST.sqrt(), |open| factor(open, &fan)))
            }
            Shape::Large { directions, lattice, points } => {
                let (fan, open) = best_side(shell, normal, &points);
                let normal = fan.normal();
                let is_clear = clear(shell, &lattice, normal, &points, &open);
                let known: Vec<_> =
                    open.iter().map(|open| open.map(|open| factor(open, &fan))).collect();
                let light = filled(&lattice, &known);
                let points = points.into_iter().map(Option::unwrap_or_default).collect();
                Patch::Varying(Box::new(Varying {
                    directions,
                    lattice,
                    normal,
                    points,
                    light,
                    is_clear,
                }))
            }
        }
    }
}

/// The side of a patch that is lit, and which share of light reaches each point on it.
fn best_side(shell: &Shell, normal: Vec3, points: &[Option<Vec3>]) -> (Fan, Vec<Option<f32>>) {
    let side = |normal: Vec3| {
        let fan = shell.fan(normal);
        let open: Vec<Option<f32>> = points
            .par_iter()
            .with_min_len(16)
            .map(|point| point.and_then(|point| shell.openness(point, &fan)))
            .collect();
        (fan, open)
    };
    let sum = |open: &[Option<f32>]| open.iter().flatten().sum::<f32>();
    let front = side(normal);
    let count = points.iter().flatten().count() as f32;
    if sum(&front.1) >= COVERED * count {
        return front;
    }
    let back = side(-normal);
    if sum(&back.1) > sum(&front.1) { back } else { front }
}

/// The factor on sRGB colours where this share of light arrives. The square root of light is about
/// right in sRGB.
fn factor(open: f32, fan: &Fan) -> f32 {
    (open * fan.lamp()).clamp(DARKEST, 1.0).sqrt()
}

/// Finds what lies between neighbouring points.
fn clear(
    shell: &Shell,
    lattice: &Lattice,
    normal: Vec3,
    points: &[Option<Vec3>],
    open: &[Option<f32>],
) -> Vec<u8> {
    let known = |at: usize| open[at].and(points[at]);
    let is_clear =
        |from: Vec3, at: usize| known(at).is_some_and(|to| shell.is_clear(from, to, normal));
    let find = |(column, row): (i32, i32)| {
        let Some(point) = known(lattice.index(column, row)) else { return 0 };
        let along = is_clear(point, lattice.index(column + 1, row));
        let across = is_clear(point, lattice.index(column, row + 1));
        let bits = |is_clear: bool, bits: u8| if is_clear { bits } else { 0 };
        OPEN | bits(along, CLEAR_ALONG) | bits(across, CLEAR_ACROSS)
    };
    lattice.points().map(find).collect()
}

/// Light at all points: where it is not known, that of the neighbours.
fn filled(lattice: &Lattice, known: &[Option<f32>]) -> Vec<f32> {
    let all: Vec<f32> = known.iter().flatten().copied().collect();
    let mean = all.iter().sum::<f32>() / all.len().max(1) as f32;
    let fill = |(at, (column, row)): (usize, (i32, i32))| {
        known[at].unwrap_or_else(|| {
            let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)]
                .map(|(x, y)| known[lattice.index(column + x, row + y)]);
            let count = beside.iter().flatten().count() as f32;
            let sum = beside.iter().flatten().sum::<f32>();
            if count > 0.0 { sum / count } else { mean.max(DARKEST.sqrt()) }
        })
    };
    lattice.points().enumerate().map(fill).collect()
}

impl Patch {
    /// The factor at a point of the patch.
    pub(super) fn at(&self, point: Vec3, shell: &Shell) -> f32 {
        match self {
            Self::Even(light) => *light,
            Self::Varying(varying) => varying.at(point, shell),
        }
    }
}

impl Varying {
    fn at(&self, point: Vec3, shell: &Shell) -> f32 {
        let place = self.directions.place(point);
        let low = place.floor();
        let (column, row) = (low.x as i32, low.y as i32);
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(x, y)| self.lattice.index(column.saturating_add(x), row.saturating_add(y)));
        let part = place - low;
        let weights = [
            (1.0 - part.x) * (1.0 - part.y),
            part.x * (1.0 - part.y),
            (1.0 - part.x) * part.y,
            part.x * part.y,
        ];
        let has = |i: usize, bits: u8| self.is_clear[around[i]] & bits == bits;
        let is_whole =
            has(0, CLEAR_ALONG | CLEAR_ACROSS) && has(1, CLEAR_ACROSS) && has(2, CLEAR_ALONG);
        if is_whole {
            return self.mean(around, weights);
        }
        self.at_wall(point, around, weights, shell)
    }

    /// The factor at a point where a wall may stand between the points around it.
    fn at_wall(&self, point: Vec3, around: [usize; 4], weights: [f32; 4], shell: &Shell) -> f32 {
        let open = std::array::from_fn(|i| {
            if self.is_clear[around[i]] & OPEN != 0 { weights[i].max(WEIGHT_MIN) } else { 0.0 }
        });
        let lights = (0..4).filter(|&i| open[i] > 0.0).map(|i| self.light[around[i]]);
        let ends = lights.fold((f32::MAX, f32::MIN), |ends, x| (ends.0.min(x), ends.1.max(x)));
        if ends.0 > ends.1 {
            return self.mean(around, weights);
        }
        if ends.1 - ends.0 < ALIKE {
            return self.mean(around, open);
        }
        let (mean, all) = (self.mean(around, open), open.iter().sum::<f32>());
        let seen = std::array::from_fn(|i| {
            let at = around[i];
            let is_slight = open[i] * (self.light[at] - mean).abs() < SLIGHT * all;
            let is_seen = || shell.is_clear(point, self.points[at], self.normal);
            if open[i] > 0.0 && (is_slight || is_seen()) { open[i] } else { 0.0 }
        });
        let any = seen.iter().any(|weight| *weight > 0.0);
        self.mean(around, if any { seen } else { open })
    }

    fn mean(&self, around: [usize; 4], weights: [f32; 4]) -> f32 {
        let sum: f32 = weights.iter().sum();
        around.iter().zip(weights).map(|(&at, weight)| self.light[at] * weight).sum::<f32>() / sum
    }
}
