//! Which of a map's leafs are inside its hull.
//!
//! Space outside has no cluster, once the map's compiler has filled it; but it may leave pockets
//! that have one, in the corners of the map's bounds. No player is ever there, and they see each
//! other through the filled space, in which there is no brush, as no vis lump says. They are told
//! by rays that pass through such space.

use std::f32::consts::TAU;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use rayon::prelude::*;
use sightline_world::OriginTree;

use super::{brushes::Brushes, locate::Locator, original::Boxes, seed_of};
use sightline_oracle::Oracle;

/// Rays from each cluster.
const RAYS: u64 = 96;
/// A ray is looked at so often, in metres …
const STEP_M: f32 = 0.25;
/// … and no farther than this, in steps.
const STEPS_MAX: usize = 800;

/// For each leaf, whether it has a cluster, and is inside.
pub(super) fn inside(
    tree: &OriginTree,
    locator: &Locator<'_>,
    sight: &Oracle,
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
            locator.leaf_at(from) == leaf && passes_filled(sight, from, direction, &is_filled)
        })
    };
    let boxes = Boxes::of_clusters(tree);
    let clusters: Vec<bool> = boxes.par_iter().enumerate().map(is_inside).collect();
    let is_inside = |cluster: u32| clusters[cluster as usize];
    tree.leafs.iter().map(|leaf| leaf.cluster.is_some_and(is_inside)).collect()
}

/// Whether a ray runs through filled space before it meets a triangle: for two steps, since the
/// space without a cluster about a brush may be a little larger than the brush.
fn passes_filled(
    sight: &Oracle,
    from: Vec3,
    direction: Vec3,
    is_filled: &dyn Fn(Vec3) -> bool,
) -> bool {
    let length = sight.distance(from, direction).unwrap_or(f32::INFINITY);
    let steps = ((length / STEP_M) as usize).min(STEPS_MAX);
    let mut was_filled = false;
    (1..=steps).any(|step| {
        let is_filled = is_filled(from + direction * (step as f32 * STEP_M));
        std::mem::replace(&mut was_filled, is_filled) && is_filled
    })
}

/// A direction, all equally likely.
fn direction(rng: &mut SmallRng) -> Vec3 {
    let (height, turn) = (rng.random_range(-1.0..=1.0f32), rng.random_range(0.0..TAU));
    let wide = (1.0 - height * height).sqrt();
    Vec3::new(wide * turn.cos(), height, wide * turn.sin())
}
