//! Which leafs of a map lie inside its hull.
//!
//! A map's compiler fills the space outside, which then has no cluster. It may leave pockets that
//! do have one, in the corners of the map's bounds. No player is ever there. Points of two pockets
//! see each other through the filled space, where there is no brush, and no vis lump says so. Rays
//! that pass through filled space tell such pockets.

use std::f32::consts::TAU;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_oracle::Oracle;
use sightline_world::OriginTree;

use super::{boxes::Boxes, brushes::Brushes, locate::Locator, options::seed_of};

/// Rays from each cluster.
const RAYS: u64 = 96;
/// The distance between two tested points of a ray, in metres …
const STEP_M: f32 = 0.25;
/// … and the most points of one ray.
const STEPS_MAX: usize = 800;

/// For each leaf, whether it has a cluster and lies inside the hull.
pub(super) fn inside(
    tree: &OriginTree,
    locator: &Locator<'_>,
    oracle: &Oracle,
    brushes: &Brushes,
) -> Vec<bool> {
    let is_filled = |point: Vec3| {
        let leaf = locator.leaf_at(point);
        tree.leafs[leaf as usize].cluster.is_none() && !brushes.hold(point, 0.0)
    };
    let is_inside = |(cluster, boxes): (usize, &Boxes)| {
        let mut rng = SmallRng::seed_from_u64(seed_of(0, 4, cluster as u64));
        !(0..RAYS).any(|_| {
            let Some((leaf, from)) = boxes.draw(&mut rng) else { return false };
            let direction = direction(&mut rng);
            locator.leaf_at(from) == leaf && passes_filled(oracle, from, direction, &is_filled)
        })
    };
    let boxes = Boxes::of_clusters(tree);
    let clusters: Vec<bool> = boxes.par_iter().enumerate().map(is_inside).collect();
    let is_inside = |cluster: u32| clusters[cluster as usize];
    tree.leafs.iter().map(|leaf| leaf.cluster.is_some_and(is_inside)).collect()
}

/// Whether a ray runs through filled space before it meets a triangle. Two steps in a row must be
/// filled: the space without a cluster around a brush may be a little larger than the brush.
fn passes_filled(
    oracle: &Oracle,
    from: Vec3,
    direction: Vec3,
    is_filled: &dyn Fn(Vec3) -> bool,
) -> bool {
    let length = oracle.distance(from, direction).unwrap_or(f32::INFINITY);
    let steps = ((length / STEP_M) as usize).min(STEPS_MAX);
    let mut was_filled = false;
    (1..=steps).any(|step| {
        let is_filled = is_filled(from + direction * (step as f32 * STEP_M));
        std::mem::replace(&mut was_filled, is_filled) && is_filled
    })
}

/// A uniform random direction.
fn direction(rng: &mut SmallRng) -> Vec3 {
    let (height, turn) = (rng.random_range(-1.0..=1.0f32), rng.random_range(0.0..TAU));
    let wide = (1.0 - height * height).sqrt();
    Vec3::new(wide * turn.cos(), height, wide * turn.sin())
}
