//! Box visibility: whether every line from one box to another is blocked.
//!
//! The boxes hold the eyes of a viewer and the body of an avatar, each wherever it can be within a
//! horizon. They are given in the building's own axes
//! ([`Cells::axes`](sightline_world::Cells::axes)), as regions and cells are.
//!
//! **One occluder.** Let `C` be convex. For a fixed eye `e`, the points `b` for which the segment
//! from `e` to `b` meets `C` form a convex set: `C` and what lies behind it. For a fixed `b` the
//! same holds of `e`. So if all segments from corner to corner meet `C`, all segments from a corner
//! to any point of the other box do, and then all segments between the boxes do.
//!
//! **Several occluders.** If no single occluder blocks all lines, the wider box is halved and each
//! half is tried again. This ends when each pair of boxes has an occluder of its own, or when some
//! line meets no occluder. A pair of boxes on both sides of a seam between two occluders is never
//! blocked by one of them, however narrow it is. So occluders have to overlap. They are made as
//! large as possible, whatever polygons the building came in:
//!
//! * Boxes in the solid part of the building (`solid_occluders`). Where there is no cell, nobody
//!   can be, and something opaque stands between a point in a cell and a point in none. So a line
//!   that passes through such a box is blocked if one of its ends is in a cell. Each box grows as
//!   far as there is no cell.
//! * The brushes of a Quake map that are not boxes.
//! * Rectangles in flat surfaces that are not the faces of a solid (`surface_occluders`).
//!
//! All occluders are set back by a fifth of a millimetre, so that rounding never blocks a line that
//! slips along an edge. The answer "hidden" therefore means: no line is free that begins where an
//! eye can be. Between two points inside one wall a line may be free, but nobody is there to look.
//!
//! **Portal flood.** Before occluders are tried, a flood through gates finds out whether lines can
//! get from the spaces of one box to the spaces of the other at all (`portal_flood`).
//!
//! **Budget.** Half of the questions take a few hundred units of about ten nanoseconds. Questions
//! that a few thousand units do not decide are narrow: doors in line, or lines that slip along
//! edges.

mod bvh;
mod convex_occluder;
mod occluders;
mod portal_flood;
mod search;
mod sight_line;
mod solid_occluders;
mod surface_occluders;

pub use occluders::Occluders;
pub use search::BoxScratch;
pub use sight_line::{BoxInSpaces, BoxVisibility, SightLine};
