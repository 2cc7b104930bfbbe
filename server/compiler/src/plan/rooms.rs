//! Rooms and windows on a plan: where the level cut meets them, and their names.

use glam::{Vec2, Vec3};
use sightline_picture::Picture;
use sightline_visibility::rooms::pieces::ConvexPiece;
use sightline_world::{
    geometry::Axes,
    rooms::{Room, RoomId},
};

use super::sheet::Level;
use crate::drawing::{INK, line, mixed, write_sized};

/// A window is drawn when part of it lies between these heights above the floor, in metres.
const WINDOWS_M: [f32; 2] = [0.2, 2.2];
/// An outline with the room on both sides, this far beside it in metres, lies between two pieces of
/// the room and is not drawn.
const BESIDE_M: f32 = 0.01;
/// The distance between the lines of a window's hatching, in pixels.
const HATCH_PX: f32 = 5.0;

/// Draws every room that the cut meets.
pub(super) fn draw(level: &Level<'_>, picture: &mut Picture) {
    let rooms = level.sheet.world.rooms.list();
    for (room, id) in rooms.iter().zip((0u16..).map(RoomId)) {
        let colour = mixed(id.colour(), INK, 0.25);
        let pieces: Vec<ConvexPiece> =
            room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, &Axes::WORLD)).collect();
        let cut = level.height();
        let met: Vec<&ConvexPiece> =
            pieces.iter().filter(|p| p.bounds.min.y <= cut && cut < p.bounds.max.y).collect();
        for [from, to] in met.iter().flat_map(|piece| section(piece, cut)) {
            let across = Vec3::Y.cross(to - from).normalize_or_zero() * BESIDE_M;
            let middle = from.midpoint(to);
            let is_in = |at: Vec3| pieces.iter().any(|piece| piece.contains(at));
            if !(is_in(middle + across) && is_in(middle - across)) {
                thick(picture, level.place(from), level.place(to), colour);
            }
        }
        if !met.is_empty() {
            windows(level, room, colour, picture);
        }
        let size = |piece: &&&ConvexPiece| piece.bounds.size().x * piece.bounds.size().z;
        if let Some(widest) = met.iter().max_by(|a, b| size(a).total_cmp(&size(b))) {
            name(level, room.title(), widest, picture);
        }
    }
}

/// The segments in which a level plane meets the faces of a piece.
fn section(piece: &ConvexPiece, height: f32) -> impl Iterator<Item = [Vec3; 2]> {
    piece.faces.iter().filter_map(move |face| {
        let edges = face.iter().zip(face.iter().cycle().skip(1));
        let mut ends = edges.filter_map(|(a, b)| {
            let crosses = (a.y < height) != (b.y < height);
            crosses.then(|| a.lerp(*b, (height - a.y) / (b.y - a.y)))
        });
        Some([ends.next()?, ends.next()?])
    })
}

/// Draws windows as hatched strips along the walls.
fn windows(level: &Level<'_>, room: &Room, colour: [u8; 3], picture: &mut Picture) {
    let [low, high] = WINDOWS_M.map(|above| level.feet + above);
    for window in &room.windows {
        let heights = || window.corners.iter().map(|at| at.y);
        let (from, to) = (heights().fold(f32::MAX, f32::min), heights().fold(f32::MIN, f32::max));
        // Seen from above, a level window would cover what is below it.
        let is_here = from < high && to > low && to - from > 0.05;
        let Some(first) = window.corners.first().filter(|_| is_here) else { continue };
        let flat = |at: &Vec3| Vec2::new(at.x, at.z);
        let far = |from: &Vec3| {
            let away = |at: &&Vec3| flat(at).distance(flat(from));
            *window.corners.iter().max_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(first)
        };
        let from = far(first);
        let (from, to) = (level.place(from), level.place(far(&from)));
        let along = (to - from).normalize_or_zero();
        let across = along.perp() * 3.0;
        for side in [across, -across] {
            line(picture, from + side, to + side, colour);
        }
        let steps = ((to - from).length() / HATCH_PX) as u32;
        for step in 0..=steps {
            let at = from + along * (step as f32 * HATCH_PX);
            line(picture, at - across, (at + along * HATCH_PX) + across, colour);
            line(picture, at + across, (at + along * HATCH_PX) - across, colour);
        }
    }
}

/// Writes the name of a room into its widest piece, as far as it fits.
fn name(level: &Level<'_>, title: &str, widest: &ConvexPiece, picture: &mut Picture) {
    let bounds = &widest.bounds;
    let (from, to) = (level.place(bounds.min), level.place(bounds.max));
    let letters = (((to.x - from.x).max(24.0) - 4.0) / 8.0) as usize;
    let shown: String = title.chars().take(letters).collect();
    let left = (from.x + to.x) * 0.5 - shown.chars().count() as f32 * 4.0;
    let top = (from.y + to.y) * 0.5 - 4.0;
    write_sized(picture, [left as i32, top as i32], 1, &shown, INK);
}

/// Draws a line three pixels wide.
pub(super) fn thick(picture: &mut Picture, from: Vec2, to: Vec2, colour: [u8; 3]) {
    let across = (to - from).perp().normalize_or_zero();
    for side in [0.0, 1.0, -1.0] {
        line(picture, from + across * side, to + across * side, colour);
    }
}
