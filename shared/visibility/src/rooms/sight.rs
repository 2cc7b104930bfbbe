//! What an eye, or a box of eyes, sees through the windows of a room it is in.
//!
//! Through an edge of a window and an eye goes a plane; what is seen through a convex window is beyond
//! the window and on the inner side of all these planes. For a box of eyes each edge's plane is that
//! of the corner of the box that looks furthest past the edge: around what any eye sees
//! (*outer*), or that of the corner that looks least: what all eyes see (*inner*). A field of view cuts
//! the window first, so that only the part of it counts that is in the picture.
//!
//! # Rooms that are not convex
//!
//! Their windows make a tree (Fig. 9 of the paper). What is seen through a window of its first level is
//! outside of the room; where one sees, beyond it, a window of the second level from outside, one looks
//! into the room again, and no longer at what is outside; through one of the third one looks out
//! again. So at each level what children show is taken away from what their parent shows: outer regions
//! at odd levels, inner ones at even, so that what is left is never too small. The paper goes on with the
//! nearest window of each level alone; here all that are in view are, nearest first, which
//! shows more and never less.

use glam::{DVec3, Vec3};

use super::{
    pieces::{ConvexPiece, convex_polygons, normal},
    region::{BooleanRegion, Containment, HalfSpace},
};
use sightline_world::{
    geometry::{Aabb, Axes, Frustum},
    rooms::Room,
    tolerance::ROOM_BOUNDARY_M,
};

/// On which side of a window the room is, is tried so far from it, in metres …
const BESIDE_M: [f32; 3] = [0.02, 0.1, 0.3];

/// Where eyes are and what they take in, in own axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    /// A box of eyes; a point is one too.
    pub eyes: Aabb,
    /// Out of the sides of the field of view; nothing when that is all round.
    outwards: Vec<DVec3>,
}

impl Viewpoint {
    /// Eyes that look all round.
    pub fn all_round(eyes: Aabb) -> Self {
        Self { eyes, outwards: Vec::new() }
    }

    /// Eyes that see what is in a field of view, which is in the world's axes.
    pub fn looking(eyes: Aabb, field: &Frustum, axes: &Axes) -> Self {
        Self { eyes, outwards: field.outwards().iter().map(|side| axes.own_exact(*side)).collect() }
    }

    /// What is in the field of view of any of the eyes.
    pub fn field(&self) -> impl Iterator<Item = HalfSpace> + '_ {
        self.outwards.iter().map(|normal| {
            let most = self.eyes.corners().into_iter().map(|eye| normal.dot(eye.as_dvec3()));
            HalfSpace { normal: *normal, distance: most.fold(f64::NEG_INFINITY, f64::max) }
        })
    }
}

/// The windows of a room, in own axes.
#[derive(Clone, Debug, Default)]
pub struct RoomWindows {
    panes: Vec<WindowPart>,
}

/// A convex part of a window.
#[derive(Clone, Debug)]
struct WindowPart {
    /// Index of the window in [`Room::windows`].
    window: u32,
    /// Panes one level further down.
    children: Vec<usize>,
    is_first: bool,
    /// In order around it, counter-clockwise as seen from where one looks to.
    corners: Vec<DVec3>,
    /// Along the look; none when it is not known on which side the room is.
    normal: Option<DVec3>,
}

/// Which planes to take of a box of eyes.
#[derive(Clone, Copy, PartialEq)]
enum EyeBound {
    Outer,
    Inner,
}

impl RoomWindows {
    /// The windows of a room that consists of some pieces, as one looks out.
    pub fn new(room: &Room, pieces: &[ConvexPiece], axes: &Axes) -> Self {
        Self::looking(room, pieces, axes, true)
    }

    /// The same as one looks in; all are of the first level.
    pub fn inward(room: &Room, pieces: &[ConvexPiece], axes: &Axes) -> Self {
        let mut panes = Self::looking(room, pieces, axes, false);
        for pane in &mut panes.panes {
            pane.is_first = true;
            pane.children.clear();
        }
        panes
    }

