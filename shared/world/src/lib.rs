//! The compiled world: what a building is to server and client.

pub mod cells;
mod file;
pub mod geometry;
pub mod motion;
mod mover;
pub mod octree;
mod origin;
pub mod rooms;
pub mod tolerance;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use cells::{Cell, CellId, Cells, Gate, Node, Polygon, Portal, Pvs, Space};
pub use file::{ContentId, ReadError, content_id, write_whole};
pub use mover::{MOVER_TRIANGLES_MAX, MOVERS_MAX, Mover};
pub use origin::{Origin, OriginLeaf, OriginNode, OriginPlane, OriginSide, OriginTree, Solid};

use crate::{geometry::Aabb, motion::Body, octree::Octree, rooms::Rooms};

/// A building, compiled.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// What the author calls it; the model's file name unless the model says otherwise.
    pub title: String,
    /// All that is drawn.
    pub octree: Octree,
    /// Cells, portals and the PVS.
    pub cells: Cells,
    /// The opaque triangles: exactly what blocks sight.
    pub mesh: Mesh,
    /// What moves by itself: in no voxel, and hiding nobody. See [`MOVERS_MAX`].
    pub movers: Vec<Mover>,
    /// What the author knows about the building.
    pub rooms: Rooms,
    /// Where avatars can begin. Never empty.
    pub spawns: Vec<Spawn>,
    /// The shape of every body.
    pub body: Body,
    /// No avatar's eye moves faster, in metres a second.
    pub speed_max: f32,
    /// What a Quake map says of itself, to verify the rest against; none for other models.
    pub origin: Option<Origin>,
}

impl World {
    /// The smallest box of the world's axes around [`World::confines`].
    pub fn bounds(&self) -> Aabb {
        self.cells.axes.world_box(&self.cells.bounds)
    }

    /// The region in which an eye can be. All the building is inside.
    pub fn confines(&self) -> geometry::Confines {
        geometry::Confines { axes: self.cells.axes, bounds: self.cells.bounds }
    }
}

/// Where an avatar can begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spawn {
    /// The eye, in metres.
    pub eye: Vec3,
    /// As in [`crate::motion::Pose::yaw`].
    pub yaw: f32,
}

/// Triangles, in metres.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Mesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Three indices of `positions` for each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of each triangle.
    ///
    /// # Panics
    /// When a triangle has a corner that is not there, which no world that was read has.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|i| self.positions[i as usize]))
    }
}
