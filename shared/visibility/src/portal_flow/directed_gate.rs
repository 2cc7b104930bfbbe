//! Gates that lines pass in one direction.

use glam::{DVec3, Vec3};

use super::{daabb::DAabb, separators::HalfSpaces};
use crate::HalfSpace;
use sightline_world::{
    Polygon,
    tolerance::{DEGENERATE_M, ON_PLANE_F64_M, WIDENING_M},
};

/// A gate that lines pass in one direction, into a space.
pub(super) struct DirectedGate {
    /// Index of the space that it leads to.
    pub(super) to: u32,
    /// The unit normal, which points into that space.
    pub(super) normal: DVec3,
    /// The distance of the gate's plane from the origin along the normal.
    pub(super) distance: f64,
    /// The box around the gate, widened.
    pub(super) bounds: DAabb,
    /// The edges. Empty for an axial rectangle.
    pub(super) edges: Box<[GateEdge]>,
    /// The corners, moved outwards. Empty for an axial rectangle.
    pub(super) corners: Box<[DVec3]>,
}

/// An edge of a gate.
#[derive(Clone, Copy)]
pub(super) struct GateEdge {
    /// A point of the edge, moved outwards.
    point: DVec3,
    /// The unit vector in the gate's plane that leads out over the edge.
    out: DVec3,
}

/// The height of a box's corner over an edge.
struct CornerHeight {
    /// Outwards, in the gate's plane, in metres.
    out: f64,
    /// Beyond the gate, along its normal, in metres.
    beyond: f64,
}

impl DirectedGate {
    /// A gate into the space `to`. `sign` is 1 if the polygon's normal points there, and -1 if not.
    pub(super) fn new(polygon: &Polygon, to: u32, sign: f64) -> Self {
        match polygon {
            Polygon::Rectangle { axis, bounds } => {
                let axis = usize::from(*axis);
                let mut normal = DVec3::ZERO;
                normal[axis] = sign;
                let at = f64::from(bounds.min[axis]);
                let mut region = DAabb::around(bounds, WIDENING_M);
                (region.min[axis], region.max[axis]) = (at, at);
                let none = (Box::default(), Box::default());
                Self {
                    to,
                    normal,
                    distance: at * sign,
                    bounds: region,
                    edges: none.0,
                    corners: none.1,
                }
            }
            Polygon::Other { normal, corners } => Self::slanted(*normal * sign, corners, to),
        }
    }

    /// A gate that is not an axial rectangle, with its corners in order.
    pub(super) fn slanted(normal: DVec3, corners: &[Vec3], to: u32) -> Self {
        debug_assert!(corners.len() >= 3, "a gate has an area");
        debug_assert!((normal.length() - 1.0).abs() < 1e-3, "normals have unit length");
        let corners: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
        let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
        // Corners move outwards so far that every edge moves by at least the widening. At sharp
        // corners they do not, but there the planes of the edges still do.
        let wide: Vec<DVec3> = corners
            .iter()
            .map(|&c| c + (c - centre).normalize_or_zero() * 4.0 * WIDENING_M)
            .collect();
        let mut edges = Vec::with_capacity(corners.len());
        for (i, &from) in corners.iter().enumerate() {
            let to = corners[(i + 1) % corners.len()];
            let out = (to - from).cross(normal).normalize_or_zero();
            let out = if out.dot(centre - from) > 0.0 { -out } else { out };
            // An edge too short to have a direction bounds nothing.
            if out != DVec3::ZERO {
                edges.push(GateEdge { point: from + out * WIDENING_M, out });
            }
        }
        let (min, max) = (
            wide.iter().fold(DVec3::INFINITY, |a, &b| a.min(b)),
            wide.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b)),
        );
        // The plane goes through the corners themselves, not through the widened ones.
        let distance = normal.dot(centre);
        let bounds = DAabb { min: min - WIDENING_M, max: max + WIDENING_M };
        Self { to, normal, distance, bounds, edges: edges.into(), corners: wide.into() }
    }

    /// The half-space on the near side.
    pub(super) fn near_side(&self) -> HalfSpace {
        HalfSpace { normal: self.normal, distance: self.distance }
    }

    /// Whether some of a box is on the near side.
    pub(super) fn is_before(&self, region: &DAabb) -> bool {
        let nearest = (self.normal * region.min).min(self.normal * region.max).element_sum();
        nearest < self.distance - ON_PLANE_F64_M
    }

    /// Whether some of a box is on the far side.
    pub(super) fn is_beyond(&self, region: &DAabb) -> bool {
        let farthest = (self.normal * region.min).max(self.normal * region.max).element_sum();
        farthest > self.distance + ON_PLANE_F64_M
    }
}

