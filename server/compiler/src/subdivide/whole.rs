//! Which spaces stay whole: splitting one is of use only where it separates what its parts see.
//!
//! A few points of a space look at points of the other spaces that it may see, through the gates.
//! Where all see all of them, as in a hall of one space, every part of the space sees the same. The
//! points are the same each time, and nothing depends on threads.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{gate_rays::GateRays, region::Region, spaces::Spaces};

/// The points of other spaces that a space looks at.
const TARGETS: usize = 64;
/// The points that look, along each axis of a space.
const EYES_ALONG: usize = 3;

/// For each space, whether all of it sees all of the spaces that it may see, as far as samples
/// tell. `seen` has the spaces that each space may see.
pub(crate) fn see_all(spaces: &Spaces, seen: &[Vec<u32>]) -> Vec<bool> {
    let kept = spaces.tree.leaves.iter().zip(&spaces.kept).filter(|(_, kept)| **kept);
    let regions: Vec<Region> = kept.map(|(region, _)| region.clone().tightened()).collect();
    assert_eq!(regions.len(), seen.len(), "a row for each space");
    let rays = GateRays::new(spaces);
    let sees_all = |space: usize| {
        let targets = targets(&regions, &seen[space], space);
        let eyes = eyes(&regions[space]);
        targets.iter().all(|&target| eyes.iter().all(|&eye| rays.between(eye, target)))
    };
    (0..regions.len()).into_par_iter().map(sees_all).collect()
}

/// Points of the other spaces that a space may see, more of them in larger ones.
fn targets(regions: &[Region], seen: &[u32], space: usize) -> Vec<DVec3> {
    let others = seen.iter().map(|&to| to as usize).filter(|&to| to != space);
    let all: f64 = others.clone().map(|to| volume(&regions[to])).sum();
    let mut points = Vec::with_capacity(TARGETS);
    let mut passed = 0.0;
    for to in others {
        passed += volume(&regions[to]);
        let due = |points: &Vec<_>| all * (points.len() as f64 + 0.5) / TARGETS as f64;
        while points.len() < TARGETS && passed >= due(&points) {
            points.push(spread(&regions[to], points.len()));
        }
    }
    points
}

/// Points of a space, evenly spread.
fn eyes(region: &Region) -> Vec<DVec3> {
    let along = |i: usize| (i as f64 + 0.5) / EYES_ALONG as f64;
    let steps = (0..EYES_ALONG.pow(3))
        .map(|i| [i % EYES_ALONG, i / EYES_ALONG % EYES_ALONG, i / EYES_ALONG.pow(2)].map(along));
    steps.map(|share| inside(region, DVec3::from(share))).collect()
}

/// One of many evenly spread points of a region, by the additive recurrence of Roberts 2018.
fn spread(region: &Region, number: usize) -> DVec3 {
    let step = DVec3::new(0.819_172_513, 0.671_043_607, 0.549_700_478);
    inside(region, (step * (number + 1) as f64).fract())
}

/// The point at a share of a region's box. Where planes cut it off, the middle of the region.
fn inside(region: &Region, share: DVec3) -> DVec3 {
    let (min, max) = (region.bounds.min.as_dvec3(), region.bounds.max.as_dvec3());
    let point = min + (max - min) * share;
    if region.contains(point) { point } else { region.middle() }
}

fn volume(region: &Region) -> f64 {
    region.bounds.size().max(Vec3::ZERO).as_dvec3().element_product()
}
