//! The fuzzy projection box: six faces, and the faces that a field of view meets.

use glam::{DVec2, DVec3};
use sightline_world::{
    geometry::{Aabb, Frustum},
    tolerance::NEAR_PLANE_M,
};

/// A point of a face that is [`NEAR_PLANE_M`] away is farther than this along the face's axis.
pub(super) const NEAR_DEPTH_M: f64 = 0.5 * NEAR_PLANE_M;

/// A box of eyes, each with the same field of view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewpointBox {
    eyes: Aabb,
    active: [bool; 6],
}

impl ViewpointBox {
    /// Eyes that look all round. A box that is empty or not finite holds no eyes, so that
    /// everything counts as hidden.
    pub fn all_round(eyes: Aabb) -> Self {
        Self { eyes, active: [true; 6] }
    }

    /// Eyes that look in some directions only. Faces that no such direction meets are inactive and
    /// cost nothing. Whatever may project onto an inactive face counts as not hidden.
    pub fn within(eyes: Aabb, directions: &Frustum) -> Self {
        let active = CubeFace::ALL.map(|face| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
            let corners = corners.map(|[x, y]| face.unturned(DVec3::new(x, y, 1.0)));
            let excludes = |out: &DVec3| corners.iter().all(|corner| out.dot(*corner) > 0.0);
            // The sum of the normals points backwards. Only it excludes the face behind.
            let sum = directions.outwards().iter().sum();
            !directions.outwards().iter().chain([&sum]).any(excludes)
        });
        Self { eyes, active }
    }

    /// The box of eyes.
    pub fn eyes(&self) -> Aabb {
        self.eyes
    }

    /// The active faces.
    pub(super) fn faces(&self) -> impl Iterator<Item = CubeFace> + '_ {
        CubeFace::ALL.into_iter().filter(|face| self.active[face.index()])
    }

    /// Whether there are no eyes.
    pub(super) fn is_empty(&self) -> bool {
        self.eyes.is_empty() || !self.eyes.min.is_finite() || !self.eyes.max.is_finite()
    }

    /// The middle of the box: the viewpoint whose depths are kept.
    pub(super) fn middle(&self) -> DVec3 {
        (self.eyes.min.as_dvec3() + self.eyes.max.as_dvec3()) * 0.5
    }

    /// The corners of the box, with opposite ones first and last.
    pub(super) fn corners(&self) -> [DVec3; 8] {
        self.eyes.corners().map(|corner| corner.as_dvec3())
    }
}

/// A face of the cube: the directions nearest to one direction along one axis. In the face's own
/// coordinates that direction is z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CubeFace {
    axis: usize,
    backwards: bool,
}

impl CubeFace {
    pub(super) const ALL: [Self; 6] = [
        Self { axis: 0, backwards: false },
        Self { axis: 0, backwards: true },
        Self { axis: 1, backwards: false },
        Self { axis: 1, backwards: true },
        Self { axis: 2, backwards: false },
        Self { axis: 2, backwards: true },
    ];

    pub(super) fn index(self) -> usize {
        2 * self.axis + usize::from(self.backwards)
    }

    fn sign(self) -> f64 {
        if self.backwards { -1.0 } else { 1.0 }
    }

    /// The greatest coordinate along the face's direction between two corners.
    pub(super) fn most(self, low: DVec3, high: DVec3) -> f64 {
        if self.backwards { -low[self.axis] } else { high[self.axis] }
    }

    /// Turns a vector into the face's own coordinates.
    pub(super) fn turned(self, v: DVec3) -> DVec3 {
        DVec3::new(v[(self.axis + 1) % 3], v[(self.axis + 2) % 3], self.sign() * v[self.axis])
    }

    fn unturned(self, v: DVec3) -> DVec3 {
        let mut turned = DVec3::ZERO;
        turned[(self.axis + 1) % 3] = v.x;
        turned[(self.axis + 2) % 3] = v.y;
        turned[self.axis] = self.sign() * v.z;
        turned
    }
}

/// The place, in elements, at which a direction meets a face with `size` elements each way.
fn element(point: DVec3, size: f64) -> DVec2 {
    (point.truncate() / point.z + 1.0) * (0.5 * size)
}

/// The projection of a convex polygon onto a face, in elements, with its corners in order. The
/// polygon is given relative to the eye, in the face's coordinates, and is clipped.
pub(super) fn projected(polygon: &mut Vec<DVec3>, size: f64, spare: &mut Vec<DVec3>) -> Vec<DVec2> {
    let sides = [
        DVec3::new(1.0, 0.0, 1.0),
        DVec3::new(-1.0, 0.0, 1.0),
        DVec3::new(0.0, 1.0, 1.0),
        DVec3::new(0.0, -1.0, 1.0),
    ];
    clip(polygon, |p| p.z - NEAR_DEPTH_M, spare);
    for side in sides {
        // Slightly wider than the face, so that rounding loses nothing at its rim.
        clip(polygon, |p| p.dot(side) + 1e-9 * p.z, spare);
    }
    polygon.iter().map(|point| element(*point, size)).collect()
}

