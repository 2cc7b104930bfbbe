//! What an eye, or a box of eyes, sees through the windows of a room it is in.
//!
//! A plane goes through each edge of a window and an eye. Through a convex window, the eye sees
//! what lies beyond the window and on the inner side of all these planes. For a box of eyes, each
//! edge has two planes:
//!
//! * The *outer* plane goes through the corner of the box from which the eye looks furthest past
//!   the edge. Everything that any eye sees is inside all outer planes.
//! * The *inner* plane goes through the corner from which it looks least past the edge. Everything
//!   inside all inner planes is seen by all eyes.
//!
//! A field of view cuts the window first, so that only the part of it in the picture counts.
//!
//! # Rooms that are not convex
//!
//! Their windows form a tree (Menon and Rossignac 1999, FIG. 9):
//!
//! * Through a window of level 1 an eye sees what is outside the room.
//! * Where it then sees a window of level 2 from outside, it looks into the room again, and no
//!   longer at what is outside.
//! * Through a window of level 3 behind that, it looks out once more.
//!
//! So what the children of a window show is taken away from what the window shows, level by level.
//! The region of a window of odd level is outer and that of even level is inner, so that what is
//! left is never too small. The source goes on with the nearest window of each level alone. Here
//! all windows in view count, which shows more and never less.

use glam::{DVec3, Vec3};
use sightline_world::{
    geometry::{Aabb, Axes},
    rooms::Room,
};

use super::{
    pieces::{ConvexPiece, convex_polygons, normal},
    region::BooleanRegion,
    window_part::{EyeBound, WindowPart},
};
use crate::Containment;

pub use super::viewpoint::Viewpoint;

/// The distances from a window, in metres, at which its two sides are tested for the room. Authors
/// draw windows some way off the wall.
const BESIDE_WINDOW_M: [f32; 3] = [0.02, 0.1, 0.3];

/// The windows of a room, in own axes, as convex parts.
#[derive(Clone, Debug, Default)]
pub struct RoomWindows {
    parts: Vec<WindowPart>,
}

/// Whether somebody looks out of a room or into it.
#[derive(Clone, Copy, PartialEq)]
enum Direction {
    Outwards,
    Inwards,
}

impl RoomWindows {
    /// The windows of a room that consists of some pieces, as seen by somebody who looks out.
    pub fn new(room: &Room, pieces: &[ConvexPiece], axes: &Axes) -> Self {
        Self::in_direction(room, pieces, axes, Direction::Outwards)
    }

    /// The windows of a room, as seen by somebody who looks in. All are of level 1.
    pub fn inward(room: &Room, pieces: &[ConvexPiece], axes: &Axes) -> Self {
        let mut parts = Self::in_direction(room, pieces, axes, Direction::Inwards);
        for part in &mut parts.parts {
            part.is_first = true;
            part.children.clear();
        }
        parts
    }

    fn in_direction(
        room: &Room,
        pieces: &[ConvexPiece],
        axes: &Axes,
        direction: Direction,
    ) -> Self {
        let mut parts: Vec<WindowPart> = Vec::new();
        for (window, at) in room.windows.iter().zip(0u32..) {
            let own: Vec<Vec3> = window.corners.iter().map(|corner| axes.own(*corner)).collect();
            let parents = |parts: &[WindowPart]| -> Vec<usize> {
                let of = |(_, part): &(usize, &WindowPart)| Some(part.window) == window.behind;
                parts.iter().enumerate().filter(of).map(|(at, _)| at).collect()
            };
            let is_inward = direction == Direction::Inwards || level(room, at).is_multiple_of(2);
            for part in convex_polygons(&own) {
                let outward = outward(&part, pieces);
                let normal = outward.map(|out| if is_inward { -out } else { out });
                let mut corners = part;
                if normal.zip(self::normal(&corners)).is_some_and(|(a, b)| a.dot(b) < 0.0) {
                    corners.reverse();
                }
                let (place, parents) = (parts.len(), parents(&parts));
                parents.into_iter().for_each(|parent| parts[parent].children.push(place));
                let is_first = window.behind.is_none();
                parts.push(WindowPart {
                    window: at,
                    children: Vec::new(),
                    is_first,
                    corners,
                    normal,
                });
            }
        }
        Self { parts }
    }

