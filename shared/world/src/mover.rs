//! Movers: objects that move by themselves, such as doors, lifts and trains.

use std::time::Duration;

use crate::{geometry::Aabb, mesh::Mesh, motion::trajectory::Trajectory};

/// The greatest number of movers of a world.
pub const MOVERS_MAX: usize = 4_096;
/// The greatest number of triangles of all movers of a world together: about 50 MB.
pub const MOVER_TRIANGLES_MAX: usize = 1 << 20;

/// An object on a known trajectory.
///
/// A mover hides nobody: it is neither an occluder nor made of voxels. An avatar behind a closed
/// door counts as visible.
#[derive(Clone, Debug, PartialEq)]
pub struct Mover {
    /// The author's name for it.
    pub name: String,
    /// The triangles that are drawn, in the mover's own coordinates. [`Trajectory::at`] transforms
    /// these to the world's.
    mesh: Mesh,
    colours: Vec<[u8; 3]>,
    bounds: Aabb,
    /// Its place at every time.
    pub trajectory: Trajectory,
}

impl Mover {
    /// Makes a mover. `None` when the mesh has no triangle, when a triangle refers to a vertex that
    /// does not exist, or when there is not one colour for each triangle.
    pub fn new(
        name: String,
        mesh: Mesh,
        colours: Vec<[u8; 3]>,
        trajectory: Trajectory,
    ) -> Option<Self> {
        if mesh.triangles.is_empty() || mesh.triangles.len() != colours.len() || !mesh.is_valid() {
            return None;
        }
        let bounds = Aabb::from_points(mesh.corners().flatten());
        debug_assert_eq!(mesh.triangles.len(), colours.len());
        Some(Self { name, mesh, colours, bounds, trajectory })
    }

    /// The triangles that are drawn, in the mover's own coordinates. Both of their sides are
    /// visible.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The sRGB colour of each triangle.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    /// The smallest box around the mesh, in the mover's own coordinates.
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// The mover's TBV: a box of the world that it does not leave between two times after its
    /// start.
    pub fn swept(&self, from: Duration, until: Duration) -> Aabb {
        self.trajectory.swept(&self.bounds, from, until)
    }

    /// A box of the world that the mover never leaves.
    pub fn everywhere(&self) -> Aabb {
        self.trajectory.everywhere(&self.bounds)
    }
}
