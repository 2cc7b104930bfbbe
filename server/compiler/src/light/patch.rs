//! The light of one patch.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    lattice::{Directions, Lattice, Piece},
    patches::normal,
    shell::{Fan, Shell},
    varying::{CLEAR_ACROSS, CLEAR_ALONG, LatticePoints, OPEN, Varying},
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
/// A patch with light on one of its sides.
pub(super) struct Patch {
    /// Off the side that is lit, of unit length.
    pub(super) normal: Vec3,
    /// The area of its triangles, in square metres.
    pub(super) area: f32,
    pub(super) spread: Spread,
}

/// How light lies on a patch.
pub(super) enum Spread {
    /// The same everywhere. The point inside is None when it lies inside something solid.
    Even { point: Option<Vec3>, light: Vec3 },
    /// Light at the points of a lattice.
    Varying(Box<Varying>),
}

/// A patch without light.
pub(super) struct Part {
    /// Its triangles, by their numbers in the surface.
    pub(super) triangles: Vec<u32>,
    normal: Vec3,
    area: f32,
    shape: Shape,
}

enum Shape {
    /// A small patch, by a point inside.
    Small(Vec3),
    Large {
        directions: Directions,
        lattice: Lattice,
        points: Vec<Option<Vec3>>,
        /// The share of the area that is nearest to each point.
        shares: Vec<f32>,
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
    let area = |piece: &Piece| {
        let [a, b, c] = piece.corners;
        (b - a).cross(c - a).length() / 2.0
    };
    let shape = if size.max_element() < SMALL {
        let largest = pieces.iter().max_by(|a, b| area(a).total_cmp(&area(b)))?;
        Shape::Small(largest.corners.iter().sum::<Vec3>() / 3.0)
    } else {
        let lattice = Lattice::around(&pieces)?;
        let (points, shares) = (lattice.places(&pieces), lattice.shares(&pieces));
        Shape::Large { directions, lattice, points, shares }
    };
    let area = pieces.iter().map(area).sum();
    Some(Part { triangles: group.to_vec(), normal, area, shape })
}

impl Part {
    /// The patch with light, as factors on sRGB colours.
    pub(super) fn lit(self, shell: &Shell) -> Patch {
        let Self { shape, normal, area, .. } = self;
        match shape {
            Shape::Small(at) => {
                let (fan, open) = best_side(shell, normal, &[Some(at)]);
                let light = open[0].map_or(DARKEST.sqrt(), |open| factor(open, &fan));
                let point = open[0].map(|_| at);
                let spread = Spread::Even { point, light: Vec3::splat(light) };
                Patch { normal: fan.normal(), area, spread }
            }
            Shape::Large { directions, lattice, points, shares } => {
                let (fan, open) = best_side(shell, normal, &points);
                let normal = fan.normal();
                let is_clear = clear(shell, &lattice, normal, &points, &open);
                let known: Vec<_> = open
                    .iter()
                    .map(|open| open.map(|open| Vec3::splat(factor(open, &fan))))
                    .collect();
                let points = points.into_iter().map(Option::unwrap_or_default).collect();
                let known_points = LatticePoints { points, shares, is_clear };
                let mut varying = Varying::new(directions, lattice, normal, known_points);
                varying.set_light(&known, Vec3::splat(DARKEST.sqrt()));
                Patch { normal, area, spread: Spread::Varying(Box::new(varying)) }
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

impl Patch {
    /// The light at a point of the patch.
    pub(super) fn at(&self, point: Vec3, shell: &Shell) -> Vec3 {
        match &self.spread {
            Spread::Even { light, .. } => *light,
            Spread::Varying(varying) => varying.at(point, shell),
        }
    }

    /// The number of points at which light is known.
    pub(super) fn len(&self) -> usize {
        match &self.spread {
            Spread::Even { .. } => 1,
            Spread::Varying(varying) => varying.points().len(),
        }
    }

    /// A point, by its index. None when it lies inside something solid.
    pub(super) fn point(&self, index: usize) -> Option<Vec3> {
        match &self.spread {
            Spread::Even { point, .. } => *point,
            Spread::Varying(varying) => varying.open_point(index),
        }
    }

    /// The share of the area that is nearest to a point.
    pub(super) fn share(&self, index: usize) -> f32 {
        match &self.spread {
            Spread::Even { .. } => 1.0,
            Spread::Varying(varying) => varying.share(index),
        }
    }

    /// The index of the nearest point that a place just off the patch sees.
    pub(super) fn nearest(&self, place: Vec3, shell: &Shell) -> Option<usize> {
        match &self.spread {
            Spread::Even { .. } => Some(0),
            Spread::Varying(varying) => varying.nearest(place, shell),
        }
    }

    /// Sets the light at all points. Where it is not known, that of the neighbours counts.
    pub(super) fn set_light(&mut self, known: &[Option<Vec3>]) {
        match &mut self.spread {
            Spread::Even { light, .. } => *light = known[0].unwrap_or(Vec3::ZERO),
            Spread::Varying(varying) => varying.set_light(known, Vec3::ZERO),
        }
    }
}
