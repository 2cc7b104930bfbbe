//! What a plan shows over the building.

use glam::{Vec2, Vec3};
use roaring::RoaringBitmap;
use sightline_picture::Picture;

use crate::{
    drawing::{INK, line, ring, write_sized},
    verdict::WallMark,
};

/// An avatar on a plan.
#[derive(Clone, Debug)]
pub struct Mark {
    /// The eye, in metres.
    pub eye: Vec3,
    /// The direction of sight; not drawn when absent.
    pub forward: Option<Vec3>,
    /// The colour, in sRGB.
    pub colour: [u8; 3],
    /// Whether the mark is a disc; otherwise it is a ring.
    pub filled: bool,
    /// A number to write beside the mark.
    pub number: Option<usize>,
}

/// What a plan shows over the building.
#[derive(Clone, Debug, Default)]
pub struct Overlay {
    /// The avatars.
    pub marks: Vec<Mark>,
    /// The cells that stay bright, while others are dimmed. When absent, all are bright.
    pub visible: Option<RoaringBitmap>,
    /// Whether to draw the outlines of cells, and the portals that the cut meets.
    pub cells: bool,
    /// Whether to draw the declared rooms, with their windows and names.
    pub rooms: bool,
    /// Whether to draw a grid of coordinates: x to the right and z downwards, in metres.
    pub grid: bool,
    /// Whether to draw a second picture of each storey: how much of the building each cell may see.
    pub density: bool,
    /// Walls, green where they hide people and red where they hide nobody.
    pub walls: Vec<WallMark>,
    /// The names of the marks. When given, a legend below the storeys explains marks and colours.
    pub legend: Option<Vec<(&'static str, Mark)>>,
}

/// Draws a mark about a point, in pixels.
pub(super) fn draw_mark(picture: &mut Picture, centre: Vec2, radius: f32, mark: &Mark) {
    let (edge, fill) = if mark.filled { (INK, Some(mark.colour)) } else { (mark.colour, None) };
    ring(picture, centre, radius, edge, fill);
    if let Some(forward) = mark.forward {
        let along = Vec2::new(forward.x, forward.z).normalize_or_zero();
        line(picture, centre + along * radius, centre + along * radius * 3.0, mark.colour);
    }
    if let Some(number) = mark.number {
        let beside = [(centre.x + radius + 2.0) as i32, (centre.y - radius - 6.0) as i32];
        write_sized(picture, beside, 1, &number.to_string(), mark.colour);
    }
}