    fn looking(room: &Room, pieces: &[ConvexPiece], axes: &Axes, outwards: bool) -> Self {
        let mut panes: Vec<WindowPart> = Vec::new();
        for (window, at) in room.windows.iter().zip(0u32..) {
            let own: Vec<Vec3> = window.corners.iter().map(|corner| axes.own(*corner)).collect();
            let parents = |panes: &[WindowPart]| -> Vec<usize> {
                let of = |(_, pane): &(usize, &WindowPart)| Some(pane.window) == window.behind;
                panes.iter().enumerate().filter(of).map(|(at, _)| at).collect()
            };
            let is_inward = !outwards || level(room, at).is_multiple_of(2);
            for part in convex_polygons(&own) {
                let outward = outward(&part, pieces);
                let normal = outward.map(|out| if is_inward { -out } else { out });
                let mut corners = part;
                if normal.zip(self::normal(&corners)).is_some_and(|(a, b)| a.dot(b) < 0.0) {
                    corners.reverse();
                }
                let (place, parents) = (panes.len(), parents(&panes));
                parents.into_iter().for_each(|parent| panes[parent].children.push(place));
                let is_first = window.behind.is_none();
                panes.push(WindowPart {
                    window: at,
                    children: Vec::new(),
                    is_first,
                    corners,
                    normal,
                });
            }
        }
        Self { panes }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.panes.is_empty()
    }

    /// Whether some eye that looks all round may see, through the windows, some of a box of what is
    /// outside: never wrongly denied.
    pub fn show(&self, eyes: &Aabb, body: &Aabb) -> bool {
        let first = (0..self.panes.len()).filter(|at| self.panes[*at].is_first);
        first.into_iter().any(|at| self.pane_shows(at, eyes, body))
    }

    fn pane_shows(&self, at: usize, eyes: &Aabb, body: &Aabb) -> bool {
        let pane = &self.panes[at];
        pane.side(eyes, body, EyeBound::Outer) != Containment::Outside
            && !pane.children.iter().any(|child| {
                let child = &self.panes[*child];
                child.side(eyes, body, EyeBound::Inner) == Containment::Inside
                    && !child.children.iter().any(|out| self.pane_shows(*out, eyes, body))
            })
    }

    /// What is seen through the windows: around all that any of the eyes sees.
    pub fn seen(&self, viewpoint: &Viewpoint) -> BooleanRegion {
        let first = self.in_order(viewpoint, 0..self.panes.len());
        let first = first.into_iter().filter(|at| self.panes[*at].is_first);
        let parts: Vec<BooleanRegion> =
            first.filter_map(|at| self.seen_through(at, viewpoint)).collect();
        if parts.is_empty() { BooleanRegion::NOWHERE } else { BooleanRegion::Any(parts) }
    }

    /// The windows of the first level that are in the field of view, nearest first: indices into
    /// [`Room::windows`].
    pub fn in_view(&self, viewpoint: &Viewpoint) -> Vec<u32> {
        let all = self.in_order(viewpoint, 0..self.panes.len());
        let seen = |at: &usize| {
            let pane = &self.panes[*at];
            pane.is_first && pane.planes(viewpoint, EyeBound::Outer).is_some()
        };
        let mut windows: Vec<u32> = Vec::new();
        for window in all.into_iter().filter(seen).map(|at| self.panes[at].window) {
            if !windows.contains(&window) {
                windows.push(window);
            }
        }
        windows
    }

    fn seen_through(&self, at: usize, viewpoint: &Viewpoint) -> Option<BooleanRegion> {
        let pane = &self.panes[at];
        let mut parts = match pane.planes(viewpoint, EyeBound::Outer)? {
            BooleanRegion::All(parts) => parts,
            other => vec![other],
        };
        let children = self.in_order(viewpoint, pane.children.iter().copied());
        for child in children {
            let Some(inner) = self.panes[child].planes(viewpoint, EyeBound::Inner) else {
                continue;
            };
            let out = self.in_order(viewpoint, self.panes[child].children.iter().copied());
            let out: Vec<_> =
                out.into_iter().filter_map(|out| self.seen_through(out, viewpoint)).collect();
            let mut hidden = vec![inner];
            if !out.is_empty() {
                hidden.push(BooleanRegion::Not(Box::new(BooleanRegion::Any(out))));
            }
            parts.push(BooleanRegion::Not(Box::new(BooleanRegion::All(hidden))));
        }
        Some(BooleanRegion::All(parts))
    }

