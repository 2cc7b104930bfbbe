//! The building, drawn on the CPU from its octree: nodes are projected front to back, never rays.
//!
//! [`Renderer::draw`] takes an [`Octree`] and a [`Camera`] and fills a [`Frame`] with colours and
//! depths. The picture is cut into bands of rows that are drawn on all cores, each with a
//! mask buffer of one bit a pixel: a pixel is written once, and a node whose pixels are all covered
//! is dropped with everything below it. Because the eye's place tells the order of a node's
//! octants, what comes first is in front.
//!
//! [`movers`] and [`avatars`] draw doors and figures into a frame, where its depths let them be seen;
//! [`text`] writes on it; [`rooms`] draws what an author declared.
//!
//! A pixel takes the first node that the ray through its centre meets: a voxel, or an inner node
//! that is smaller than a pixel, with the mean looks of what is inside. So surfaces have neither
//! holes nor seams at any distance.

pub mod avatars;
mod band;
mod brick;
mod form;
mod hull;
mod layer;
mod lines;
mod mask;
pub mod mover_visibility;
pub mod movers;
pub mod moving;
pub mod node_visibility;
mod orthogonal;
mod panes;
mod pyramid;
pub mod rooms;
mod shade;
pub mod text;
mod traversal;
mod view;

use std::sync::Arc;

use glam::Vec3;
use pulp::WithSimd;
use rayon::prelude::*;
use sightline_world::{
    motion::Pose,
    octree::{MATERIALS_MAX, Octree},
};

use self::{
    band::Band,
    mask::BLOCK,
    node_visibility::NodeVisibility,
    panes::Panes,
    shade::Rows,
    traversal::{NodeClasses, Traversal, TraversalStacks},
    view::View,
};

/// Rows that are drawn together: whole blocks.
const BAND: usize = 136;

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

    /// How many pixels a length of a metre spans at a distance of a metre, in a picture of so many rows.
    pub fn focal(&self, height: usize) -> f32 {
        height as f32 * 0.5 / (self.fov_y * 0.5).clamp(0.01, 1.5).tan()
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
    /// Metres along the line of sight's share in the camera's direction; infinite in the sky. What is drawn into a picture
    /// of the building makes it nearer, never farther.
    pub depth: Vec<f32>,
    /// The index in [`Octree::materials`] of what is seen, glass aside; of no meaning in the sky.
    pub material_ids: Vec<u16>,
    /// For each block of pixels, row by row from the top: none of its depths is greater.
    farthest: Vec<f32>,
    /// The glass in front.
    panes: Panes,
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
            self.material_ids = vec![u16::MAX; width * height];
            self.farthest = vec![f32::INFINITY; width.div_ceil(BLOCK) * height.div_ceil(BLOCK)];
            self.panes = Panes::default();
        }
    }

    /// The surface normal of what a pixel shows, outwards; zero in the sky and where there is none.
    /// The octree must be the one that was drawn.
    pub fn normal(&self, pixel: usize, octree: &Octree) -> Vec3 {
        let seen = self.depth[pixel].is_finite();
        let look = octree.materials.get(usize::from(self.material_ids[pixel])).filter(|_| seen);
        look.map_or(Vec3::ZERO, |look| Vec3::from(look.normal.map(f32::from)) / 127.0)
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Takes the mean colours of a picture twice as wide and high, and of the rest each nearest of four.
    fn take_means(&mut self, fine: &mut Self) {
        self.panes = Panes { finer: true, ..std::mem::take(&mut fine.panes) };
        let (width, fine) = (self.width, &*fine);
        let [across, fine_across] = [width, fine.width].map(|side| side.div_ceil(BLOCK));
        self.farthest.fill(0.0);
        for (row, blocks) in fine.farthest.chunks(fine_across.max(1)).enumerate() {
            for (column, farthest) in blocks.iter().enumerate() {
                let most = &mut self.farthest[row / 2 * across + column / 2];
                *most = farthest.max(*most);
            }
        }
        let rows = self.colour.par_chunks_mut(width.max(1));
        let rows = rows.zip(self.depth.par_chunks_mut(width.max(1)));
        let rows = rows.zip(self.material_ids.par_chunks_mut(width.max(1))).enumerate();
        rows.for_each(|(y, ((colour, depth), material_ids))| {
            for x in 0..width {
                let corner = 2 * y * fine.width + 2 * x;
                let four = [0, 1, fine.width, fine.width + 1].map(|step| corner + step);
                let channel = |shift: u32| {
                    let sum: u32 = four.iter().map(|&i| fine.colour[i] >> shift & 0xff).sum();
                    ((sum + 2) / 4) << shift
                };
                let nearer = |a: usize, b: usize| if fine.depth[b] < fine.depth[a] { b } else { a };
                let nearest = four.into_iter().fold(corner, nearer);
                colour[x] = channel(0) | channel(8) | channel(16);
                (depth[x], material_ids[x]) = (fine.depth[nearest], fine.material_ids[nearest]);
            }
        });
    }
}

