//! Fuzzy projection of loose entries (Lim 1999): does it prove that two cells cannot see each
//! other?

use std::collections::HashMap;

use sightline_visibility::fuzzy::{FuzzyBuffer, SurfaceError, Surfaces, ViewpointBox};
use sightline_world::{Mesh, World, geometry::Aabb};

/// Elements along each side of a face of the fuzzy buffer.
const ELEMENTS: usize = 256;
/// Planes that agree to this fraction of a metre count as one.
const PARTS: f32 = 1e4;

/// The opaque triangles of a world. Triangles in one plane are one surface.
pub(super) struct Fuzzy<'a> {
    world: &'a World,
    surfaces: Surfaces,
}

impl<'a> Fuzzy<'a> {
    pub(super) fn new(world: &'a World) -> Result<Self, SurfaceError> {
        let surfaces = surfaces(&world.mesh)?;
        Ok(Self { world, surfaces })
    }

    /// Whether all of one cell is hidden from every eye in the other, in one direction or the
    /// other.
    pub(super) fn parts(&self, cells: [u32; 2]) -> bool {
        let bounds = cells.map(|cell| {
            let known = self.world.cells.cells.get(cell as usize);
            known.map(|cell| self.world.cells.axes.world_box(&cell.bounds))
        });
        let [Some(one), Some(other)] = bounds else { return false };
        parts(&self.surfaces, one, other)
    }
}

fn parts(surfaces: &Surfaces, one: Aabb, other: Aabb) -> bool {
    let hides = |eyes: Aabb, what: &Aabb| {
        FuzzyBuffer::new(surfaces, &ViewpointBox::all_round(eyes), ELEMENTS).hides(what)
    };
    hides(one, &other) || hides(other, &one)
}

fn surfaces(mesh: &Mesh) -> Result<Surfaces, SurfaceError> {
    let mut planes: HashMap<[i64; 4], u32> = HashMap::new();
    let patches = mesh.corners().zip(&mesh.triangles).map(|([a, b, c], triangle)| {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let key = normal.extend(normal.dot(a)).to_array().map(|part| (part * PARTS).round() as i64);
        let next = planes.len() as u32;
        (*planes.entry(key).or_insert(next), triangle.to_vec())
    });
    let patches: Vec<(u32, Vec<u32>)> = patches.collect();
    Surfaces::new(&mesh.positions, &patches)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A wall of squares, with or without a gap of one square.
    fn wall(gap: Option<[u32; 2]>) -> Surfaces {
        let mut mesh = Mesh::default();
        let places = (0..8).flat_map(|x| (0..8).map(move |y| [x, y]));
        for place in places.filter(|place| gap != Some(*place)) {
            let at = Vec3::new(place[0] as f32, place[1] as f32, 0.0) * 2.0 - Vec3::splat(8.0);
            let first = mesh.positions.len() as u32;
            let corners = [[0, 0], [2, 0], [2, 2], [0, 2]];
            let corner = |[x, y]: [u8; 2]| at.with_z(0.0) + Vec3::new(x.into(), y.into(), 0.0);
            mesh.positions.extend(corners.map(corner));
            mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| first + i)));
        }
        surfaces(&mesh).unwrap()
    }

    #[test]
    fn a_wall_parts_cells_and_one_with_a_gap_does_not() {
        let [one, other] = [-3.0, 3.0].map(|z| Aabb::around(Vec3::new(0.5, 0.5, z), 0.5));
        for (gap, expected) in [(None, true), (Some([4, 4]), false), (Some([0, 7]), true)] {
            assert_eq!(parts(&wall(gap), one, other), expected, "{gap:?}");
        }
        let far = Aabb::around(Vec3::new(20.0, 0.5, 3.0), 0.5);
        assert!(!parts(&wall(None), one, far), "a line passes around the wall");
    }
}
