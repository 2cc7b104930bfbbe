//! The caps that close the hole in a solid: ComputeBinA (Lei and Ouhyoung 1999, section 4.2.2).
//!
//! The surface of a cutting ends in *external edges*, which belong to one polygon only. Where such
//! an edge lies in the interior of a side of the volume, the surface of the model crosses that
//! side: one side of the edge is inside the solid and the other is outside. The normal of the
//! polygon that ends there tells which.
//!
//! The paper follows oriented chains of external edges. Here each edge is taken by itself. A side
//! is swept in strips between the ends of edges. In each strip, the edges that run through it bound
//! trapezoids, which are inside or outside. This gives the polygon of a chain or its complement,
//! whichever is right. Chains need not close, and there may be several. In a strip without an edge,
//! a ray into the volume decides.

use glam::{DVec2, DVec3};

use super::{
    plane::Plane,
    topology::{Tolerance, Topology},
    volume::{Triangle, Volume},
};

/// The origins of rays, as shares of a strip. The first ray that meets anything decides. The paper
/// shoots one ray from the middle, which in a symmetrical model would meet edges, or nothing.
const SHOTS: [DVec2; 9] = [
    DVec2::new(0.5137, 0.4929),
    DVec2::new(0.3863, 0.6271),
    DVec2::new(0.6419, 0.6143),
    DVec2::new(0.3761, 0.3671),
    DVec2::new(0.6337, 0.3583),
    DVec2::new(0.1163, 0.1071),
    DVec2::new(0.8851, 0.0937),
    DVec2::new(0.1239, 0.9113),
    DVec2::new(0.9047, 0.8793),
];

/// The parts of the six sides of a volume that lie inside the solid whose surface in the volume is
/// the cutting. Each comes with its plane, which faces into the volume.
pub(super) fn cap_polygons(
    volume: &Volume,
    cutting: &[Triangle],
    tolerance: Tolerance,
) -> Vec<(Plane, Vec<Triangle>)> {
    // A flat volume leaves no hole.
    if (volume.max - volume.min).min_element() <= volume.near * 2.0 {
        return Vec::new();
    }
    let external = external_edges(cutting, tolerance);
    let mut caps = Vec::new();
    for axis in 0..3 {
        for outwards in [-1.0, 1.0] {
            let side = Side::new(volume, axis, outwards);
            let edges: Vec<Edge> = external.iter().filter_map(|e| side.interior_edge(e)).collect();
            let triangles = side.inside(&edges, cutting);
            if !triangles.is_empty() {
                let normal = DVec3::AXES[axis] * -outwards;
                debug_assert!(side.min.cmplt(side.max).all(), "the volume is not flat");
                caps.push((Plane { normal, distance: -outwards * side.at }, triangles));
            }
        }
    }
    caps
}

/// An edge of only one polygon of a cutting, and the normal of that polygon.
struct External {
    from: DVec3,
    to: DVec3,
    normal: DVec3,
}

/// The external edges of a cutting. An edge that two polygons share is not external, whichever way
/// they face.
fn external_edges(cutting: &[Triangle], tolerance: Tolerance) -> Vec<External> {
    let topology = Topology::new(cutting, tolerance);
    let edges = topology.halves.chunk_by(|a, b| a.key() == b.key());
    edges
        .filter_map(|halves| {
            let [half] = halves else { return None };
            let [low, high] = half.ends().map(|i| topology.points[i as usize]);
            let (from, to) = if half.forward { (low, high) } else { (high, low) };
            let [a, b, c] = cutting[half.triangle as usize];
            let normal = (b - a).cross(c - a).normalize_or_zero();
            Some(External { from, to, normal })
        })
        .collect()
}

/// An external edge in the interior of a side, from left to right.
struct Edge {
    left: DVec2,
    right: DVec2,
    /// Points into the solid.
    inside: DVec2,
}

impl Edge {
    fn height_at(&self, u: f64) -> f64 {
        let share = (u - self.left.x) / (self.right.x - self.left.x);
        self.left.y + (self.right.y - self.left.y) * share
    }

    /// Whether the solid lies on the side of greater v.
    fn has_inside_above(&self) -> bool {
        (self.right - self.left).perp().dot(self.inside) > 0.0
    }
}

/// A side of the volume.
struct Side {
    axis: usize,
    at: f64,
    outwards: f64,
    min: DVec2,
    max: DVec2,
    near: f64,
}

impl Side {
    fn new(volume: &Volume, axis: usize, outwards: f64) -> Self {
        let at = if outwards > 0.0 { volume.max[axis] } else { volume.min[axis] };
        let flat = |p| flatten(p, axis);
        let (min, max) = (flat(volume.min), flat(volume.max));
        Self { axis, at, outwards, min, max, near: volume.near }
    }

