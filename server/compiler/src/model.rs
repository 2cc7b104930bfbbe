//! A building as it comes in: what every importer makes, and what the compiler takes.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use sightline_picture::Picture;
use sightline_world::{Mover, Origin, Spawn, geometry::Aabb, motion::Body};

use crate::rooms::RoomDeclaration;

/// The speed limit of people on foot, in metres per second.
const WALKING_SPEED_MAX: f32 = 4.0;

/// A building: triangles to draw, triangles that block sight, and spawn points. In metres, y up.
#[derive(Clone, Debug)]
pub struct Model {
    /// The title that people read.
    pub title: String,
    /// The surfaces that are drawn and that bodies bump into.
    pub surfaces: Vec<Surface>,
    /// Whether the colours of the surfaces already contain light.
    pub is_lit: bool,
    /// The opaque triangles, in no order: exactly what blocks sight. The oracle keeps all of them.
    /// The compiler chooses which of them make cells.
    pub opaque: Vec<[Vec3; 3]>,
    /// Convex opaque solids, whose faces are among `opaque`. Empty when the source has only
    /// surfaces.
    pub solids: Vec<ConvexSolid>,
    /// Whether the sun and the sky light the building.
    pub has_sky: bool,
    /// Lamps without a shape of their own. Surfaces may give light too.
    pub lamps: Vec<Lamp>,
    /// Objects that move by themselves. None of their triangles is among the above.
    pub movers: Vec<Mover>,
    /// Rooms, as named nodes or a file beside the model declare them.
    pub rooms: Vec<RoomDeclaration>,
    /// Named nodes that do not move, each with the box around its triangles. Rooms can name them.
    pub nodes: Vec<(String, Aabb)>,
    /// Where avatars begin. The compiler finds a place when there is none.
    pub spawns: Vec<Spawn>,
    /// Other points that avatars can get to, such as the ends of teleporters. No solid holds them.
    pub places: Vec<Vec3>,
    /// The shape of every body.
    pub body: Body,
    /// The speed limit of avatars, in metres per second.
    pub speed_max: f32,
    /// The subdivision and PVS that the source brings, to compare the compiled world with.
    pub origin: Option<Origin>,
    /// What the importer left out, one line each.
    pub warnings: Vec<String>,
}

impl Model {
    /// A model without triangles, for people, whose surfaces bring no light.
    pub fn empty(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            surfaces: Vec::new(),
            is_lit: false,
            opaque: Vec::new(),
            solids: Vec::new(),
            has_sky: true,
            lamps: Vec::new(),
            movers: Vec::new(),
            rooms: Vec::new(),
            nodes: Vec::new(),
            spawns: Vec::new(),
            places: Vec::new(),
            body: Body::PERSON,
            speed_max: WALKING_SPEED_MAX,
            origin: None,
            warnings: Vec::new(),
        }
    }

    /// A lit model of opaque triangles, all of one colour.
    pub fn of_triangles(title: impl Into<String>, opaque: Vec<[Vec3; 3]>, colour: [u8; 3]) -> Self {
        let surface = Surface::of_triangles(&opaque, SurfaceMaterial::opaque(colour));
        Self { surfaces: vec![surface], is_lit: true, opaque, ..Self::empty(title) }
    }

    /// Takes away the light that the colours of the surfaces contain, so that the compiler finds it
    /// anew. Quake maps keep light in the colours of vertices and nothing else.
    pub fn remove_light(&mut self) {
        if std::mem::take(&mut self.is_lit) {
            self.surfaces.iter_mut().for_each(|surface| surface.colours.clear());
        }
    }

    /// The smallest box around all triangles. None when there are none.
    pub fn bounds(&self) -> Option<Aabb> {
        let bounds = Aabb::from_points(self.points());
        (!bounds.is_empty()).then_some(bounds)
    }

    /// The corners of all triangles, in metres.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        let drawn = self.surfaces.iter().flat_map(|surface| {
            surface.triangles.iter().flatten().map(|&i| surface.positions[i as usize])
        });
        drawn.chain(self.opaque.as_flattened().iter().copied())
    }
}

