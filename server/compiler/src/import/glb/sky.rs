//! An enclosing sky: a dome or a box around everything. It is drawn and hides nobody.
//!
//! As an occluder it would only split the space around the building, where nobody is.

use std::collections::HashSet;

use glam::Vec3;
use sightline_world::geometry::Aabb;

use crate::model::{Model, Surface};

/// A sky is at least this many times as wide as all else.
const WIDER: f32 = 1.5;
/// A sky is at least this high for its width. Ground is flat.
const HIGH_SHARE: f32 = 0.2;
/// At least this share of a dome's area is neither level nor upright.
const DOMED_SHARE: f32 = 0.5;
/// Triangles this near to a side of a box lie on it, as a share of the box's size.
const ON_SIDE_SHARE: f32 = 1e-3;
/// A side of a box has no opening if triangles cover this share of it.
const CLOSED_SHARE: f32 = 0.99;
/// A normal that rises by this much more or less is neither level nor upright.
const TILTED: std::ops::Range<f32> = 0.02..0.98;

/// Takes the triangles of an enclosing sky from what blocks sight, with a warning.
pub(super) fn leave_out_of_sight(model: &mut Model) {
    let around = |surface: &Surface| Aabb::from_points(surface.corners().flatten());
    let bounds: Vec<Aabb> = model.surfaces.iter().map(around).collect();
    let named: Vec<Aabb> = model
        .nodes
        .iter()
        .filter(|(name, _)| name.to_ascii_lowercase().contains("sky"))
        .map(|(_, bounds)| *bounds)
        .collect();
    let mut sky: HashSet<[[u32; 3]; 3]> = HashSet::new();
    let rests = bounds_of_others(&bounds);
    for (index, (surface, rest)) in model.surfaces.iter().zip(rests).enumerate() {
        let is_named = named.contains(&bounds[index]);
        let is_sky = || is_named || is_domed(surface) || is_closed_box(surface, &bounds[index]);
        if encloses(&bounds[index], &rest) && is_sky() {
            sky.extend(surface.corners().map(|corners| key(&corners)));
        }
    }
    let before = model.opaque.len();
    model.opaque.retain(|corners| !sky.contains(&key(corners)));
    let left_out = before - model.opaque.len();
    if left_out > 0 {
        model.warnings.push(format!(
            "{left_out} triangles enclose everything: they count as sky and hide nobody"
        ));
    }
}

/// For each box, the box around all others.
fn bounds_of_others(all: &[Aabb]) -> Vec<Aabb> {
    let mut rests = Vec::with_capacity(all.len());
    let mut before = Aabb::EMPTY;
    for bounds in all {
        rests.push(before);
        before = before.union(bounds);
    }
    let mut after = Aabb::EMPTY;
    for (rest, bounds) in rests.iter_mut().zip(all).rev() {
        *rest = rest.union(&after);
        after = after.union(bounds);
    }
    rests
}

/// Whether one box is far around another.
fn encloses(sky: &Aabb, rest: &Aabb) -> bool {
    if rest.is_empty() {
        return false;
    }
    let (wide, size) = (sky.size(), rest.size());
    let is_around = sky.min.x < rest.min.x
        && sky.min.z < rest.min.z
        && sky.max.cmpgt(rest.max).all()
        && wide.x > WIDER * size.x
        && wide.z > WIDER * size.z;
    is_around && wide.y > HIGH_SHARE * wide.x.max(wide.z)
}

/// Whether most of a surface is neither level nor upright.
fn is_domed(surface: &Surface) -> bool {
    let (mut tilted, mut all) = (0.0, 0.0);
    for [a, b, c] in surface.corners() {
        let normal = (b - a).cross(c - a);
        let area = normal.length();
        all += area;
        if TILTED.contains(&(normal.y.abs() / area.max(f32::MIN_POSITIVE))) {
            tilted += area;
        }
    }
    tilted > DOMED_SHARE * all
}

/// Whether a surface is a box without openings, but perhaps without a bottom. A building is none:
/// it has doors.
fn is_closed_box(surface: &Surface, bounds: &Aabb) -> bool {
    let size = bounds.size();
    let mut covered = [[0.0; 2]; 3];
    for corners in surface.corners() {
        let side = (0..3).find_map(|axis| {
            let is_on = |end: f32| {
                corners.iter().all(|at| (at[axis] - end).abs() <= ON_SIDE_SHARE * size[axis])
            };
            let end = [bounds.min, bounds.max].iter().position(|end| is_on(end[axis]))?;
            Some((axis, end))
        });
        let Some((axis, end)) = side else { return false };
        let [a, b, c] = corners;
        covered[axis][end] += 0.5 * (b - a).cross(c - a).length();
    }
    (0..3).all(|axis| {
        let whole = size[(axis + 1) % 3] * size[(axis + 2) % 3];
        let is_closed = |end: usize| covered[axis][end] >= CLOSED_SHARE * whole;
        is_closed(1) && (axis == 1 || is_closed(0))
    })
}

fn key(corners: &[Vec3; 3]) -> [[u32; 3]; 3] {
    corners.map(|corner| corner.to_array().map(f32::to_bits))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_of_others_are_those_of_all_but_one() {
        let boxes: Vec<Aabb> = (0..6)
            .map(|i| {
                let low = Vec3::new((i * 5 % 6) as f32, (i * i % 7) as f32, -(i as f32));
                Aabb::new(low, low + Vec3::splat(1.0 + i as f32))
            })
            .collect();
        for count in 0..boxes.len() {
            let boxes = &boxes[..count];
            let naive = (0..count).map(|one| {
                let others = boxes.iter().enumerate().filter(|(other, _)| *other != one);
                others.fold(Aabb::EMPTY, |all, (_, bounds)| all.union(bounds))
            });
            assert_eq!(bounds_of_others(boxes), naive.collect::<Vec<_>>());
        }
    }
}