    /// Whether the room has no windows.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// Whether some eye that looks all round may see some of a box outside through the windows:
    /// may be wrongly true, never wrongly false.
    pub fn show(&self, eyes: &Aabb, body: &Aabb) -> bool {
        let first = (0..self.parts.len()).filter(|at| self.parts[*at].is_first);
        first.into_iter().any(|at| self.part_shows(at, eyes, body))
    }

    /// Whether a part of an odd level, with the levels behind it, shows some of a box.
    fn part_shows(&self, at: usize, eyes: &Aabb, body: &Aabb) -> bool {
        let part = &self.parts[at];
        part.containment(eyes, body, EyeBound::Outer) != Containment::Outside
            && !part.children.iter().any(|child| {
                let child = &self.parts[*child];
                child.containment(eyes, body, EyeBound::Inner) == Containment::Inside
                    && !child.children.iter().any(|out| self.part_shows(*out, eyes, body))
            })
    }

    /// What is seen through the windows. The region holds everything that any of the eyes sees.
    pub fn seen(&self, viewpoint: &Viewpoint) -> BooleanRegion {
        let first = self.in_order(viewpoint, 0..self.parts.len());
        let first = first.into_iter().filter(|at| self.parts[*at].is_first);
        let parts: Vec<BooleanRegion> =
            first.filter_map(|at| self.seen_through(at, viewpoint)).collect();
        if parts.is_empty() { BooleanRegion::NOWHERE } else { BooleanRegion::Any(parts) }
    }

    /// The windows of level 1 that are in the field of view, nearest first, as indices into
    /// [`Room::windows`].
    pub fn in_view(&self, viewpoint: &Viewpoint) -> Vec<u32> {
        let all = self.in_order(viewpoint, 0..self.parts.len());
        let seen = |at: &usize| {
            let part = &self.parts[*at];
            part.is_first && part.planes(viewpoint, EyeBound::Outer).is_some()
        };
        let mut windows: Vec<u32> = Vec::new();
        for window in all.into_iter().filter(seen).map(|at| self.parts[at].window) {
            if !windows.contains(&window) {
                windows.push(window);
            }
        }
        windows
    }

    /// What is seen through a part of an odd level, with the levels behind it.
    fn seen_through(&self, at: usize, viewpoint: &Viewpoint) -> Option<BooleanRegion> {
        let part = &self.parts[at];
        let mut parts = match part.planes(viewpoint, EyeBound::Outer)? {
            BooleanRegion::All(parts) => parts,
            other => vec![other],
        };
        let children = self.in_order(viewpoint, part.children.iter().copied());
        for child in children {
            let Some(inner) = self.parts[child].planes(viewpoint, EyeBound::Inner) else {
                continue;
            };
            let out = self.in_order(viewpoint, self.parts[child].children.iter().copied());
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

    /// Sorts parts from the nearest to the furthest.
    fn in_order(&self, viewpoint: &Viewpoint, parts: impl Iterator<Item = usize>) -> Vec<usize> {
        let eye = viewpoint.eyes.centre().as_dvec3();
        let distance_squared = |at: &usize| {
            let part = &self.parts[*at];
            let bounds = Aabb::from_points(part.corners.iter().map(|at| at.as_vec3()));
            let near = eye.as_vec3().clamp(bounds.min, bounds.max);
            near.as_dvec3().distance_squared(eye)
        };
        let mut parts: Vec<usize> = parts.collect();
        parts.sort_by(|a, b| distance_squared(a).total_cmp(&distance_squared(b)).then(a.cmp(b)));
        parts
    }
}

/// The level of a window in the tree of windows, from 1.
fn level(room: &Room, window: u32) -> u32 {
    let mut level = 1;
    let mut at = window;
    // A window comes after the one it is behind, so this ends.
    while let Some(behind) = room.windows.get(at as usize).and_then(|window| window.behind) {
        debug_assert!(behind < at, "a window comes after the one it is behind");
        level += 1;
        at = behind;
    }
    level
}

/// The unit normal of a polygon that points out of the room. None if the room is on both sides of
/// it, or on neither.
fn outward(corners: &[DVec3], pieces: &[ConvexPiece]) -> Option<DVec3> {
    let normal = normal(corners)?;
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    BESIDE_WINDOW_M.into_iter().find_map(|beside| {
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
