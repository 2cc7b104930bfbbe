//! What moves by itself: doors, lifts, trains.

use std::time::Duration;

use crate::{geometry::Aabb, mesh::Mesh, motion::trajectory::Trajectory};

/// No world has more movers.
pub const MOVERS_MAX: usize = 4_096;
/// All movers of a world together have no more triangles: some 50 MB with their corners.
pub const MOVER_TRIANGLES_MAX: usize = 1 << 20;

/// An object on a known trajectory.
///
/// As far as the static world tells it hides nobody: it is neither among the occluders nor among
/// the voxels, so that whoever is behind a closed door counts as visible.
#[derive(Clone, Debug, PartialEq)]
pub struct Mover {
    /// What the author calls it.
    pub name: String,
    /// What is drawn, in coordinates of its own, that [`Trajectory::at`] turns into the world's.
    mesh: Mesh,
    colours: Vec<[u8; 3]>,
    bounds: Aabb,
    /// Where it is when.
    pub trajectory: Trajectory,
}

impl Mover {
    /// A mover; none without a triangle, when a triangle names a corner that is not there, or when
    /// there is not one colour for each triangle.
    pub fn new(
        name: String,
        mesh: Mesh,
        colours: Vec<[u8; 3]>,
        trajectory: Trajectory,
    ) -> Option<Self> {
        let corners = || mesh.triangles.as_flattened().iter();
        let is_there = |&index: &u32| (index as usize) < mesh.positions.len();
        if mesh.triangles.is_empty()
            || mesh.triangles.len() != colours.len()
            || !corners().all(is_there)
        {
            return None;
        }
        let bounds = Aabb::from_points(corners().map(|&index| mesh.positions[index as usize]));
        Some(Self { name, mesh, colours, bounds, trajectory })
    }

    /// What is drawn, in its own coordinates. Both sides of a triangle are seen.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// sRGB, for each triangle.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    /// The smallest box around it, in its own coordinates.
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// A box of the world that it does not leave from one time after its start to another: its TBV.
    pub fn swept(&self, from: Duration, until: Duration) -> Aabb {
        self.trajectory.swept(&self.bounds, from, until)
    }

    /// A box of the world that it never leaves.
    pub fn everywhere(&self) -> Aabb {
        self.trajectory.everywhere(&self.bounds)
    }
}
