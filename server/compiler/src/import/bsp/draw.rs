//! The drawn surfaces of a map: faces and tessellated patches, by shader, with their light.

use std::{collections::BTreeMap, ops::Range};

use glam::{Vec2, Vec3};

use super::{
    archive::Archives,
    error::BspError,
    light::Light,
    map::{Face, FaceKind, Map, Shader, Vertex},
    movers::Moving,
    units::placed,
};
use crate::{
    import::limits,
    model::{Model, Surface, SurfaceMaterial},
};

/// The most triangles of a model.
pub(super) const TRIANGLES_MAX: usize = 4 << 20;
/// Triangles are divided until their edges are no longer than this, in Quake units. Light is kept
/// by vertex, and a pixel of a lightmap is 16 units wide.
const EDGE_MIN: f32 = 24.0;
/// In large maps edges stay longer, so that there are about this many triangles.
const DIVIDED_TRIANGLES: f32 = 300_000.0;
/// How often one triangle is halved at most.
const DIVISIONS_MAX: u32 = 12;
/// How often one triangle of a mover is halved at most. Movers are drawn triangle by triangle.
const DIVISIONS_APART: u32 = 5;
/// The greatest deviation of a patch from its true curve, in Quake units.
const CURVE_TOLERANCE: f32 = 1.0;
/// The most segments of one curve.
const SEGMENTS_MAX: usize = 16;

/// Adds all drawn surfaces that do not move, and the patches that block sight.
pub(super) fn surfaces(
    map: &Map<'_>,
    moving: &[Moving],
    archives: &mut Archives,
    model: &mut Model,
) -> Result<(), BspError> {
    let mut drawn: Vec<(&Face, Vec<[Vertex; 3]>)> = Vec::new();
    let mut total = 0;
    let mut moves = vec![false; map.faces.len()];
    moving.iter().for_each(|moving| moves[moving.faces.clone()].fill(true));
    let world_faces = map.models.first().map_or(0..0, |world| world.faces.clone());
    for (index, face) in map.faces.iter().enumerate().filter(|(index, _)| !moves[*index]) {
        let shader = &map.shaders[face.shader];
        let is_patch = matches!(face.kind, FaceKind::Patch { .. });
        let blocks = is_patch && shader.is_opaque() && world_faces.contains(&index);
        if !shader.is_drawn() && !blocks {
            continue;
        }
        let triangles = triangles(map, face)?;
        total += triangles.len();
        if total > TRIANGLES_MAX {
            return Err(BspError::TooMany("triangles"));
        }
        if blocks {
            let corners = triangles.iter().map(|t| t.map(|v| placed(v.position.as_dvec3())));
            model.opaque.extend(corners.filter(|&corners| limits::has_area(corners)));
        }
        if shader.is_drawn() {
            drawn.push((face, triangles));
        }
    }
    draw(map, &drawn, archives, model);
    Ok(())
}

/// The drawn surfaces of some faces, apart from the model.
pub(super) fn apart(
    map: &Map<'_>,
    faces: Range<usize>,
    archives: &mut Archives,
) -> Result<Vec<Surface>, BspError> {
    let mut by_shader: BTreeMap<usize, Pieces> = BTreeMap::new();
    for face in map.faces[faces].iter().filter(|face| map.shaders[face.shader].is_drawn()) {
        let light = Light::of(map, face.lightmap);
        let pieces = by_shader.entry(face.shader).or_default();
        for triangle in triangles(map, face)? {
            pieces.add(triangle, light, EDGE_MIN, DIVISIONS_APART);
        }
        if pieces.positions.len() > 3 * TRIANGLES_MAX {
            return Err(BspError::TooMany("triangles"));
        }
    }
    let surface = |(shader, pieces): (usize, Pieces)| {
        pieces.into_surface(material(&map.shaders[shader], archives))
    };
    Ok(by_shader.into_iter().map(surface).collect())
}

