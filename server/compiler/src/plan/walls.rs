//! Walls on a plan, by whether they hide people.

use glam::Vec3;
use sightline_picture::Picture;

use super::{rooms::thick, sheet::Level};

/// A wall that hides people, in sRGB.
pub(super) const HIDES: [u8; 3] = [30, 150, 60];
/// A wall that hides nobody, in sRGB.
pub(super) const HIDES_NOBODY: [u8; 3] = [215, 45, 40];

/// Draws the walls that the cut meets. Those that hide people are drawn last: where both lie on one
/// another, people are hidden.
pub(super) fn draw(level: &Level<'_>, picture: &mut Picture) {
    for hides in [false, true] {
        let colour = if hides { HIDES } else { HIDES_NOBODY };
        let walls = level.sheet.overlay.walls.iter().filter(|wall| wall.hides == hides);
        for [from, to] in walls.filter_map(|wall| section(&wall.corners, level.height())) {
            thick(picture, level.place(from), level.place(to), colour);
        }
    }
}

/// The segment in which a level plane meets a triangle.
fn section(corners: &[Vec3; 3], height: f32) -> Option<[Vec3; 2]> {
    let edges = [0, 1, 2].map(|i| (corners[i], corners[(i + 1) % 3]));
    let mut ends = edges.iter().filter_map(|(a, b)| {
        let crosses = (a.y < height) != (b.y < height);
        crosses.then(|| a.lerp(*b, (height - a.y) / (b.y - a.y)))
    });
    Some([ends.next()?, ends.next()?])
}