    /// Panes from the nearest to the furthest.
    fn in_order(&self, viewpoint: &Viewpoint, panes: impl Iterator<Item = usize>) -> Vec<usize> {
        let eye = viewpoint.eyes.centre().as_dvec3();
        let away = |at: &usize| {
            let pane = &self.panes[*at];
            let bounds = Aabb::from_points(pane.corners.iter().map(|at| at.as_vec3()));
            let near = eye.as_vec3().clamp(bounds.min, bounds.max);
            near.as_dvec3().distance_squared(eye)
        };
        let mut panes: Vec<usize> = panes.collect();
        panes.sort_by(|a, b| away(a).total_cmp(&away(b)).then(a.cmp(b)));
        panes
    }
}

impl WindowPart {
    /// Where a box is, of what is seen through it.
    fn side(&self, eyes: &Aabb, body: &Aabb, bound: EyeBound) -> Containment {
        let Some(normal) = self.normal else { return unknown(bound) };
        let beyond = beyond(normal, self.corners[0]);
        let where_eyes = touching(&beyond, eyes);
        // From beyond one does not look through it in this direction.
        if where_eyes == Containment::Inside {
            return Containment::Outside;
        }
        let mut all = beyond.moved(slack(bound)).side(body);
        if where_eyes == Containment::Partial {
            // Some eye is at the window or beyond it: where it looks is not bounded by its edges.
            return if bound == EyeBound::Inner { Containment::Outside } else { all };
        }
        for edge in self.edges() {
            if all == Containment::Outside {
                break;
            }
            match edge.plane(normal, eyes, bound).side(body) {
                Containment::Outside => all = Containment::Outside,
                Containment::Partial => all = Containment::Partial,
                Containment::Inside => (),
            }
        }
        all
    }

    /// The same as a region; none when nothing is seen through it.
    fn planes(&self, viewpoint: &Viewpoint, bound: EyeBound) -> Option<BooleanRegion> {
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
        // Only the part of it that is in the field of view.
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

/// An edge of a pane, its inside on the left as seen from where one looks to.
struct WindowEdge {
    from: DVec3,
    along: DVec3,
}

impl WindowEdge {
    /// The plane through it and the eye that looks furthest past it, or least. All eyes are on the
    /// near side of the pane.
    fn plane(&self, normal: DVec3, eyes: &Aabb, bound: EyeBound) -> HalfSpace {
        // Away from the inside of the pane, in its plane.
        let out = self.along.cross(normal).normalize_or_zero();
        // How far a line of sight gets out for each metre that it gets on.
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

/// What is not known is seen by some, and not by all.
fn unknown(bound: EyeBound) -> Containment {
    if bound == EyeBound::Outer { Containment::Partial } else { Containment::Outside }
}

fn slack(bound: EyeBound) -> f64 {
    let slack = f64::from(ROOM_BOUNDARY_M);
    if bound == EyeBound::Outer { slack } else { -slack }
}

/// What lies beyond a plane that one looks through along a normal.
fn beyond(normal: DVec3, at: DVec3) -> HalfSpace {
    HalfSpace { normal: -normal, distance: -normal.dot(at) }
}

/// Whether eyes are beyond: those that rounding may have put there count as at the plane.
fn touching(beyond: &HalfSpace, eyes: &Aabb) -> Containment {
    let slack = f64::from(ROOM_BOUNDARY_M);
    match [beyond.moved(slack).side(eyes), beyond.moved(-slack).side(eyes)] {
        [Containment::Outside, _] => Containment::Outside,
        [_, Containment::Inside] => Containment::Inside,
        _ => Containment::Partial,
    }
}

/// The part of a convex polygon that is on the inner side of some planes.
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

/// At which level of the tree a window is, from 1.
fn level(room: &Room, window: u32) -> u32 {
    let mut level = 1;
    let mut at = window;
    // Each is behind one before it, so that this ends.
    while let Some(behind) = room.windows.get(at as usize).and_then(|window| window.behind) {
        level += 1;
        at = behind;
    }
    level
}

/// The normal of a pane that points out of the room; none when the room is on both sides, or on none.
fn outward(corners: &[DVec3], pieces: &[ConvexPiece]) -> Option<DVec3> {
    let normal = normal(corners)?;
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    BESIDE_M.into_iter().find_map(|beside| {
        let is_in = |sign: f64| {
            let at = (centre + normal * (sign * f64::from(beside))).as_vec3();
            pieces.iter().any(|piece| piece.contains(at))
        };
        match [is_in(1.0), is_in(-1.0)] {
            [false, true] => Some(normal),
            [true, false] => Some(-normal),
            _ => None,
        }
    })
}
