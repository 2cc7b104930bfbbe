//! A building as it comes in: the one form that every importer makes and the compiler takes.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use sightline_shared::{geometry::Aabb, motion::Body, world::Spawn};

/// Triangles to draw, surfaces that block sight, and places to stand. In metres, y up.
#[derive(Clone, Debug)]
pub struct Model {
    /// What it is called.
    pub title: String,
    /// What is drawn and bumped into.
    pub surfaces: Vec<Surface>,
    /// What blocks sight: opaque triangles, in no order. Every one is kept for the oracle; which
    /// of them make cells is the compiler's choice.
    pub opaque: Vec<[Vec3; 3]>,
    /// Where avatars can begin; the compiler finds a place when there is none.
    pub spawns: Vec<Spawn>,
    /// The shape of every body.
    pub body: Body,
    /// No avatar moves faster, in metres a second.
    pub speed_max: f32,
    /// What was skipped, a line each.
    pub warnings: Vec<String>,
}

impl Model {
    /// The smallest box around all that is drawn or blocks sight; none when there is nothing.
    pub fn bounds(&self) -> Option<Aabb> {
        let drawn = self.surfaces.iter().flat_map(|surface| {
            surface.triangles.iter().flatten().map(|&i| surface.positions[i as usize])
        });
        let bounds = Aabb::from_points(drawn.chain(self.opaque.as_flattened().iter().copied()));
        (!bounds.is_empty()).then_some(bounds)
    }
}

/// Triangles that share a material.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Vertices, in metres.
    pub positions: Vec<Vec3>,
    /// Texture coordinates, one for each vertex; empty when there is no texture.
    pub uvs: Vec<Vec2>,
    /// sRGB colour for each vertex, multiplied with the material's; empty when there is none.
    pub colours: Vec<[u8; 3]>,
    /// Three indices for each triangle; all are within `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// How it looks.
    pub material: Material,
}

impl Surface {
    /// The corners of each triangle, in metres.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        (0..self.triangles.len()).filter_map(|triangle| self.corners_of(triangle))
    }

    /// The corners of one triangle, in metres; `None` when there is none or an index is wrong.
    pub fn corners_of(&self, triangle: usize) -> Option<[Vec3; 3]> {
        let [a, b, c] = self.triangles.get(triangle)?.map(|i| self.positions.get(i as usize));
        Some([*a?, *b?, *c?])
    }
}

/// How a surface looks.
#[derive(Clone, Debug)]
pub struct Material {
    /// sRGB.
    pub colour: [u8; 3],
    /// sRGB, multiplied with the colour; coordinates repeat.
    pub texture: Option<Arc<image::RgbImage>>,
    /// Lets sight through: drawn as glass.
    pub glass: bool,
}
