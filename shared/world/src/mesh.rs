//! Triangle meshes.

use glam::Vec3;

/// A triangle mesh, in metres.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Mesh {
    /// The vertices.
    pub positions: Vec<Vec3>,
    /// The triangles: three indices into `positions` each.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether every triangle refers to vertices that exist.
    pub fn is_valid(&self) -> bool {
        self.triangles.as_flattened().iter().all(|&index| (index as usize) < self.positions.len())
    }

    /// The three corners of each triangle.
    ///
    /// # Panics
    /// When a triangle refers to a vertex that does not exist. The reader of world files refuses
    /// such meshes.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|i| self.positions[i as usize]))
    }
}
