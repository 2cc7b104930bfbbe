//! The records of a BSP file, every range and index checked.

use glam::{DVec3, Vec2, Vec3};

use super::{
    error::BspError,
    lumps::{Fields, Lumps, index, range},
    tree::Tree,
};

/// The edge of a lightmap, in pixels.
pub(super) const LIGHTMAP_EDGE: usize = 128;
const LIGHTMAP_BYTES: usize = LIGHTMAP_EDGE * LIGHTMAP_EDGE * 3;

/// The most records of each kind: at least four times what the game takes.
const SHADERS_MAX: usize = 1 << 14;
const PLANES_MAX: usize = 1 << 20;
const MODELS_MAX: usize = 1 << 13;
const BRUSHES_MAX: usize = 1 << 17;
/// The most sides of a brush. The work grows with its square.
const BRUSH_SIDES_MAX: usize = 128;
const SIDES_MAX: usize = 1 << 21;
const VERTICES_MAX: usize = 1 << 21;
const MESH_VERTICES_MAX: usize = 1 << 23;
const FACES_MAX: usize = 1 << 19;
const LIGHTMAPS_MAX: usize = 1 << 12;
const ENTITY_BYTES_MAX: usize = 8 << 20;

/// A shader: its name and its flags.
pub(super) struct Shader {
    pub name: String,
    pub surface_flags: i32,
    pub contents: i32,
}

/// The half-space `normal · p <= distance`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    pub normal: DVec3,
    pub distance: f64,
}

/// A convex solid: the half-spaces of its sides.
pub(super) struct Brush {
    pub planes: Vec<Plane>,
    /// The same planes, as indices into those of the map.
    pub sides: Vec<usize>,
    pub shader: usize,
}

#[derive(Clone, Copy, Default)]
pub(super) struct Vertex {
    /// The position, in Quake units and axes.
    pub position: Vec3,
    pub texture: Vec2,
    pub lightmap: Vec2,
    pub colour: [u8; 3],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FaceKind {
    /// A planar face or mesh: triangles of mesh vertices.
    Triangles,
    /// A grid of control points.
    Patch {
        width: usize,
        height: usize,
    },
    Billboard,
}

pub(super) struct Face {
    pub kind: FaceKind,
    pub shader: usize,
    pub vertices: std::ops::Range<usize>,
    pub mesh_vertices: std::ops::Range<usize>,
    pub lightmap: Option<usize>,
}

/// What is read of a map. Brushes are those of the world model.
pub(super) struct Map<'a> {
    pub entities: String,
    pub shaders: Vec<Shader>,
    pub planes: Vec<Plane>,
    pub world_brushes: Vec<Brush>,
    /// The world model first, then brush models of entities.
    pub models: Vec<SubModel>,
    pub tree: Tree<'a>,
    pub vertices: Vec<Vertex>,
    pub mesh_vertices: Vec<u32>,
    pub faces: Vec<Face>,
    /// RGB, [`LIGHTMAP_EDGE`] squared pixels each.
    pub lightmaps: &'a [[u8; LIGHTMAP_BYTES]],
}

impl<'a> Map<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Result<Self, BspError> {
        let lumps = Lumps::parse(bytes)?;
        let shaders: Vec<Shader> =
            lumps.records(1, "shaders", SHADERS_MAX)?.iter().map(shader).collect();
        let vertices: Vec<Vertex> =
            lumps.records(10, "vertices", VERTICES_MAX)?.iter().map(vertex).collect();
        let mesh_vertices: Vec<u32> = lumps
            .records(11, "mesh vertices", MESH_VERTICES_MAX)?
            .iter()
            .map(|&bytes| u32::from_le_bytes(bytes))
            .collect();
        let lightmaps = lumps.records::<LIGHTMAP_BYTES>(14, "lightmaps", LIGHTMAPS_MAX)?;
        let limits = Counts {
            shaders: shaders.len(),
            vertices: vertices.len(),
            mesh_vertices: mesh_vertices.len(),
            lightmaps: lightmaps.len(),
        };
        let faces = lumps.records(13, "faces", FACES_MAX)?;
        let faces: Vec<Face> =
            faces.iter().map(|bytes| face(bytes, &limits)).collect::<Result<_, _>>()?;
        let models = models(&lumps, faces.len())?;
        let world = models.first().ok_or(BspError::NoWorld)?;
        let planes: Vec<Plane> =
            lumps.records(2, "planes", PLANES_MAX)?.iter().map(plane).collect();
        let entities = lumps.bytes(0)?;
        if entities.len() > ENTITY_BYTES_MAX {
            return Err(BspError::TooMany("bytes of entities"));
        }
        Ok(Self {
            entities: String::from_utf8_lossy(entities).into_owned(),
            world_brushes: brushes(&lumps, world.brushes.clone(), shaders.len(), &planes)?,
            tree: Tree::parse(&lumps, planes.len())?,
            planes,
            shaders,
            vertices,
            mesh_vertices,
            faces,
            models,
            lightmaps,
        })
    }
}

