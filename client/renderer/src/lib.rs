//! Draws a building on the CPU from its voxel octree, and what moves in it.
//!
//! * [`Renderer::draw`] takes an octree and a [`Camera`] and fills a [`Frame`]: the colour, the
//!   depth and the material of each pixel.
//! * [`movers`] and [`avatars`] draw doors and figures over the building, where its depths let them
//!   be seen. [`moving::MovingRenderer`] draws both at a cost that follows what is in view.
//! * [`node_visibility`] finds in advance which nodes a viewpoint box cannot see.
//! * [`Renderer::building_sight`] leaves out what rooms do not show to the eye.
//! * [`streaming`] finds which parts of an octree that still arrives a picture shows.
//! * [`mover_visibility`] finds which movers may be visible, [`rooms`] draws what an author
//!   declared, [`plan`] finds the plan of a storey, and [`text`] writes on a frame.
//!
//! Octree nodes are projected front to back; no rays are cast. The picture is cut into bands of
//! rows, and each band has a mask buffer of one bit for each pixel. A pixel is written once. A node
//! whose pixels are all covered is dropped with everything below it. A pixel takes the first node
//! that the line of sight through its centre meets: a voxel, or an inner node smaller than a pixel,
//! with the mean material of its contents. So surfaces have neither holes nor seams at any distance
//! (Dell 2012).
//!
//! The crate opens no files and reads no clock. Without the feature `threads` it needs no threads
//! either, as in a browser.
//!
//! # Example
//!
//! ```
//! use glam::Vec3;
//! use sightline_renderer::{Camera, Frame, Renderer};
//! use sightline_world::octree::{Octree, Voxel};
//!
//! // One red voxel of 25 cm in a cube of 2 m, at the origin.
//! let red = Voxel { key: 0, colour: [200, 0, 0], ..Voxel::default() };
//! let octree = Octree::from_voxels(Vec3::ZERO, 0.25, 3, vec![red])?;
//! let camera = Camera::looking_at(Vec3::new(0.125, 0.125, 3.0), Vec3::splat(0.125));
//!
//! let mut frame = Frame::new(65, 49);
//! Renderer::default().draw(&octree, &camera, &mut frame);
//!
//! let middle = 24 * frame.width() + 32;
//! assert!((frame.depth[middle] - 2.875).abs() < 1e-4);
//! let [_, red, green, _] = frame.colour[middle].to_be_bytes();
//! assert!(red > 150 && green < 20);
//! assert!(frame.depth[0].is_infinite(), "the corner shows the sky");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod avatars;
mod band;
mod brick;
mod camera;
mod colour;
mod form;
mod frame;
mod hull;
mod layer;
mod lines;
mod margins;
mod mask;
pub mod mover_visibility;
pub mod movers;
pub mod moving;
pub mod node_visibility;
mod orthogonal;
mod panes;
mod parallel;
pub mod plan;
mod pyramid;
mod ratio;
mod renderer;
pub mod rooms;
mod shade;
pub mod streaming;
pub mod text;
mod traversal;
mod view;
mod ways;

pub use self::{
    camera::Camera,
    frame::{Frame, SIDE_MAX},
    renderer::Renderer,
    traversal::{Counters, Mode},
};

#[cfg(test)]
mod tests;
