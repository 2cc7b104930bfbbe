//! What can be seen from where, in a building of cells and gates. Without I/O and without a clock.
//!
//! | question | module | principal types |
//! | --- | --- | --- |
//! | What can be seen from a box, through gates? | [`portal_flow`] | [`Sightlines`](portal_flow::Sightlines), [`Query`](portal_flow::Query) |
//! | Is every line between two boxes blocked? | [`box_visibility`] | [`Occluders`](box_visibility::Occluders), [`BoxVisibility`](box_visibility::BoxVisibility) |
//! | What do all eyes in a box miss, or see? | [`fuzzy`] | [`FuzzyBuffer`](fuzzy::FuzzyBuffer), [`Surfaces`](fuzzy::Surfaces) |
//! | Who may see whom by an author's rooms? | [`rooms`] | [`RoomIndex`](rooms::RoomIndex), [`RoomOverlap`](rooms::RoomOverlap) |
//!
//! The compiler makes the potentially visible set (PVS) of each cell by portal flow. The engine
//! then asks about two regions: the eyes of a viewer and the body of an avatar. Where their cells
//! may see each other, box visibility decides whether the two boxes really do, and rooms may still
//! rule the pair out. The fuzzy buffer finds what a client need not draw from a box of eyes.
//!
//! Every answer errs on one side only: what is reported hidden is hidden from every eye in the box.
//! All of them take boxes in the building's own axes
//! ([`Cells::axes`](sightline_world::Cells::axes)) unless they say otherwise.
//!
//! # Example
//!
//! Two rooms with a door at one end of the wall between them. Somebody can see from some place of
//! one room into the other, so the PVS lets the rooms see each other. But from the middle of one
//! room, the wall hides the middle of the other.
//!
//! ```
//! use glam::Vec3;
//! use sightline_visibility::{
//!     box_visibility::{BoxScratch, BoxVisibility, Occluders},
//!     portal_flow::{FlowScratch, Sightlines},
//! };
//! use sightline_world::geometry::Aabb;
//!
//! let world = sightline_fixtures::two_rooms::world();
//! let eyes = Aabb::around(Vec3::new(3.0, 1.6, 4.5), 0.1);
//!
//! // By cells: what the box of eyes may see through the door.
//! let lines = Sightlines::new(&world.cells);
//! let seen = lines.visible_from(&mut FlowScratch::default(), &eyes, None);
//! assert!(seen.contains(0) && seen.contains(1));
//!
//! // By occluders: whether anything blocks all lines to somebody in the other room.
//! let occluders = Occluders::new(&world);
//! let mut scratch = BoxScratch::default();
//! let mut ask = |body| occluders.between(&mut scratch, &eyes, &body, &mut 2_000);
//! let hidden = Aabb::around(Vec3::new(9.0, 1.0, 4.5), 0.3);
//! assert_eq!(ask(hidden), BoxVisibility::Hidden);
//! let near_the_door = Aabb::around(Vec3::new(6.5, 1.0, 0.5), 0.3);
//! assert!(matches!(ask(near_the_door), BoxVisibility::Visible(_)));
//! ```

pub mod box_visibility;
pub mod fuzzy;
mod half_space;
pub mod portal_flow;
pub mod rooms;
pub mod streaming;

pub use half_space::{Containment, HalfSpace};