    /// The edge in the coordinates of the side, if it lies in the interior of the side.
    fn interior_edge(&self, edge: &External) -> Option<Edge> {
        let on_plane = |p: DVec3| (p[self.axis] - self.at).abs() <= self.near;
        let [from, to] = [edge.from, edge.to].map(|p| flatten(p, self.axis));
        let middle = (from + to) * 0.5;
        let margin = DVec2::splat(self.near);
        let is_interior =
            middle.cmpgt(self.min + margin).all() && middle.cmplt(self.max - margin).all();
        if !on_plane(edge.from) || !on_plane(edge.to) || !is_interior {
            return None;
        }
        // A polygon in the plane of the side covers the inside when it faces into the volume.
        // Behind any other polygon lies the solid.
        let facing = edge.normal[self.axis] * self.outwards;
        let inside = if facing.abs() > 0.999 {
            edge.normal.cross(edge.to - edge.from) * -facing.signum()
        } else {
            -edge.normal
        };
        let (left, right) = if from.x <= to.x { (from, to) } else { (to, from) };
        Some(Edge { left, right, inside: flatten(inside, self.axis) })
    }

    /// The part of the side inside the solid, as triangles that face into the volume.
    fn inside(&self, edges: &[Edge], cutting: &[Triangle]) -> Vec<Triangle> {
        let mut cuts = vec![self.min.x, self.max.x];
        cuts.extend(edges.iter().flat_map(|edge| [edge.left.x, edge.right.x]));
        cuts.retain(|u| (self.min.x..=self.max.x).contains(u));
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup_by(|next, kept| *next - *kept <= self.near);
        let mut triangles = Vec::new();
        for strip in cuts.windows(2) {
            self.strip([strip[0], strip[1]], edges, cutting, &mut triangles);
        }
        triangles
    }

    /// Adds the part of one strip that is inside the solid.
    fn strip(
        &self,
        strip: [f64; 2],
        edges: &[Edge],
        cutting: &[Triangle],
        triangles: &mut Vec<Triangle>,
    ) {
        let middle = (strip[0] + strip[1]) * 0.5;
        let runs_through = |edge: &&Edge| {
            edge.left.x <= strip[0] + self.near
                && edge.right.x >= strip[1] - self.near
                && edge.right.x - edge.left.x > self.near
        };
        let mut through: Vec<&Edge> = edges.iter().filter(runs_through).collect();
        through.sort_by(|a, b| a.height_at(middle).total_cmp(&b.height_at(middle)));
        if through.is_empty() {
            if self.is_strip_inside(strip, edges, cutting) {
                self.trapezoid(strip, [self.min.y; 2], [self.max.y; 2], triangles);
            }
            return;
        }
        for i in 0..=through.len() {
            let below = i.checked_sub(1).map(|i| through[i]);
            let above = through.get(i).copied();
            let says_inside = [
                below.is_none_or(Edge::has_inside_above),
                above.is_none_or(|edge| !edge.has_inside_above()),
            ];
            // Two edges that contradict each other bound nothing that is sure to be solid.
            if says_inside == [true; 2] {
                let heights = |edge: Option<&Edge>, otherwise: f64| {
                    strip.map(|u| edge.map_or(otherwise, |edge| edge.height_at(u)))
                };
                let (low, high) = (heights(below, self.min.y), heights(above, self.max.y));
                self.trapezoid(strip, low, high, triangles);
            }
        }
    }

    /// Whether a strip without an edge is inside. An upright edge beside it tells, or else a ray.
    fn is_strip_inside(&self, strip: [f64; 2], edges: &[Edge], cutting: &[Triangle]) -> bool {
        let upright = edges.iter().filter(|edge| edge.right.x - edge.left.x <= self.near);
        for edge in upright {
            if (edge.left.x - strip[0]).abs() <= self.near {
                return edge.inside.x > 0.0;
            }
            if (edge.left.x - strip[1]).abs() <= self.near {
                return edge.inside.x < 0.0;
            }
        }
        let (low, high) = (DVec2::new(strip[0], self.min.y), DVec2::new(strip[1], self.max.y));
        SHOTS
            .iter()
            .find_map(|shot| self.shoot(low + (high - low) * shot, cutting))
            .unwrap_or(false)
    }

    /// Whether a ray into the volume first meets the cutting from behind: then it begins inside the
    /// solid. A polygon on the side itself is met at once.
    fn shoot(&self, from: DVec2, cutting: &[Triangle]) -> Option<bool> {
        let mut first: Option<(f64, bool)> = None;
        for triangle in cutting {
            let [a, b, c] = triangle.map(|p| flatten(p, self.axis));
            let doubled = (b - a).perp_dot(c - a);
            let weights =
                [(b, c), (c, a), (a, b)].map(|(p, q)| (q - p).perp_dot(from - p) / doubled);
            // Edge on, the weights are not numbers and the comparison is false.
            if !weights.iter().all(|&w| w >= 0.0) {
                continue;
            }
            let along: f64 = (0..3).map(|i| triangle[i][self.axis] * weights[i]).sum();
            let distance = (self.at - along) * self.outwards;
            let [a, b, c] = *triangle;
            let is_from_behind = (b - a).cross(c - a)[self.axis] * self.outwards < 0.0;
            if distance >= -self.near && first.is_none_or(|(nearest, _)| distance < nearest) {
                first = Some((distance, is_from_behind));
            }
        }
        first.map(|(_, is_from_behind)| is_from_behind)
    }