/// A lamp that is a point, or so far away that its light is parallel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Where the light comes from.
    pub source: LampSource,
    /// The light in linear RGB: candela, or lux when it is parallel. Never negative.
    pub intensity: [f32; 3],
}

/// Where the light of a [`Lamp`] comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampSource {
    /// A point that shines all around, in metres.
    Point(Vec3),
    /// A point that shines into a cone.
    Spot {
        /// The point, in metres.
        at: Vec3,
        /// The direction of the cone's axis, of unit length.
        along: Vec3,
        /// The cosines of the angles from the axis at which light begins to fall, and at which it
        /// ends.
        cosines: [f32; 2],
    },
    /// Parallel light in this direction, of unit length.
    Parallel(Vec3),
}

/// A convex solid: the points behind all of its faces.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexSolid {
    /// The faces, in no order.
    pub faces: Vec<ConvexFace>,
}

impl ConvexSolid {
    /// The smallest box around the solid.
    pub fn bounds(&self) -> Aabb {
        Aabb::from_points(self.faces.iter().flat_map(|face| face.corners.iter().copied()))
    }

    /// Whether a point lies inside, or outside by at most `tolerance`, in metres.
    pub fn contains(&self, point: DVec3, tolerance: f64) -> bool {
        self.faces.iter().all(|face| face.normal.dot(point) <= face.distance + tolerance)
    }
}

/// A face of a convex solid.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexFace {
    /// The outward normal, of unit length.
    pub normal: DVec3,
    /// The distance of the plane from the origin along the normal, in metres.
    pub distance: f64,
    /// The corners of a convex polygon, in metres.
    pub corners: Vec<Vec3>,
}

/// Triangles that share a material.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The vertices, in metres.
    pub positions: Vec<Vec3>,
    /// Texture coordinates of each vertex. Empty when there is no texture.
    pub uvs: Vec<Vec2>,
    /// The sRGB colour of each vertex, to be multiplied with that of the material. Empty when all
    /// are white.
    pub colours: Vec<[u8; 3]>,
    /// Three indices into `positions` for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The material of all triangles.
    pub material: SurfaceMaterial,
}

impl Surface {
    /// Triangles without texture and colours of their own. No two share a vertex.
    pub fn of_triangles(triangles: &[[Vec3; 3]], material: SurfaceMaterial) -> Self {
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        Self {
            positions: triangles.as_flattened().to_vec(),
            uvs: Vec::new(),
            colours: Vec::new(),
            triangles: indices.collect(),
            material,
        }
    }

    /// The corners of each triangle, in metres.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        (0..self.triangles.len()).filter_map(|triangle| self.corners_of(triangle))
    }

    /// The corners of one triangle, in metres. `None` when there is no such triangle or vertex.
    pub fn corners_of(&self, triangle: usize) -> Option<[Vec3; 3]> {
        let [a, b, c] = self.triangles.get(triangle)?.map(|i| self.positions.get(i as usize));
        Some([*a?, *b?, *c?])
    }
}

/// The material of a surface.
#[derive(Clone, Debug)]
pub struct SurfaceMaterial {
    /// The colour, in sRGB.
    pub colour: [u8; 3],
    /// A texture in sRGB, multiplied with the colour. Texture coordinates repeat.
    pub texture: Option<Arc<Picture>>,
    /// Whether sight passes through; drawn as glass.
    pub glass: bool,
    /// The light that the surface gives, in linear RGB. White paper in good light has 1.
    pub emission: [f32; 3],
}

impl SurfaceMaterial {
    /// An opaque material of one colour, in sRGB.
    pub fn opaque(colour: [u8; 3]) -> Self {
        Self { colour, texture: None, glass: false, emission: [0.0; 3] }
    }

    /// A material that stops bodies, and is neither drawn nor blocks sight: black glass, which
    /// tints nothing.
    pub fn unseen() -> Self {
        Self { glass: true, ..Self::opaque([0; 3]) }
    }

    /// Whether the material is that of [`SurfaceMaterial::unseen`].
    pub fn is_unseen(&self) -> bool {
        self.glass && self.texture.is_none() && self.colour == [0; 3]
    }
}
