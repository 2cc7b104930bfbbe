//! A convex part of a window, and what eyes see through it.

use glam::{DVec3, Vec3};
use sightline_world::{geometry::Aabb, tolerance::ROOM_BOUNDARY_M};

use super::{region::BooleanRegion, viewpoint::Viewpoint};
use crate::{Containment, HalfSpace};

/// A convex part of a window.
#[derive(Clone, Debug)]
pub(super) struct WindowPart {
    /// Index of the window in [`Room::windows`](sightline_world::rooms::Room::windows).
    pub window: u32,
    /// The parts of windows one level below.
    pub children: Vec<usize>,
    /// Whether the window is of level 1.
    pub is_first: bool,
    /// The corners in order, counter-clockwise as seen from beyond.
    pub corners: Vec<DVec3>,
    /// The direction of sight. None if it is unknown on which side of the window the room is.
    pub normal: Option<DVec3>,
}

/// Which planes to take for a box of eyes.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum EyeBound {
    /// Planes around everything that any eye sees.
    Outer,
    /// Planes around what all eyes see.
    Inner,
}

impl WindowPart {
    /// Where a box lies relative to what is seen through the window.
    pub fn containment(&self, eyes: &Aabb, body: &Aabb, bound: EyeBound) -> Containment {
        let Some(normal) = self.normal else { return unknown(bound) };
        let beyond = beyond(normal, self.corners[0]);
        let where_eyes = touching(&beyond, eyes);
        // Eyes beyond the window do not look through it in this direction.
        if where_eyes == Containment::Inside {
            return Containment::Outside;
        }
        let mut all = beyond.moved(slack(bound)).containment(body);
        if where_eyes == Containment::Partial {
            // Some eye is at the window or beyond it. The edges do not bound what it sees.
            return if bound == EyeBound::Inner { Containment::Outside } else { all };
        }
        for edge in self.edges() {
            if all == Containment::Outside {
                break;
            }
            match edge.plane(normal, eyes, bound).containment(body) {
                Containment::Outside => all = Containment::Outside,
                Containment::Partial => all = Containment::Partial,
                Containment::Inside => (),
            }
        }
        all
    }

    /// What is seen through the window, as a region. None if nothing is.
    pub fn planes(&self, viewpoint: &Viewpoint, bound: EyeBound) -> Option<BooleanRegion> {
        let eyes = &viewpoint.eyes;
        let Some(normal) = self.normal else {
            return (bound == EyeBound::Outer).then_some(BooleanRegion::EVERYWHERE);
        };
        let beyond = beyond(normal, self.corners[0]);
        let where_eyes = touching(&beyond, eyes);
        if where_eyes == Containment::Inside
            || (where_eyes == Containment::Partial && bound == EyeBound::Inner)
        {
            return None;
        }
        let mut planes = vec![beyond.moved(slack(bound))];
        if where_eyes == Containment::Partial {
            planes.extend(viewpoint.field());
            return Some(BooleanRegion::within(planes));
        }
        // Only the part of the window that is in the field of view counts.
        let cut = match bound {
            EyeBound::Outer => {
                Self { corners: clipped(&self.corners, viewpoint.field()), ..self.clone() }
            }
            EyeBound::Inner => self.clone(),
        };
        if cut.corners.len() < 3 {
            return None;
        }
        planes.extend(cut.edges().map(|edge| edge.plane(normal, eyes, bound)));
        if bound == EyeBound::Outer {
            planes.extend(viewpoint.field());
        }
        Some(BooleanRegion::within(planes))
    }

    fn edges(&self) -> impl Iterator<Item = WindowEdge> + '_ {
        let ends = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        ends.map(|(from, to)| WindowEdge { from: *from, along: *to - *from })
    }
}

/// An edge of a window part. The inside is on its left, as seen from beyond.
struct WindowEdge {
    from: DVec3,
    along: DVec3,
}

impl WindowEdge {
    /// The plane through the edge and the eye that looks furthest past it (outer), or least
    /// (inner). All eyes are on the near side of the window.
    fn plane(&self, normal: DVec3, eyes: &Aabb, bound: EyeBound) -> HalfSpace {
        // In the plane of the window, away from its inside.
        let out = self.along.cross(normal).normalize_or_zero();
        // How far a sight line moves outwards for each metre along the normal.
        let slope = |eye: Vec3| {
            let eye = eye.as_dvec3() - self.from;
            out.dot(eye) / normal.dot(eye)
        };
        let slopes = eyes.corners().map(slope);
        let slope = match bound {
            EyeBound::Outer => slopes.into_iter().fold(f64::NEG_INFINITY, f64::max),
            EyeBound::Inner => slopes.into_iter().fold(f64::INFINITY, f64::min),
        };
        let side = out - normal * slope;
        let side = side.normalize();
        HalfSpace { normal: side, distance: side.dot(self.from) + slack(bound) }
    }
}

/// The answer when it is unknown what is seen: some eyes may see it, and not all do.
fn unknown(bound: EyeBound) -> Containment {
    if bound == EyeBound::Outer { Containment::Partial } else { Containment::Outside }
}

/// How far planes are moved outwards to allow for rounding, in metres.
fn slack(bound: EyeBound) -> f64 {
    let slack = f64::from(ROOM_BOUNDARY_M);
    if bound == EyeBound::Outer { slack } else { -slack }
}

/// The half-space beyond a plane through a point, seen along the plane's normal.
fn beyond(normal: DVec3, at: DVec3) -> HalfSpace {
    HalfSpace { normal: -normal, distance: -normal.dot(at) }
}

/// Where eyes lie relative to what is beyond a window. Eyes that only rounding may have put on one
/// side count as at the window.
fn touching(beyond: &HalfSpace, eyes: &Aabb) -> Containment {
    let slack = f64::from(ROOM_BOUNDARY_M);
    match [beyond.moved(slack).containment(eyes), beyond.moved(-slack).containment(eyes)] {
        [Containment::Outside, _] => Containment::Outside,
        [_, Containment::Inside] => Containment::Inside,
        _ => Containment::Partial,
    }
}

/// The part of a convex polygon that is in all of some half-spaces.
fn clipped(corners: &[DVec3], planes: impl Iterator<Item = HalfSpace>) -> Vec<DVec3> {
    let mut ring = corners.to_vec();
    for plane in planes {
        let plane = plane.moved(ROOM_BOUNDARY_M.into());
        let ahead = |at: &DVec3| plane.normal.dot(*at) - plane.distance;
        let mut kept = Vec::with_capacity(ring.len() + 1);
        for (from, to) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            let (a, b) = (ahead(from), ahead(to));
            if a <= 0.0 {
                kept.push(*from);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                kept.push(from.lerp(*to, a / (a - b)));
            }
        }
        ring = kept;
    }
    ring
}