    /// Adds a trapezoid between two heights at the left and two at the right.
    fn trapezoid(
        &self,
        [left, right]: [f64; 2],
        low: [f64; 2],
        high: [f64; 2],
        triangles: &mut Vec<Triangle>,
    ) {
        let corners = [(left, low[0]), (right, low[1]), (right, high[1]), (left, high[0])];
        let mut corners = corners.map(|(u, v)| self.raised(DVec2::new(u, v)));
        // In cyclic order of axes, u before v is anticlockwise seen against the axis.
        if (self.axis == 1) == (self.outwards < 0.0) {
            corners.reverse();
        }
        let [a, b, c, d] = corners;
        for triangle in [[a, b, c], [a, c, d]] {
            if (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]) != DVec3::ZERO {
                triangles.push(triangle);
            }
        }
    }

    /// A point of the side in space.
    fn raised(&self, point: DVec2) -> DVec3 {
        match self.axis {
            0 => DVec3::new(self.at, point.x, point.y),
            1 => DVec3::new(point.x, self.at, point.y),
            _ => DVec3::new(point.x, point.y, self.at),
        }
    }
}

/// The two other coordinates, in ascending order of axis.
fn flatten(point: DVec3, axis: usize) -> DVec2 {
    match axis {
        0 => DVec2::new(point.y, point.z),
        1 => DVec2::new(point.x, point.z),
        _ => DVec2::new(point.x, point.y),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::carve::volume::area;

    /// A square tube in a unit volume, from 0.25 to 0.75, open at the side z = 1. Its walls face
    /// outwards when it is a bar, and inwards when it is a hole.
    fn tube(is_bar: bool) -> Vec<Triangle> {
        let ring = [(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)];
        let at = |(x, y): (f64, f64), z: f64| DVec3::new(x, y, z);
        let mut quads = vec![ring.map(|p| at(p, 0.5))];
        quads[0].reverse();
        for i in 0..4 {
            let (p, q) = (ring[i], ring[(i + 1) % 4]);
            quads.push([at(p, 0.5), at(q, 0.5), at(q, 1.0), at(p, 1.0)]);
        }
        if !is_bar {
            quads.iter_mut().for_each(|quad| quad.reverse());
        }
        quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
    }

    fn check(cutting: &[Triangle], expected: &[(DVec3, f64)]) {
        let volume = Volume { min: DVec3::ZERO, max: DVec3::ONE, near: 8e-5 };
        let caps = cap_polygons(&volume, cutting, Tolerance { weld: 2e-5, plane: 8e-5 });
        let found: Vec<(DVec3, f64)> =
            caps.iter().map(|(plane, parts)| (plane.normal, area(parts))).collect();
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for ((normal, size), (expected_normal, expected_size)) in found.iter().zip(expected) {
            assert_eq!(normal, expected_normal);
            assert!((size - expected_size).abs() < 1e-9, "{found:?}");
        }
        for (plane, parts) in &caps {
            for [a, b, c] in parts {
                assert!(plane.height(*a).abs() < 1e-9);
                assert!((b - a).cross(c - a).dot(plane.normal) > 0.0);
            }
        }
    }

    /// The cap is the polygon of the chain or its complement, by the orientation of the chain.
    #[test]
    fn a_chain_bounds_the_cap_or_the_hole_in_it() {
        check(&tube(true), &[(DVec3::NEG_Z, 0.25)]);
        let five = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z].map(|n| (n, 1.0));
        check(&tube(false), &[&five[..], &[(DVec3::NEG_Z, 0.75)]].concat());
    }

    /// Without an edge in the interior of a side, a ray decides.
    #[test]
    fn a_side_without_a_chain_becomes_a_cap_as_a_whole_or_not_at_all() {
        check(&[], &[]);
        // A ramp, solid below, from the lower edge at x = 0 to the upper one at x = 1.
        let at = |x: f64, z: f64| DVec3::new(x, x, z);
        let ramp = [[at(0., 0.), at(0., 1.), at(1., 1.)], [at(0., 0.), at(1., 1.), at(1., 0.)]];
        let ends = [(DVec3::Z, 0.5), (DVec3::NEG_Z, 0.5)];
        check(&ramp, &[&[(DVec3::NEG_X, 1.0), (DVec3::Y, 1.0)][..], &ends].concat());
        let turned = ramp.map(|[a, b, c]| [a, c, b]);
        check(&turned, &[&[(DVec3::X, 1.0), (DVec3::NEG_Y, 1.0)][..], &ends].concat());
    }
}
