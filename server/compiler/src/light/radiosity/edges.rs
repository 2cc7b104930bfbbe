//! Edges of shadows: more points where direct light differs between neighbours.

use glam::Vec3;
use rayon::prelude::*;

use super::{Surroundings, direct::Direct};
use crate::light::{
    patch::{Patch, Spread},
    varying::FineSquare,
};

/// A square is refined where direct light at its corners differs by more than this in the picture.
const CONTRAST: f32 = 0.06;
/// A square is divided into this many smaller ones each way at least, and at most.
const ACROSS: [f32; 2] = [2.0, 7.0];

/// A square with light inside: its patch, and its lowest point.
pub(super) struct RefinedSquare {
    patch: usize,
    lowest: usize,
    square: FineSquare,
}

/// The squares in which shadows end.
pub(super) fn refine(
    around: &Surroundings<'_>,
    direct_at: &Direct<'_>,
    direct: &[Option<Vec3>],
    indirect: &[Option<Vec3>],
    exposure: f32,
    voxels_between: f32,
) -> Vec<RefinedSquare> {
    let across = voxels_between.round().clamp(ACROSS[0], ACROSS[1]) as usize;
    let mut wanted: Vec<(usize, [usize; 4])> = Vec::new();
    for (index, patch) in around.patches.iter().enumerate() {
        let Spread::Varying(varying) = &patch.spread else { continue };
        if !around.receives(index) {
            continue;
        }
        let first = around.nodes.first[index];
        let has_edge = |corners: &[usize; 4]| {
            let lights = corners.map(|corner| direct[first + corner].unwrap_or_default());
            let low = lights.iter().fold(Vec3::MAX, |low, light| low.min(*light));
            let high = lights.iter().fold(Vec3::MIN, |high, light| high.max(*light));
            (high - low).max_element() * exposure > CONTRAST
        };
        wanted.extend(varying.whole_squares().filter(has_edge).map(|corners| (index, corners)));
    }
    let refined = |(patch, corners): (usize, [usize; 4])| {
        let first = around.nodes.first[patch];
        let of = &around.patches[patch];
        let points = corners.map(|corner| of.point(corner).unwrap_or_default());
        let lights = corners.map(|corner| indirect[first + corner].unwrap_or_default());
        let between = |values: &[Vec3; 4], x: f32, y: f32| {
            values[0].lerp(values[1], x).lerp(values[2].lerp(values[3], x), y)
        };
        let light = (0..(across + 1).pow(2)).map(|i| {
            let [x, y] =
                [i % (across + 1), i / (across + 1)].map(|step| step as f32 / across as f32);
            let direct = direct_at.at(between(&points, x, y), of.normal);
            (direct + between(&lights, x, y)) * exposure
        });
        let square = FineSquare { across, light: light.collect() };
        RefinedSquare { patch, lowest: corners[0], square }
    };
    wanted.into_par_iter().map(refined).collect()
}

/// Adds refined squares to their patches.
pub(super) fn add(patches: &mut [Patch], squares: Vec<RefinedSquare>) {
    for RefinedSquare { patch, lowest, square } in squares {
        if let Spread::Varying(varying) = &mut patches[patch].spread {
            varying.refine(lowest, square);
        }
    }
}
