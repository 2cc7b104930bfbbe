//! The section of the mesh: the vertices, then three indices for each triangle. Movers have one
//! each.

use super::{
    ReadError, list,
    reader::SectionReader,
    writer::{put_count, put_u32, put_vec3},
};
use crate::mesh::Mesh;

pub(super) fn to_bytes(mesh: &Mesh) -> Vec<u8> {
    debug_assert!(mesh.is_valid(), "a triangle refers to a vertex that does not exist");
    let mut out = Vec::new();
    put_count(&mut out, mesh.positions.len());
    mesh.positions.iter().for_each(|&p| put_vec3(&mut out, p));
    put_count(&mut out, mesh.triangles.len());
    mesh.triangles.iter().flatten().for_each(|&i| put_u32(&mut out, i));
    out
}

/// Reads a mesh whose triangles refer to existing vertices.
pub(super) fn read(input: &mut SectionReader) -> Result<Mesh, ReadError> {
    let count = input.count(12)?;
    let mut positions = list(count)?;
    for _ in 0..count {
        positions.push(input.vec3()?);
    }
    let count = input.count(12)?;
    let mut triangles = list(count)?;
    for _ in 0..count {
        let triangle = [input.u32()?, input.u32()?, input.u32()?];
        if triangle.iter().any(|&i| i as usize >= positions.len()) {
            return Err(ReadError::Malformed("a triangle"));
        }
        triangles.push(triangle);
    }
    Ok(Mesh { positions, triangles })
}