/// A brush model: a part of a map that moves as a whole.
pub(super) struct SubModel {
    /// The box in Quake units, one unit larger on each side than in the file, as in the game.
    pub min: DVec3,
    pub max: DVec3,
    pub faces: std::ops::Range<usize>,
    brushes: std::ops::Range<usize>,
}

/// Numbers of records, to check indices against.
struct Counts {
    shaders: usize,
    vertices: usize,
    mesh_vertices: usize,
    lightmaps: usize,
}

fn sub_model(bytes: &[u8; 40], faces: usize, brushes: usize) -> Option<SubModel> {
    let mut fields = Fields(bytes);
    let (min, max) = (fields.vec3().as_dvec3() - 1.0, fields.vec3().as_dvec3() + 1.0);
    let faces = range(fields.int(), fields.int(), faces)?;
    let brushes = range(fields.int(), fields.int(), brushes)?;
    Some(SubModel { min, max, faces, brushes })
}

fn shader(bytes: &[u8; 72]) -> Shader {
    let mut fields = Fields(bytes);
    let name: [u8; 64] = fields.take();
    let end = name.iter().position(|&b| b == 0).unwrap_or(name.len());
    Shader {
        name: String::from_utf8_lossy(&name[..end]).to_ascii_lowercase(),
        surface_flags: fields.int(),
        contents: fields.int(),
    }
}

fn plane(bytes: &[u8; 16]) -> Plane {
    let mut fields = Fields(bytes);
    Plane { normal: fields.vec3().as_dvec3(), distance: f64::from(fields.float()) }
}

fn vertex(bytes: &[u8; 44]) -> Vertex {
    let mut fields = Fields(bytes);
    let (position, texture, lightmap) = (fields.vec3(), fields.vec2(), fields.vec2());
    fields.skip(12);
    Vertex { position, texture, lightmap, colour: fields.take() }
}

fn face(bytes: &[u8; 104], counts: &Counts) -> Result<Face, BspError> {
    let fault = || BspError::Index { what: "face" };
    let mut fields = Fields(bytes);
    let shader = index(fields.int(), counts.shaders).ok_or_else(fault)?;
    fields.skip(4);
    let kind = fields.int();
    let vertices = range(fields.int(), fields.int(), counts.vertices).ok_or_else(fault)?;
    let mesh_vertices =
        range(fields.int(), fields.int(), counts.mesh_vertices).ok_or_else(fault)?;
    let lightmap = index(fields.int(), counts.lightmaps);
    fields.skip(64);
    let kind = match kind {
        1 | 3 => FaceKind::Triangles,
        2 => patch(fields.int(), fields.int(), vertices.len()).ok_or_else(fault)?,
        _ => FaceKind::Billboard,
    };
    Ok(Face { kind, shader, vertices, mesh_vertices, lightmap })
}

/// A patch, whose control points are odd in number each way, and at least three.
fn patch(width: i32, height: i32, vertices: usize) -> Option<FaceKind> {
    let (width, height) = (usize::try_from(width).ok()?, usize::try_from(height).ok()?);
    let is_odd = width >= 3 && height >= 3 && width % 2 == 1 && height % 2 == 1;
    (is_odd && width.checked_mul(height)? == vertices).then_some(FaceKind::Patch { width, height })
}

fn models(lumps: &Lumps<'_>, faces: usize) -> Result<Vec<SubModel>, BspError> {
    let brushes = lumps.records::<12>(8, "brushes", BRUSHES_MAX)?.len();
    let models = lumps.records::<40>(7, "models", MODELS_MAX)?.iter();
    let models: Option<_> = models.map(|bytes| sub_model(bytes, faces, brushes)).collect();
    models.ok_or(BspError::Index { what: "model" })
}

fn brushes(
    lumps: &Lumps<'_>,
    which: std::ops::Range<usize>,
    shaders: usize,
    planes: &[Plane],
) -> Result<Vec<Brush>, BspError> {
    let sides = lumps.records::<8>(9, "brush sides", SIDES_MAX)?;
    let fault = || BspError::Index { what: "brush" };
    let mut brushes = Vec::with_capacity(which.len());
    for bytes in &lumps.records::<12>(8, "brushes", BRUSHES_MAX)?[which] {
        let mut fields = Fields(bytes);
        let sides = range(fields.int(), fields.int(), sides.len())
            .map(|range| &sides[range])
            .ok_or_else(fault)?;
        if sides.len() > BRUSH_SIDES_MAX {
            return Err(BspError::TooMany("sides of a brush"));
        }
        let shader = index(fields.int(), shaders).ok_or_else(fault)?;
        let side = |side: &[u8; 8]| index(Fields(side).int(), planes.len());
        let sides: Vec<usize> = sides.iter().map(side).collect::<Option<_>>().ok_or_else(fault)?;
        let planes = sides.iter().map(|&side| planes[side]).collect();
        brushes.push(Brush { planes, sides, shader });
    }
    Ok(brushes)
}