/// Adds surfaces, one for each shader.
fn draw(
    map: &Map<'_>,
    drawn: &[(&Face, Vec<[Vertex; 3]>)],
    archives: &mut Archives,
    model: &mut Model,
) {
    let area: f32 = drawn.iter().flat_map(|(_, triangles)| triangles).map(area).sum();
    // Halving leaves triangles with legs of about the longest edge.
    let edge_max = (2.0 * area / DIVIDED_TRIANGLES).sqrt().max(EDGE_MIN);
    let mut by_shader: BTreeMap<usize, Pieces> = BTreeMap::new();
    let mut left = TRIANGLES_MAX;
    for (face, triangles) in drawn {
        let light = Light::of(map, face.lightmap);
        let pieces = by_shader.entry(face.shader).or_default();
        for &triangle in triangles {
            let has_detail = matches!(light, Light::Lightmap(_)) && left > TRIANGLES_MAX / 2;
            let divisions = if has_detail { DIVISIONS_MAX } else { 0 };
            left = left.saturating_sub(pieces.add(triangle, light, edge_max, divisions));
        }
    }
    let mut without_image = 0;
    for (shader, pieces) in by_shader {
        let material = material(&map.shaders[shader], archives);
        without_image += usize::from(material.texture.is_none());
        model.surfaces.push(pieces.into_surface(material));
    }
    if without_image > 0 && !archives.is_empty() {
        model.warnings.push(format!("no image found for {without_image} shaders"));
    }
}

/// The area, in square units.
fn area(triangle: &[Vertex; 3]) -> f32 {
    let [a, b, c] = triangle.map(|vertex| vertex.position);
    (b - a).cross(c - a).length() / 2.0
}

/// Triangles of one shader.
#[derive(Default)]
struct Pieces {
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    colours: Vec<[u8; 3]>,
}

impl Pieces {
    /// Adds a triangle, divided so that its light is kept, and gives the number of pieces.
    fn add(
        &mut self,
        triangle: [Vertex; 3],
        light: Light<'_>,
        edge_max: f32,
        divisions: u32,
    ) -> usize {
        let next = |i: usize| triangle[(i + 1) % 3].position;
        let lengths = [0, 1, 2].map(|i| triangle[i].position.distance(next(i)));
        let longest = (0..3).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b])).unwrap_or(0);
        if divisions > 0 && lengths[longest] > edge_max {
            let [a, b, c] = [0, 1, 2].map(|i| triangle[(longest + i) % 3]);
            let middle = between(&a, &b, 0.5);
            return self.add([a, middle, c], light, edge_max, divisions - 1)
                + self.add([middle, b, c], light, edge_max, divisions - 1);
        }
        let corners = triangle.map(|vertex| placed(vertex.position.as_dvec3()));
        if !limits::has_area(corners) {
            return 0;
        }
        for (vertex, position) in triangle.iter().zip(corners) {
            let colour = Vec3::from(vertex.colour.map(f32::from));
            self.positions.push(position);
            self.uvs.push(if vertex.texture.is_finite() { vertex.texture } else { Vec2::ZERO });
            self.colours.push(light.at(vertex.lightmap, colour));
        }
        1
    }

    fn into_surface(self, material: SurfaceMaterial) -> Surface {
        assert_eq!(self.positions.len(), self.colours.len(), "a colour for each vertex");
        assert!(self.positions.len().is_multiple_of(3), "three vertices for each triangle");
        let count = self.positions.len() as u32 / 3;
        let triangles = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let uvs = if material.texture.is_some() { self.uvs } else { Vec::new() };
        Surface { positions: self.positions, uvs, colours: self.colours, triangles, material }
    }
}

fn material(shader: &Shader, archives: &mut Archives) -> SurfaceMaterial {
    let texture = archives.texture(&shader.name);
    let colour = if texture.is_some() { [255; 3] } else { tint(&shader.name) };
    SurfaceMaterial { texture, glass: !shader.is_opaque(), ..SurfaceMaterial::opaque(colour) }
}

/// A muted colour that tells one shader from another.
fn tint(name: &str) -> [u8; 3] {
    let hash = blake3::hash(name.as_bytes());
    let [a, b, c, ..] = *hash.as_bytes();
    [a, b, c].map(|byte| 130 + (u16::from(byte) * 100 / 255) as u8)
}

/// The triangles of a face; none for billboards.
fn triangles(map: &Map<'_>, face: &Face) -> Result<Vec<[Vertex; 3]>, BspError> {
    let vertices = &map.vertices[face.vertices.clone()];
    let is_sane = |v: &Vertex| limits::is_sane(placed(v.position.as_dvec3()));
    if face.kind != FaceKind::Billboard && !vertices.iter().all(is_sane) {
        return Err(BspError::Coordinate);
    }
    match face.kind {
        FaceKind::Billboard => Ok(Vec::new()),
        FaceKind::Patch { width, height } => patch(vertices, width, height),
        FaceKind::Triangles => {
            let corner = |&offset: &u32| vertices.get(offset as usize).copied();
            let corners: Option<Vec<Vertex>> =
                map.mesh_vertices[face.mesh_vertices.clone()].iter().map(corner).collect();
            let corners = corners.ok_or(BspError::Index { what: "mesh vertex" })?;
            Ok(corners.as_chunks().0.to_vec())
        }
    }
}

