//! Rooms from near to far, and which of them nearer rooms hide (Menon and Rossignac 1999, FIG. 7,
//! steps 703 and 705).
//!
//! A room that is [opaque](sightline_world::rooms::Room::opaque) hides another one when it hides
//! all of the box around it. A room that is hidden only in part is kept as a whole.

use glam::Vec3;
use sightline_world::{geometry::Aabb, rooms::RoomId};

use super::index::RoomIndex;

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
pub fn depth_order(index: &RoomIndex, eye: Vec3) -> Vec<RoomAtDepth> {
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
    for at in 0..found.len() {
        let hides = |nearer: &&RoomAtDepth| {
            let opaque = index.room(nearer.room).opaque.as_ref();
            let bounds = index.bounds(found[at].room);
            opaque.is_some_and(|opaque| opaque.hides(&Aabb::new(own, own), &bounds))
        };
        found[at].hidden_by = found[..at].iter().find(hides).map(|nearer| nearer.room);
    }
    found
}
