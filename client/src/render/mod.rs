//! The building, drawn on the CPU from its octree: nodes are projected front to back, never rays.
//!
//! [`Renderer::draw`] takes an [`Octree`] and a [`Camera`] and fills a [`Frame`] with colours and
//! depths. The picture is cut into tiles of 64 × 64 pixels that are drawn on all cores, each with a
//! mask buffer of one bit a pixel: a pixel is written once, and a node whose pixels are all covered
//! is dropped with everything below it. Because the eye's place tells the order of a node's
//! octants, what comes first is in front.
//!
//! [`movers`] and [`avatars`] draw doors and figures into a frame, where its depths let them be seen;
//! [`text`] writes on it.
//!
//! A pixel takes the first node that the ray through its centre meets: a voxel, or an inner node
//! that is smaller than a pixel, with the mean looks of what is inside. So surfaces have neither
//! holes nor seams at any distance.

pub mod avatars;
pub mod movers;
mod shade;
pub mod text;
mod tile;
mod view;

use glam::Vec3;
use rayon::prelude::*;
use sightline_shared::{motion::Pose, octree::Octree};

use self::{
    tile::{TILE, Tile},
    view::View,
};

/// No side of a frame is longer, in pixels: colours and depths then take 512 MiB.
pub const SIDE_MAX: usize = 8192;

/// From where, and how wide, the building is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye, in metres.
    pub eye: Vec3,
    /// As in [`Pose::yaw`].
    pub yaw: f32,
    /// As in [`Pose::pitch`].
    pub pitch: f32,
    /// The angle between the lowest and the highest line of sight, in radians.
    pub fov_y: f32,
}

impl Camera {
    /// What one sees without thinking about it: 65 degrees.
    pub const FOV_Y: f32 = 65.0 * std::f32::consts::PI / 180.0;

    /// The view from a pose.
    pub fn at(pose: &Pose) -> Self {
        Self { eye: pose.eye, yaw: pose.yaw, pitch: pose.pitch, fov_y: Self::FOV_Y }
    }

    /// The view from one point towards another.
    pub fn looking_at(eye: Vec3, target: Vec3) -> Self {
        let along = target - eye;
        let level = along.x.hypot(along.z);
        let yaw = if level > 0.0 { (-along.x).atan2(-along.z) } else { 0.0 };
        Self { eye, yaw, pitch: along.y.atan2(level), fov_y: Self::FOV_Y }
    }
}

/// A picture: colours, and how far away what they show is.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Frame {
    width: usize,
    height: usize,
    /// sRGB as 0x00RRGGBB, row by row from the top.
    pub colour: Vec<u32>,
    /// Metres along the line of sight's share in the camera's direction; infinite in the sky.
    pub depth: Vec<f32>,
}

impl Frame {
    /// A black picture; neither side is longer than [`SIDE_MAX`].
    pub fn new(width: usize, height: usize) -> Self {
        let mut frame = Self::default();
        frame.resize(width, height);
        frame
    }

    /// Changes the size; what it showed is lost when the size differs.
    pub fn resize(&mut self, width: usize, height: usize) {
        let (width, height) = (width.min(SIDE_MAX), height.min(SIDE_MAX));
        if (width, height) != (self.width, self.height) {
            (self.width, self.height) = (width, height);
            self.colour = vec![0; width * height];
            self.depth = vec![f32::INFINITY; width * height];
        }
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }
}

/// Draws frames, and keeps its buffers from one to the next.
#[derive(Default)]
pub struct Renderer {
    tiles: Vec<Tile>,
}

impl Renderer {
    /// Draws what the camera sees, on all threads of the current rayon pool. However many they
    /// are, the picture is the same.
    pub fn draw(&mut self, octree: &Octree, camera: &Camera, frame: &mut Frame) {
        let (width, height) = (frame.width, frame.height);
        if width == 0 || height == 0 {
            return;
        }
        let across = width.div_ceil(TILE);
        self.tiles.resize_with(across * height.div_ceil(TILE), Tile::default);
        let view = View::new(camera, width, height);
        self.tiles.par_iter_mut().enumerate().for_each(|(i, tile)| {
            let corner = [i % across * TILE, i / across * TILE];
            let size = [TILE.min(width - corner[0]), TILE.min(height - corner[1])];
            tile.draw(octree, &view.tile(corner, octree), size);
        });
        let bands = frame.colour.par_chunks_mut(TILE * width);
        let bands = bands.zip(frame.depth.par_chunks_mut(TILE * width));
        bands.zip(self.tiles.par_chunks(across)).for_each(|((colour, depth), tiles)| {
            for (tile, x) in tiles.iter().zip((0..width).step_by(TILE)) {
                let span = x..width.min(x + TILE);
                let rows = colour.chunks_mut(width).zip(depth.chunks_mut(width));
                for (y, (colour, depth)) in rows.enumerate() {
                    let row = y * TILE..y * TILE + span.len();
                    colour[span.clone()].copy_from_slice(&tile.colour[row.clone()]);
                    depth[span.clone()].copy_from_slice(&tile.depth[row]);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests;
