//! A building as it comes in: the one form that every importer makes and the compiler takes.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use sightline_world::{Mover, Origin, Spawn, geometry::Aabb, motion::Body};

use crate::rooms::RoomDeclaration;

/// Triangles to draw, surfaces that block sight, and places to stand. In metres, y up.
#[derive(Clone, Debug)]
pub struct Model {
    /// What it is called.
    pub title: String,
    /// What is drawn and bumped into.
    pub surfaces: Vec<Surface>,
    /// Whether the light is in the surfaces' colours already.
    pub is_lit: bool,
    /// What blocks sight: opaque triangles, in no order. Every one is kept for the oracle; which
    /// of them make cells is the compiler's choice.
    pub opaque: Vec<[Vec3; 3]>,
    /// What is opaque all through, its faces among `opaque`; empty when the source knows of
    /// surfaces only.
    pub solids: Vec<ConvexSolid>,
    /// What moves by itself. None of it is among the above.
    pub movers: Vec<Mover>,
    /// Rooms, as named nodes or a file beside the model declare them.
    pub rooms: Vec<RoomDeclaration>,
    /// Named nodes that do not move, each with the box around its triangles: what sets can name.
    pub nodes: Vec<(String, Aabb)>,
    /// Where avatars can begin; the compiler finds a place when there is none.
    pub spawns: Vec<Spawn>,
    /// Other places where things are that avatars get to, such as the ends of teleporters: what is solid all
    /// through does not hold them.
    pub places: Vec<Vec3>,
    /// The shape of every body.
    pub body: Body,
    /// No avatar moves faster, in metres a second.
    pub speed_max: f32,
    /// What the source says of itself, to verify the compiled world against.
    pub origin: Option<Origin>,
    /// What was skipped, a line each.
    pub warnings: Vec<String>,
}

impl Model {
    /// The smallest box around all that is drawn or blocks sight; none when there is nothing.
    pub fn bounds(&self) -> Option<Aabb> {
        let bounds = Aabb::from_points(self.points());
        (!bounds.is_empty()).then_some(bounds)
    }

    /// All corners of what is drawn or blocks sight, in metres.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        let drawn = self.surfaces.iter().flat_map(|surface| {
            surface.triangles.iter().flatten().map(|&i| surface.positions[i as usize])
        });
        drawn.chain(self.opaque.as_flattened().iter().copied())
    }
}

/// A convex solid: what lies behind all of its faces.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexSolid {
    /// In no order.
    pub faces: Vec<ConvexFace>,
}

impl ConvexSolid {
    /// The smallest box around it.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_points(self.faces.iter().flat_map(|face| face.corners.iter().copied()))
    }

    /// Whether a point is inside, or outside by no more than `tolerance`, in metres.
    pub fn contains(&self, point: DVec3, tolerance: f64) -> bool {
        self.faces.iter().all(|face| face.normal.dot(point) <= face.distance + tolerance)
    }
}

/// A side of a convex solid.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexFace {
    /// Outwards, of unit length.
    pub normal: DVec3,
    /// From the origin to its plane along the normal, in metres.
    pub distance: f64,
    /// A convex polygon, in metres.
    pub corners: Vec<Vec3>,
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
    pub material: SurfaceMaterial,
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
pub struct SurfaceMaterial {
    /// sRGB.
    pub colour: [u8; 3],
    /// sRGB, multiplied with the colour; coordinates repeat.
    pub texture: Option<Arc<image::RgbImage>>,
    /// Lets sight through: drawn as glass.
    pub glass: bool,
}
