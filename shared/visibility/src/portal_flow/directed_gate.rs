//! Gates, each taken one way.

use glam::{DVec3, Vec3};

use super::daabb::{DAabb, HalfSpace, HalfSpaces};
use sightline_world::{
    Polygon,
    tolerance::{DEGENERATE_M, ON_PLANE_F64_M, WIDENING_M},
};

/// A gate, taken one way.
pub(super) struct DirectedGate {
    pub(super) to: u32,
    /// Towards `to`.
    pub(super) normal: DVec3,
    pub(super) distance: f64,
    pub(super) bounds: DAabb,
    /// For a gate that is no axial rectangle: a point of each edge, and the direction in the
    /// gate's plane that leads out over it.
    pub(super) edges: Box<[(DVec3, DVec3)]>,
    pub(super) corners: Box<[DVec3]>,
}

impl DirectedGate {
    pub(super) fn new(polygon: &Polygon, to: u32, sign: f64) -> Self {
        match polygon {
            Polygon::Rectangle { axis, bounds } => {
                let axis = usize::from(*axis);
                let mut normal = DVec3::ZERO;
                normal[axis] = sign;
                let at = f64::from(bounds.min[axis]);
                let mut extent = DAabb::around(bounds, WIDENING_M);
                (extent.min[axis], extent.max[axis]) = (at, at);
                let none = (Box::default(), Box::default());
                Self {
                    to,
                    normal,
                    distance: at * sign,
                    bounds: extent,
                    edges: none.0,
                    corners: none.1,
                }
            }
            Polygon::Other { normal, corners } => Self::slanted(*normal * sign, corners, to),
        }
    }

    pub(super) fn slanted(normal: DVec3, corners: &[Vec3], to: u32) -> Self {
        let corners: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
        let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
        // Corners are moved outwards by so much that every edge moves by the widening at least,
        // but where two edges meet sharply: there the edges' own planes still do.
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
                edges.push((from + out * WIDENING_M, out));
            }
        }
        let (min, max) = (
            wide.iter().fold(DVec3::INFINITY, |a, &b| a.min(b)),
            wide.iter().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b)),
        );
        // Where the corners lie along the normal, and not where the widened ones do.
        let distance = normal.dot(centre);
        let bounds = DAabb { min: min - WIDENING_M, max: max + WIDENING_M };
        Self { to, normal, distance, bounds, edges: edges.into(), corners: wide.into() }
    }

    /// What is on the near side.
    pub(super) fn before(&self) -> HalfSpace {
        HalfSpace { normal: self.normal, limit: self.distance }
    }

    /// Whether something has a part on the near side.
    pub(super) fn is_before(&self, extent: &DAabb) -> bool {
        let nearest = (self.normal * extent.min).min(self.normal * extent.max).element_sum();
        nearest < self.distance - ON_PLANE_F64_M
    }

    /// Whether something has a part on the far side.
    pub(super) fn is_beyond(&self, extent: &DAabb) -> bool {
        let farthest = (self.normal * extent.min).max(self.normal * extent.max).element_sum();
        farthest > self.distance + ON_PLANE_F64_M
    }
}

/// Likewise, through the edges of a gate that is no axial rectangle.
pub(super) fn edge_separators(
    source: &DAabb,
    door: &DirectedGate,
    normal: DVec3,
    found: &mut HalfSpaces,
) {
    if door.edges.is_empty() {
        return;
    }
    let corners = source.corners();
    for &(point, out) in &door.edges {
        let heights = corners.map(|c| ((c - point).dot(out), (c - point).dot(normal)));
        let lean = least_lean(&heights);
        if lean.is_finite() {
            let normal = (out + normal * lean).normalize();
            found.push(HalfSpace { normal, limit: normal.dot(point) });
        }
    }
}

/// The plane through an edge that leans outwards by this for each metre beyond the gate touches a
/// box: as little as can be. Given are the heights of the box's corners over the edge, outwards and
/// beyond the gate. Not finite when there is none.
pub(super) fn least_lean(heights: &[(f64, f64); 8]) -> f64 {
    let mut lean = f64::INFINITY;
    for (corner, &(out, beyond)) in heights.iter().enumerate() {
        if beyond < -DEGENERATE_M {
            lean = lean.min(out / -beyond);
        } else if out < ON_PLANE_F64_M {
            return f64::NEG_INFINITY;
        } else {
            // The box may come to the gate within the edge all the same.
            for bit in [1, 2, 4] {
                let (other_out, other) = heights[corner ^ bit];
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

/// Cuts a box about a polygon to what holds the polygon's part within some half-spaces; false when
/// there is none.
pub(super) fn cut_polygon(corners: &[DVec3], halves: &HalfSpaces, around: &mut DAabb) -> bool {
    let mut polygon = corners.to_vec();
    let mut kept = Vec::with_capacity(polygon.len() + 2);
    for half in halves.as_slice() {
        let height = |p: DVec3| half.normal.dot(p) - half.limit - ON_PLANE_F64_M;
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

/// Whether every line from a box to another goes through a gate, an axial rectangle between them.
pub(super) fn is_between(source: &DAabb, gate: &DAabb, target: &DAabb) -> bool {
    let Some(axis) = (0..3).find(|&axis| gate.min[axis] == gate.max[axis]) else { return false };
    let at = gate.min[axis];
    let is_ahead = target.min[axis] + target.max[axis] > source.min[axis] + source.max[axis];
    // The near and the far side of each, as distances from the gate.
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
