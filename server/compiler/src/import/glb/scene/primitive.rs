//! From a primitive to a surface: positions, triangles, colours.

use glam::{DMat4, Vec3};
use gltf::{Primitive, Semantic, mesh::Mode};

use super::{Part, Reader};
use crate::{
    import::{
        glb::{
            accessor,
            error::{GlbError, TRIANGLES_MAX, VERTICES_MAX},
            material::Look,
        },
        limits,
    },
    model::Surface,
};

impl<'a> Reader<'a> {
    /// The surface of a primitive, if it has triangles.
    pub(super) fn primitive(
        &mut self,
        mesh: usize,
        primitive: &Primitive<'a>,
        to_world: &DMat4,
    ) -> Result<Option<Part>, GlbError> {
        let mode = primitive.mode();
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.lines += 1;
            return Ok(None);
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(None) };
        self.vertices += positions.count();
        if self.vertices > VERTICES_MAX {
            return Err(GlbError::TooMany("vertices"));
        }
        let local = accessor::vectors::<3>(&positions, &self.resources, 3)?;
        let positions = placed(mesh, &local, to_world)?;
        let mut triangles = self.triangles(mesh, primitive, mode, &positions)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        if to_world.determinant() < 0.0 {
            // Fronts stay fronts in a mirror (glTF 2.0, section 3.7.4).
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let vertices = positions.len();
        let Self { materials, document, resources, model, .. } = self;
        let look = materials.look(primitive, vertices, document, resources, &mut model.warnings);
        let colours = self.colours(primitive, vertices);
        let colours = self.tolerate(colours)?.unwrap_or_default();
        let Look { material, uvs, hides } = look;
        let surface = Surface { positions, uvs, colours, triangles, material };
        Ok(Some(Part { surface, hides }))
    }

    /// The triangles as indices into the positions, without degenerate ones.
    fn triangles(
        &mut self,
        mesh: usize,
        primitive: &Primitive<'a>,
        mode: Mode,
        positions: &[Vec3],
    ) -> Result<Vec<[u32; 3]>, GlbError> {
        let vertices = positions.len();
        let indices = match primitive.indices() {
            Some(accessor) => accessor::indices(&accessor, &self.resources)?,
            None => (0..vertices as u32).collect(),
        };
        if let Some(&index) = indices.iter().find(|&&i| i as usize >= vertices) {
            return Err(GlbError::Index { mesh, index, vertices });
        }
        let triples: Vec<[u32; 3]> = match mode {
            Mode::TriangleStrip => {
                let flip = |(i, w): (usize, &[u32])| [w[i % 2], w[1 - i % 2], w[2]];
                indices.windows(3).enumerate().map(flip).collect()
            }
            Mode::TriangleFan => match indices.split_first() {
                Some((&first, rest)) => rest.windows(2).map(|w| [first, w[0], w[1]]).collect(),
                None => Vec::new(),
            },
            _ => indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        };
        self.triangles += triples.len();
        if self.triangles > TRIANGLES_MAX {
            return Err(GlbError::TooMany("triangles"));
        }
        let has_area = |t: &[u32; 3]| limits::has_area(t.map(|i| positions[i as usize]));
        Ok(triples.into_iter().filter(has_area).collect())
    }

    fn colours(
        &self,
        primitive: &Primitive<'a>,
        vertices: usize,
    ) -> Result<Vec<[u8; 3]>, GlbError> {
        let Some(accessor) = primitive.get(&Semantic::Colors(0)) else { return Ok(Vec::new()) };
        let linear = accessor::vectors::<3>(&accessor, &self.resources, 3)?;
        let mut colours: Vec<[u8; 3]> =
            linear.into_iter().map(|colour| colour.map(limits::srgb_byte)).collect();
        colours.resize(vertices, [255; 3]);
        Ok(colours)
    }
}

/// Positions in the world's axes.
fn placed(mesh: usize, local: &[[f32; 3]], to_world: &DMat4) -> Result<Vec<Vec3>, GlbError> {
    let place = |(vertex, &position): (usize, &[f32; 3])| {
        let placed = to_world.transform_point3(Vec3::from(position).as_dvec3()).as_vec3();
        if limits::is_sane(placed) {
            Ok(placed)
        } else {
            Err(GlbError::Coordinate { mesh, vertex })
        }
    };
    local.iter().enumerate().map(place).collect()
}
