//! Convex regions of space, and convex polygons in them.

use glam::DVec3;
use sightline_world::geometry::Aabb;
use sightline_world::tolerance::{DEGENERATE_M, ON_PLANE_F32_M};

use crate::split_plane::SplitPlane;

/// Walls and slabs are at most this thick, in metres.
pub(super) const WALL_MAX: f32 = 0.6;

/// A convex region: a box cut by planes that are not axial.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Region {
    /// The box, in metres.
    pub bounds: Aabb,
    /// The planes that cut it, and whether the region is on their greater side.
    slants: Vec<(SplitPlane, bool)>,
}

impl Region {
    /// A box.
    pub(super) fn new(bounds: Aabb) -> Self {
        Self { bounds, slants: Vec::new() }
    }

    /// Whether the region fills its box.
    pub(super) fn is_box(&self) -> bool {
        self.slants.is_empty()
    }

    /// Whether a point lies in the region.
    pub(super) fn contains(&self, point: DVec3) -> bool {
        self.slants.iter().all(|(cut, is_greater)| (cut.height(point) >= 0.0) == *is_greater)
            && point.cmpge(self.bounds.min.as_dvec3()).all()
            && point.cmple(self.bounds.max.as_dvec3()).all()
    }

    /// A point inside. Of a degenerate region, the middle of its box.
    pub(super) fn middle(&self) -> DVec3 {
        self.extent().map_or(self.bounds.centre().as_dvec3(), |(_, inside)| inside)
    }

    /// The parts on the lesser and on the greater side of a plane.
    pub(super) fn halves(&self, cut: &SplitPlane) -> [Self; 2] {
        [false, true].map(|is_greater| {
            let mut half = self.clone();
            match *cut {
                SplitPlane::Axial { axis, at } if is_greater => half.bounds.min[axis] = at,
                SplitPlane::Axial { axis, at } => half.bounds.max[axis] = at,
                SplitPlane::Plane { .. } => half.slants.push((*cut, is_greater)),
            }
            half
        })
    }

    /// The section of the region with a plane: a convex polygon, or nothing.
    pub(super) fn section(&self, cut: &SplitPlane) -> Vec<DVec3> {
        let mut polygon = match *cut {
            SplitPlane::Axial { axis, at } => rectangle(&self.bounds, axis, at),
            SplitPlane::Plane { .. } => {
                let mut whole = square(cut, &self.bounds);
                for axis in 0..3 {
                    let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
                    whole = part(&whole, &SplitPlane::Axial { axis, at: min }, true);
                    whole = part(&whole, &SplitPlane::Axial { axis, at: max }, false);
                }
                whole
            }
        };
        // A section that lies in a side of the region is not cut by that side.
        for (slant, is_greater) in self.slants.iter().filter(|(slant, _)| slant != cut) {
            polygon = part(&polygon, slant, *is_greater);
        }
        polygon
    }

    /// The smallest box around the region, and a point inside. None when the region is degenerate.
    pub(super) fn extent(&self) -> Option<(Aabb, DVec3)> {
        if self.is_box() {
            let has_volume = self.bounds.size().cmpgt(glam::Vec3::ZERO).all();
            return has_volume.then(|| (self.bounds, self.bounds.centre().as_dvec3()));
        }
        let sides = (0..3).flat_map(|axis| {
            [self.bounds.min[axis], self.bounds.max[axis]].map(|at| SplitPlane::Axial { axis, at })
        });
        let mut corners: Vec<DVec3> = Vec::new();
        for side in sides.chain(self.slants.iter().map(|(cut, _)| *cut)) {
            corners.extend(self.section(&side));
        }
        if corners.len() < 4 {
            return None;
        }
        let (min, max) = corners
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), &c| (a.min(c), b.max(c)));
        let bounds = Aabb::new(min.as_vec3(), max.as_vec3()).intersection(&self.bounds);
        let inside = corners.iter().sum::<DVec3>() / corners.len() as f64;
        ((max - min).min_element() > DEGENERATE_M && !bounds.is_empty()).then_some((bounds, inside))
    }

    /// The region with its box shrunk to what the cutting planes leave.
    pub(super) fn tightened(mut self) -> Self {
        if !self.is_box()
            && let Some((bounds, _)) = self.extent()
        {
            self.bounds = bounds;
        }
        self
    }
}

/// The section of a box perpendicular to an axis.
fn rectangle(bounds: &Aabb, axis: usize, at: f32) -> Vec<DVec3> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let corner = |a: f64, b: f64| {
        let mut corner = DVec3::splat(f64::from(at));
        (corner[u], corner[v]) = (a, b);
        corner
    };
    vec![
        corner(min[u], min[v]),
        corner(max[u], min[v]),
        corner(max[u], max[v]),
        corner(min[u], max[v]),
    ]
}

/// A square on a plane that contains the section of the plane with a box.
fn square(cut: &SplitPlane, bounds: &Aabb) -> Vec<DVec3> {
    let centre = bounds.centre().as_dvec3();
    let normal = cut.normal();
    let centre = centre - normal * cut.height(centre);
    let reach = f64::from(bounds.size().length()) + 1.0;
    let (u, v) = normal.any_orthonormal_pair();
    let (u, v) = (u * reach, v * reach);
    vec![centre - u - v, centre + u - v, centre + u + v, centre - u + v]
}

/// The part of a convex polygon on one side of a plane, boundary included. Empty when it is
/// degenerate.
pub(super) fn part(polygon: &[DVec3], cut: &SplitPlane, is_greater: bool) -> Vec<DVec3> {
    let sign = if is_greater { 1.0 } else { -1.0 };
    let height = |p: DVec3| cut.height(p) * sign;
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    let mut deepest = f64::NEG_INFINITY;
    for (i, &here) in polygon.iter().enumerate() {
        let next = polygon[(i + 1) % polygon.len()];
        let (a, b) = (height(here), height(next));
        deepest = deepest.max(a);
        if a >= 0.0 {
            kept.push(here);
        }
        if a * b < 0.0 {
            let mut crossing = here.lerp(next, a / (a - b));
            if let SplitPlane::Axial { axis, at } = *cut {
                crossing[axis] = f64::from(at);
            }
            kept.push(crossing);
        }
    }
    if deepest <= DEGENERATE_M || kept.len() < 3 { Vec::new() } else { kept }
}

/// On which sides of a plane a polygon has parts farther than [`ON_PLANE_F32_M`] from it.
pub(super) fn sides(polygon: &[DVec3], cut: &SplitPlane) -> [bool; 2] {
    polygon.iter().fold([false; 2], |[low, high], &corner| {
        let height = cut.height(corner);
        [low || height < -ON_PLANE_F32_M, high || height > ON_PLANE_F32_M]
    })
}

/// The area of a convex polygon, in square metres.
pub(super) fn area(polygon: &[DVec3]) -> f64 {
    let fan = |i: usize| (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]);
    (1..polygon.len().saturating_sub(1)).map(fan).sum::<DVec3>().length() * 0.5
}