/// Tessellates a grid of control points. Each three by three of them, with shared edges, make a
/// biquadratic Bézier surface.
fn patch(control: &[Vertex], width: usize, height: usize) -> Result<Vec<[Vertex; 3]>, BspError> {
    let at = |x: usize, y: usize| control[y * width + x];
    let rows = (0..height)
        .flat_map(|y| (0..width - 2).step_by(2).map(move |x| [(x, y), (x + 1, y), (x + 2, y)]));
    let columns = (0..width)
        .flat_map(|x| (0..height - 2).step_by(2).map(move |y| [(x, y), (x, y + 1), (x, y + 2)]));
    let bend = |[a, b, c]: [(usize, usize); 3]| {
        let [a, b, c] = [a, b, c].map(|(x, y)| at(x, y).position);
        (a - 2.0 * b + c).length()
    };
    let across = segments(rows.map(bend));
    let down = segments(columns.map(bend));

    // First along the rows of control points, then down the columns that result.
    let fine_width = (width - 1) / 2 * across + 1;
    let fine_height = (height - 1) / 2 * down + 1;
    let count = (2 * (fine_width - 1)).saturating_mul(fine_height - 1);
    if count > TRIANGLES_MAX {
        return Err(BspError::TooMany("triangles"));
    }
    let mut coarse = Vec::with_capacity(fine_width * height);
    for y in 0..height {
        coarse.extend((0..fine_width).map(|i| curve(|k| at(k, y), width, across, i)));
    }
    let mut fine = Vec::with_capacity(fine_width * fine_height);
    for j in 0..fine_height {
        let column = |x: usize| curve(|k| coarse[k * fine_width + x], height, down, j);
        fine.extend((0..fine_width).map(column));
    }
    let mut triangles = Vec::with_capacity(count);
    for y in 0..fine_height - 1 {
        for x in 0..fine_width - 1 {
            let corner = |dx: usize, dy: usize| fine[(y + dy) * fine_width + x + dx];
            triangles.push([corner(0, 0), corner(1, 0), corner(0, 1)]);
            triangles.push([corner(1, 0), corner(1, 1), corner(0, 1)]);
        }
    }
    Ok(triangles)
}

/// The number of straight pieces for curves whose control points bend this far.
fn segments(bends: impl Iterator<Item = f32>) -> usize {
    let bend = bends.fold(0.0, f32::max);
    // A quadratic curve is off its chord by a quarter of its bend, divided by the square of the
    // pieces.
    ((bend / 4.0 / CURVE_TOLERANCE).sqrt().ceil() as usize).clamp(1, SEGMENTS_MAX)
}

/// The `i`th point on a chain of quadratic curves, each divided into `pieces` pieces.
fn curve(control: impl Fn(usize) -> Vertex, points: usize, pieces: usize, i: usize) -> Vertex {
    let piece = (i / pieces).min((points - 3) / 2);
    let t = (i - piece * pieces) as f32 / pieces as f32;
    let [a, b, c] = [0, 1, 2].map(|k| control(2 * piece + k));
    match t {
        // Ends stay exact, so that neighbouring patches meet.
        0.0 => a,
        1.0 => c,
        _ => between(&between(&a, &b, t), &between(&b, &c, t), t),
    }
}

fn between(a: &Vertex, b: &Vertex, t: f32) -> Vertex {
    let colour = |i: usize| {
        let (a, b) = (f32::from(a.colour[i]), f32::from(b.colour[i]));
        (a + (b - a) * t) as u8
    };
    Vertex {
        position: a.position.lerp(b.position, t),
        texture: a.texture.lerp(b.texture, t),
        lightmap: a.lightmap.lerp(b.lightmap, t),
        colour: [colour(0), colour(1), colour(2)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_of_too_many_triangles_is_refused_before_they_are_made() {
        let side = 257;
        let bent = |at: usize| Vertex {
            position: Vec3::new(0.0, 0.0, if at.is_multiple_of(2) { 0.0 } else { 9.0e4 }),
            ..Vertex::default()
        };
        let control: Vec<Vertex> = (0..side * side).map(bent).collect();
        let error = patch(&control, side, side).map(|triangles| triangles.len());
        assert!(matches!(error, Err(BspError::TooMany("triangles"))), "{error:?}");
        assert_eq!(patch(&control, 3, 3).unwrap().len(), 2 * SEGMENTS_MAX * SEGMENTS_MAX);
    }
}
