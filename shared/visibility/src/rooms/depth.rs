//! Rooms from near to far, and which of them nearer rooms hide (Menon and Rossignac 1999, FIG. 7,
//! steps 703 and 705).
//!
//! A room hides another room from an eye on three conditions:
//!
//! * It is opaque, and the eye is not in it.
//! * One of its convex pieces stands between the eye and every corner of the box around the other
//!   room.
//! * None of its windows that face the eye lets a line from the eye pass to that box.
//!
//! Then every sight line to the other room has to pass through a wall of the nearer one. A room
//! that is hidden only in part is kept as a whole.

use glam::{DVec3, Vec3};
use sightline_world::{
    geometry::Aabb,
    rooms::{RoomId, Rooms},
    tolerance::ON_PLANE_F64_M,
};

use super::{
    index::RoomIndex,
    sight::{RoomWindows, Viewpoint},
};

/// A room and its distance from an eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomAtDepth {
    /// The room.
    pub room: RoomId,
    /// The distance from the eye to the nearest point of the room, in metres; 0 if the eye is in
    /// it.
    pub distance_m: f32,
    /// The nearest room that hides all of this one, if any does.
    pub hidden_by: Option<RoomId>,
}

/// All rooms, nearest first, as seen from an eye in the world's axes.
pub fn depth_order(rooms: &Rooms, index: &RoomIndex, eye: Vec3) -> Vec<RoomAtDepth> {
    let own = index.axes.own(eye);
    let distance = |id: RoomId| {
        let near = index.pieces(id).iter().map(|piece| {
            let inside = if piece.contains(own) {
                own
            } else {
                own.clamp(piece.bounds.min, piece.bounds.max)
            };
            inside.distance(own)
        });
        near.fold(f32::INFINITY, f32::min)
    };
    let ids = (0..index.len() as u16).map(RoomId);
    let mut found: Vec<RoomAtDepth> =
        ids.map(|room| RoomAtDepth { room, distance_m: distance(room), hidden_by: None }).collect();
    found.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.room.cmp(&b.room)));
    let opaque: Vec<Option<OpaqueRoom>> =
        found.iter().map(|at| OpaqueRoom::new(rooms, index, at.room, own)).collect();
    for at in 0..found.len() {
        let hides = |nearer: &&OpaqueRoom| nearer.hides(own, &index.bounds(found[at].room));
        let nearer = opaque[..at].iter().flatten();
        found[at].hidden_by =
            nearer.filter(|_| found[at].distance_m > 0.0).find(hides).map(|b| b.room);
    }
    found
}

/// An opaque room that does not hold the eye.
struct OpaqueRoom<'a> {
    room: RoomId,
    index: &'a RoomIndex,
    /// Its windows, as seen by somebody who looks into the room.
    inward: RoomWindows,
}

impl<'a> OpaqueRoom<'a> {
    fn new(rooms: &Rooms, index: &'a RoomIndex, room: RoomId, eye: Vec3) -> Option<Self> {
        let pieces = index.pieces(room);
        let is_outside = pieces.iter().all(|piece| !piece.contains(eye));
        let described = rooms.get(room).filter(|room| room.opaque && is_outside)?;
        Some(Self { room, index, inward: RoomWindows::inward(described, pieces, &index.axes) })
    }

    /// Whether the room hides everything in a box from an eye.
    fn hides(&self, eye: Vec3, other: &Aabb) -> bool {
        let corners = other.corners();
        let shades = |corner: &Vec3| {
            let [from, to] = [eye, *corner].map(|at| at.as_dvec3());
            // A corner in the piece is not hidden, and neither is one whose line only touches it.
            move |span: [f64; 2]| {
                (span[1] - span[0]) * DVec3::distance(from, to) > ON_PLANE_F64_M && span[1] < 1.0
            }
        };
        let between = self.index.pieces(self.room).iter().any(|piece| {
            corners.iter().all(|corner| {
                let span = piece.span(eye.as_dvec3(), corner.as_dvec3());
                span.is_some_and(shades(corner))
            })
        });
        between && !self.inward.seen(&Viewpoint::all_round(Aabb::new(eye, eye))).meets(other)
    }
}