/// Adds half-spaces that every line from a box through a gate stays in beyond the gate. Their
/// planes go through the gate's edges. An axial rectangle adds none.
pub(super) fn edge_separators(
    source: &DAabb,
    gate: &DirectedGate,
    normal: DVec3,
    found: &mut HalfSpaces,
) {
    if gate.edges.is_empty() {
        return;
    }
    let corners = source.corners();
    for &GateEdge { point, out } in &gate.edges {
        let heights = corners
            .map(|c| CornerHeight { out: (c - point).dot(out), beyond: (c - point).dot(normal) });
        let lean = least_lean(&heights);
        if lean.is_finite() {
            let normal = (out + normal * lean).normalize();
            found.push(HalfSpace { normal, distance: normal.dot(point) });
        }
    }
}

/// How far a plane through an edge has to lean outwards, per metre beyond the gate, to touch a box:
/// the least such lean. Given are the heights of the box's corners, in the order of
/// [`DAabb::corners`]. Not finite if there is no such plane.
fn least_lean(heights: &[CornerHeight; 8]) -> f64 {
    let mut lean = f64::INFINITY;
    for (corner, &CornerHeight { out, beyond }) in heights.iter().enumerate() {
        if beyond < -DEGENERATE_M {
            lean = lean.min(out / -beyond);
        } else if out < ON_PLANE_F64_M {
            return f64::NEG_INFINITY;
        } else {
            // The box may still reach the gate on the inner side of the edge.
            for bit in [1, 2, 4] {
                let CornerHeight { out: other_out, beyond: other } = heights[corner ^ bit];
                if other < -DEGENERATE_M
                    && out - (out - other_out) * beyond / (beyond - other) < ON_PLANE_F64_M
                {
                    return f64::NEG_INFINITY;
                }
            }
        }
    }
    lean
}

/// Shrinks a box around a polygon to hold the part of the polygon in all of some half-spaces. False
/// if there is no such part.
pub(super) fn cut_polygon(corners: &[DVec3], halves: &HalfSpaces, around: &mut DAabb) -> bool {
    let mut polygon = corners.to_vec();
    let mut kept = Vec::with_capacity(polygon.len() + 2);
    for half in halves.as_slice() {
        let height = |p: DVec3| half.normal.dot(p) - half.distance - ON_PLANE_F64_M;
        kept.clear();
        for (i, &here) in polygon.iter().enumerate() {
            let next = polygon[(i + 1) % polygon.len()];
            let (a, b) = (height(here), height(next));
            if a <= 0.0 {
                kept.push(here);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                kept.push(here.lerp(next, a / (a - b)));
            }
        }
        std::mem::swap(&mut polygon, &mut kept);
        if polygon.is_empty() {
            return false;
        }
    }
    let min = polygon.iter().fold(DVec3::INFINITY, |a, &b| a.min(b)) - WIDENING_M;
    let max = polygon.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b)) + WIDENING_M;
    *around = DAabb { min: around.min.max(min), max: around.max.min(max) };
    around.min.cmple(around.max).all()
}

/// Whether every line from one box to another passes a gate, which is an axial rectangle between
/// them.
pub(super) fn is_between(source: &DAabb, gate: &DAabb, target: &DAabb) -> bool {
    let Some(axis) = (0..3).find(|&axis| gate.min[axis] == gate.max[axis]) else { return false };
    let at = gate.min[axis];
    let is_ahead = target.min[axis] + target.max[axis] > source.min[axis] + source.max[axis];
    // The distances of the near and the far side of each box from the gate.
    let (source_far, source_near, target_near, target_far) = if is_ahead {
        (at - source.min[axis], at - source.max[axis], target.min[axis] - at, target.max[axis] - at)
    } else {
        (source.max[axis] - at, source.min[axis] - at, at - target.max[axis], at - target.min[axis])
    };
    if source_near < -2.0 * WIDENING_M || target_near < -2.0 * WIDENING_M {
        return false;
    }
    let ways = [source_near.max(0.0), source_far].into_iter().flat_map(|before| {
        [target_near.max(0.0), target_far].map(|beyond| before / (before + beyond).max(1e-9))
    });
    ways.into_iter().all(|share| {
        let low = source.min.lerp(target.min, share);
        let high = source.max.lerp(target.max, share);
        let within = low.cmpge(gate.min) & high.cmple(gate.max);
        (0..3).all(|other| other == axis || within.test(other))
    })
}