/// Clips a convex polygon to where a linear function is not negative.
fn clip(polygon: &mut Vec<DVec3>, height: impl Fn(DVec3) -> f64, spare: &mut Vec<DVec3>) {
    spare.clear();
    for (i, &to) in polygon.iter().enumerate() {
        let from = polygon[(i + polygon.len() - 1) % polygon.len()];
        let (low, high) = (height(from), height(to));
        if (low < 0.0) != (high < 0.0) {
            spare.push(from + (to - from) * (low / (low - high)));
        }
        if high >= 0.0 {
            spare.push(to);
        }
    }
    std::mem::swap(polygon, spare);
}

/// The fuzzy region of some points: the directions from any eye to any point of their convex hull,
/// on a face. It is a convex polygon in elements, with its corners in order. Empty if it misses the
/// face.
pub(super) fn region(
    face: CubeFace,
    points: &[DVec3],
    eyes: &[DVec3; 8],
    size: f64,
    spare: &mut Vec<DVec3>,
) -> Vec<DVec2> {
    spare.clear();
    spare.extend(points.iter().flat_map(|point| eyes.map(|eye| face.turned(*point - eye))));
    let misses = |beyond: fn(&DVec3) -> bool| spare.iter().all(beyond);
    if misses(|p| p.z < NEAR_DEPTH_M)
        || misses(|p| p.x > p.z)
        || misses(|p| -p.x > p.z)
        || misses(|p| p.y > p.z)
        || misses(|p| -p.y > p.z)
    {
        return Vec::new();
    }
    let (front, behind): (Vec<DVec3>, Vec<DVec3>) =
        spare.iter().partition(|point| point.z >= NEAR_DEPTH_M);
    let crossings = front.iter().flat_map(|from| {
        behind.iter().map(move |to| {
            let share = (from.z - NEAR_DEPTH_M) / (from.z - to.z);
            (*from + (*to - *from) * share).with_z(NEAR_DEPTH_M)
        })
    });
    hull(front.iter().copied().chain(crossings).map(|point| element(point, size)).collect())
}

/// The convex hull of some points, in order, by the monotone chain of Andrew 1979.
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., before, last] = chain[..]
                && (last - before).perp_dot(point - last) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut points.iter().copied());
    all.extend(half(&mut points.iter().rev().copied()));
    all
}

/// The fuzzy extent of a box on a face: the least and the greatest X and Y at which any eye may see
/// it, from -1 to 1. The face looks along `axis`, `backwards` or not. None if no eye sees the box
/// there. By equations (1) and (2) of Lim 1999, Appendix 2, for the corners of both boxes.
pub fn fuzzy_extent(
    bounds: &Aabb,
    eyes: &Aabb,
    axis: usize,
    backwards: bool,
) -> Option<[[f64; 2]; 2]> {
    let face = CubeFace { axis: axis % 3, backwards };
    let [low, high] = [bounds.min, bounds.max].map(|corner| corner.as_dvec3());
    let [from, to] = [eyes.min, eyes.max].map(|corner| corner.as_dvec3());
    let (one, other) = (face.turned(low - to), face.turned(high - from));
    let (near, far) = (one.z.min(other.z), one.z.max(other.z));
    let span = spans(one.with_z(near), other.with_z(far))?;
    let held = span.map(|[least, most]| [least.max(-1.0), most.min(1.0)]);
    held.iter().all(|[least, most]| least <= most).then_some(held)
}

/// The least and greatest quotients of x and y by z between two corners. None if all of it is
/// behind.
pub(super) fn spans(low: DVec3, high: DVec3) -> Option<[[f64; 2]; 2]> {
    if high.z <= 0.0 {
        return None;
    }
    let near = low.z.max(0.0);
    let least = |value: f64| value / if value < 0.0 { near } else { high.z };
    let most = |value: f64| value / if value > 0.0 { near } else { high.z };
    // Zero by zero: the eye may be anywhere in front of it.
    let sure = |value: f64, otherwise: f64| if value.is_nan() { otherwise } else { value };
    let span = |low: f64, high: f64| {
        [sure(least(low), f64::NEG_INFINITY), sure(most(high), f64::INFINITY)]
    };
    Some([span(low.x, high.x), span(low.y, high.y)])
}
