//! The last step: light that arrives at each point from all nodes and from the sky.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::tolerance::RAY_LIFT_M;

use super::{Surroundings, sampling::cosine_direction};
use crate::light::{patch::Spread, varying::Varying};

/// Neighbouring points use this many different patterns of rays each way. The mean over as many
/// neighbours has all of them.
const PATTERNS: i32 = 3;

/// The light at all points, by this many rays from each. None inside something solid. The whole is
/// None when `go_on` says so.
pub(super) fn gather(
    around: &Surroundings<'_>,
    radiosity: &[Vec3],
    rays: usize,
    go_on: &(dyn Fn(usize) -> bool + Sync),
) -> Option<Vec<Option<Vec3>>> {
    let turns = turns(around);
    let at = |point: usize| {
        let patch = around.nodes.patch_of[point] as usize;
        if !go_on(1) {
            return None;
        }
        let light = around
            .receives(patch)
            .then(|| around.nodes.point(around.patches, point))
            .flatten()
            .map(|at| arriving(around, radiosity, at, patch, rays, turns[point]));
        Some(light)
    };
    let mut light = (0..around.nodes.patch_of.len())
        .into_par_iter()
        .map(at)
        .collect::<Option<Vec<Option<Vec3>>>>()?;
    for (index, patch) in around.patches.iter().enumerate() {
        if let Spread::Varying(varying) = &patch.spread {
            let points = around.nodes.first[index]..around.nodes.first[index + 1];
            smooth(varying, &mut light[points]);
        }
    }
    Some(light)
}

/// How the rays of each point are turned, from 0 to 1.
fn turns(around: &Surroundings<'_>) -> Vec<f32> {
    let mut turns = Vec::with_capacity(around.nodes.patch_of.len());
    for patch in around.patches {
        match &patch.spread {
            Spread::Even { .. } => turns.push(0.0),
            Spread::Varying(varying) => turns.extend(varying.places().map(|(column, row)| {
                let pattern = column.rem_euclid(PATTERNS) + PATTERNS * row.rem_euclid(PATTERNS);
                pattern as f32 / (PATTERNS * PATTERNS) as f32
            })),
        }
    }
    turns
}

/// The light that arrives at a point of a patch.
fn arriving(
    around: &Surroundings<'_>,
    radiosity: &[Vec3],
    at: Vec3,
    patch: usize,
    rays: usize,
    turn: f32,
) -> Vec3 {
    let normal = around.patches[patch].normal;
    let from = at + normal * RAY_LIFT_M;
    let (u, v) = normal.any_orthonormal_pair();
    let ray = |ray: usize| {
        let direction = cosine_direction(ray, rays, turn);
        let along = u * direction.x + v * direction.y + normal * direction.z;
        let end = around.scene.trace(from, along);
        let light = match &end.met {
            None => around.emitters.sky(along) * std::f32::consts::PI,
            Some(met) => around.node_at(met).map_or(Vec3::ZERO, |node| radiosity[node]),
        };
        light * end.tint
    };
    (0..rays).map(ray).sum::<Vec3>() / rays as f32
}

/// Takes the mean of each point and its two neighbours in its row, and then across rows. A point
/// without a neighbour on one side stays as it is: light there falls towards an edge.
fn smooth(varying: &Varying, light: &mut [Option<Vec3>]) {
    let places: Vec<(i32, i32)> = varying.places().collect();
    type Next = fn(&Varying, usize, (i32, i32)) -> Option<usize>;
    for next in [Varying::next_along as Next, Varying::next_across as Next] {
        let ahead: Vec<Option<usize>> =
            places.iter().enumerate().map(|(at, place)| next(varying, at, *place)).collect();
        let mut behind = vec![None; places.len()];
        for (at, next) in ahead.iter().enumerate() {
            if let Some(next) = next {
                behind[*next] = Some(at);
            }
        }
        let known = light.to_vec();
        for (at, of) in light.iter_mut().enumerate() {
            let get = |beside: Option<usize>| beside.and_then(|beside| known[beside]);
            if let (Some(before), Some(here), Some(after)) =
                (get(behind[at]), known[at], get(ahead[at]))
            {
                *of = Some((before + here + after) / 3.0);
            }
        }
    }
}
