//! Rooms from near to far, and which of them nearer ones hide.
//!
//! The criterion: a room hides another from an eye when it is opaque and does not hold the eye; one of its
//! convex pieces stands between the eye and every corner of the box around the other; and none of
//! its windows that face the eye lets a line from the eye through to that box. Then every line of sight to the
//! other room would have to go through the walls of the nearer one, so that what is dropped was hidden.
//! A room that is hidden only in part is kept as a whole.

use glam::{DVec3, Vec3};

use super::{
    RoomIndex,
    sight::{RoomWindows, Viewpoint},
};
use sightline_world::{
    geometry::Aabb,
    rooms::{RoomId, Rooms},
    tolerance::ON_PLANE_F64_M,
};

/// A room as an eye finds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomAtDepth {
    /// Which.
    pub room: RoomId,
    /// From the eye to what is nearest of it, in metres; 0 for rooms that the eye is in.
    pub distance_m: f32,
    /// The nearest room that hides all of it.
    pub hidden_by: Option<RoomId>,
}

/// All rooms, nearest first, as an eye in the world finds them.
pub fn depth_order(rooms: &Rooms, index: &RoomIndex, eye: Vec3) -> Vec<RoomAtDepth> {
    let own = index.axes().own(eye);
    let away = |id: RoomId| {
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
        ids.map(|room| RoomAtDepth { room, distance_m: away(room), hidden_by: None }).collect();
    found.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.room.cmp(&b.room)));
    let blinds: Vec<Option<OpaqueRoom>> =
        found.iter().map(|at| OpaqueRoom::new(rooms, index, at.room, own)).collect();
    for at in 0..found.len() {
        let hides = |blind: &&OpaqueRoom| blind.hides(own, &index.bounds(found[at].room));
        let nearer = blinds[..at].iter().flatten();
        found[at].hidden_by =
            nearer.filter(|_| found[at].distance_m > 0.0).find(hides).map(|b| b.room);
    }
    found
}

/// An opaque room that an eye is not in.
struct OpaqueRoom<'a> {
    room: RoomId,
    index: &'a RoomIndex,
    /// Its windows, as one looks into it.
    inward: RoomWindows,
}

impl<'a> OpaqueRoom<'a> {
    fn new(rooms: &Rooms, index: &'a RoomIndex, room: RoomId, eye: Vec3) -> Option<Self> {
        let pieces = index.pieces(room);
        let is_outside = pieces.iter().all(|piece| !piece.contains(eye));
        let described = rooms.get(room).filter(|room| room.opaque && is_outside)?;
        Some(Self { room, index, inward: RoomWindows::inward(described, pieces, index.axes()) })
    }

    fn hides(&self, eye: Vec3, other: &Aabb) -> bool {
        let corners = other.corners();
        let shades = |corner: &Vec3| {
            let [from, to] = [eye, *corner].map(|at| at.as_dvec3());
            // What is inside of the piece, or only touched by the line, does not hide.
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
