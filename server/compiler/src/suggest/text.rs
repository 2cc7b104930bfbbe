//! Suggested rooms as TOML, in the world's axes.

use std::fmt::Write;

use glam::Vec3;
use sightline_world::{World, geometry::Aabb};

use super::room::SuggestedRoom;

const HEAD: &str = "\
# Rooms that the building suggests: their shapes, and their windows. From a room with windows, only the room
# itself and what lies behind its windows is visible. Rename the rooms, delete what is not a room, and add:
#
#   title = \"Board room\"        the name that people read
#   visible = { rooms = [], objects = [], cells = [] }    all that is visible from inside, besides windows; or
#   hidden = { rooms = [], objects = [], cells = [] }     all that is not; everything else may be visible
#   sealed = true               nobody inside is told of anybody outside, nor the other way round
#   opaque = true               hides what is behind it, except through its windows (no effect yet)
#   tag = \"...\"
#   capacity = 12, spawn = { eye = [x, y, z], yaw = degrees }    (no effect yet)
";

/// The TOML of all rooms.
pub(super) fn write(world: &World, rooms: &[SuggestedRoom]) -> String {
    let mut text = String::from(HEAD);
    let is_turned = world.cells.axes.turn() != 0.0;
    for room in rooms {
        let _ = writeln!(text, "\n[[room]]\nname = {:?}", room.name);
        match (&room.boxes[..], is_turned) {
            ([Aabb { min, max }], false) => {
                let _ = writeln!(text, "box = [{}, {}]", point(min), point(max));
            }
            (boxes, false) => {
                let boxes = boxes.iter().map(|Aabb { min, max }| list(&[*min, *max]));
                let _ = writeln!(text, "boxes = [{}]", boxes.collect::<Vec<_>>().join(", "));
            }
            (boxes, true) => {
                let world = |at: &Vec3| world.cells.axes.world(*at);
                let hulls =
                    boxes.iter().map(|region| list(&region.corners().each_ref().map(world)));
                let _ = writeln!(text, "hulls = [{}]", hulls.collect::<Vec<_>>().join(", "));
            }
        }
        for window in &room.windows {
            let polygon = list(&window.corners);
            let _ =
                writeln!(text, "[[room.window]]\nname = {:?}\npolygon = {polygon}", window.name);
        }
    }
    text
}

fn list(points: &[Vec3]) -> String {
    format!("[{}]", points.iter().map(point).collect::<Vec<_>>().join(", "))
}

/// A point, rounded to a hundredth of a millimetre: exact enough for walls to meet.
fn point(at: &Vec3) -> String {
    let number = |x: f32| {
        let rounded = (f64::from(x) * 1e5).round() / 1e5;
        // Adding zero removes the minus sign of zero.
        format!("{}", rounded + 0.0)
    };
    format!("[{}, {}, {}]", number(at.x), number(at.y), number(at.z))
}