/// How nodes are projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Mode {
    /// Each for itself, all the way down.
    Perspective,
    /// By form patterns, once perspective inside of a node is too small to see.
    #[default]
    Orthogonal,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 2] = [Self::Perspective, Self::Orthogonal];
}

/// What a picture took.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counters {
    /// Nodes projected from space to the picture.
    pub projections: u64,
    /// Nodes looked at.
    pub nodes: u64,
    /// Nodes tested against the mask buffer.
    pub mask_tests: u64,
    /// Pixels written.
    pub pixels: u64,
}

impl Counters {
    fn add(&mut self, other: &Self) {
        self.projections += other.projections;
        self.nodes += other.nodes;
        self.mask_tests += other.mask_tests;
        self.pixels += other.pixels;
    }
}

/// Draws frames, and keeps its buffers from one to the next.
#[derive(Default)]
pub struct Renderer {
    /// How nodes are projected.
    pub mode: Mode,
    /// Smooth edges: each pixel is the mean of 2 × 2, which takes more than twice as long. A picture with a
    /// side of more than half of [`SIDE_MAX`] stays as it is.
    pub antialias: bool,
    /// What is left out of pictures from a box of eyes, or is not tested, if the eye is in it. The picture is the same. It
    /// is to be made for the octree that is drawn.
    pub node_visibility: Option<Arc<NodeVisibility>>,
    /// Forgoes what only newer processors can do; the picture is the same.
    portable: bool,
    fine: Frame,
    counters: Counters,
    /// For each of [`Octree::materials`], and black for all other indices.
    colours: Vec<u32>,
    bands: Vec<(Band, TraversalStacks, Counters)>,
}

impl Renderer {
    /// Draws what the camera sees, on all threads of the current rayon pool. However many they
    /// are, the picture is the same.
    pub fn draw(&mut self, octree: &Octree, camera: &Camera, frame: &mut Frame) {
        if self.antialias && frame.width.max(frame.height) <= SIDE_MAX / 2 {
            let mut fine = std::mem::take(&mut self.fine);
            fine.resize(frame.width * 2, frame.height * 2);
            self.draw_plain(octree, camera, &mut fine);
            frame.take_means(&mut fine);
            self.fine = fine;
        } else {
            self.draw_plain(octree, camera, frame);
        }
    }

    fn draw_plain(&mut self, octree: &Octree, camera: &Camera, frame: &mut Frame) {
        let (width, height) = (frame.width, frame.height);
        self.counters = Counters::default();
        if width == 0 || height == 0 {
            return;
        }
        self.colours.clear();
        self.colours.extend(octree.materials.iter().map(shade::surface));
        self.colours.resize(MATERIALS_MAX, 0);
        let (colours, mode, view) = (&self.colours, self.mode, View::new(camera, width, height));
        let glass_from = octree.first_glass();
        let hidden = self.node_visibility.as_deref();
        let known = hidden.and_then(|hidden| hidden.known(octree, camera.eye, view.focal()));
        let known = known.unwrap_or(NodeClasses::NOTHING);
        let (processor, portable) = (pulp::Arch::new(), self.portable);
        self.bands.resize_with(height.div_ceil(BAND), Default::default);
        let rows = frame.colour.par_chunks_mut(BAND * width);
        let rows = rows.zip(frame.depth.par_chunks_mut(BAND * width));
        let rows = rows.zip(frame.material_ids.par_chunks_mut(BAND * width));
        let blocks = BAND / BLOCK * width.div_ceil(BLOCK);
        let rows = rows.zip(frame.farthest.par_chunks_mut(blocks));
        frame.panes.finer = false;
        frame.panes.bands.resize_with(self.bands.len(), Default::default);
        let rows = rows.zip(&mut frame.panes.bands);
        let bands = self.bands.par_iter_mut().zip(rows).enumerate();
        bands.for_each(
            |(
                i,
                ((band, walker, counters), ((((colour, depth), material_ids), farthest), panes)),
            )| {
                let view = view.band(i * BAND, octree);
                *counters = Counters::default();
                band.clear(width, BAND.min(height - i * BAND));
                let rows = Rows { colour, depth, material_ids, farthest, panes };
                let walk = Traversal {
                    octree,
                    view: &view,
                    mode,
                    known,
                    glass_from,
                    band,
                    walker,
                    counters,
                };
                let drawing = Drawing { walk, colours, rows };
                if portable {
                    drawing.with_simd(pulp::Scalar);
                } else {
                    processor.dispatch(drawing);
                }
                counters.pixels = band.pixels;
            },
        );
        self.bands.iter().for_each(|(_, _, counters)| self.counters.add(counters));
    }

    /// What the last picture took.
    pub fn counters(&self) -> Counters {
        self.counters
    }
}

/// The work on a band. A function that is compiled for each kind of processor takes no closure, so
/// that all of it is.
struct Drawing<'a> {
    walk: Traversal<'a>,
    colours: &'a [u32],
    rows: Rows<'a>,
}

impl WithSimd for Drawing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        self.walk.run();
        shade::band(self.walk.band, self.walk.view, self.colours, &mut self.rows);
    }
}

#[cfg(test)]
mod tests;
