//! The compiled building as a whole.

use glam::Vec3;

use crate::{
    cells::Cells,
    geometry::{Aabb, Confines},
    light::{BakedLight, ShownLight, places_beside},
    mesh::Mesh,
    motion::{Body, Spawn},
    mover::Mover,
    octree::Octree,
    origin::Origin,
    rooms::Rooms,
};

/// A compiled building: all that a server needs to decide who may see whom, and all that a client
/// needs to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// The author's title; the model's file name unless the model has a title.
    pub title: String,
    /// The voxels that clients draw and collide with.
    pub octree: Octree,
    /// The spatial subdivision: cells, portals and the PVS.
    pub cells: Cells,
    /// The opaque triangles. They alone block sight.
    pub mesh: Mesh,
    /// The objects that move by themselves. They have no voxels and hide nobody. There are at most
    /// [`MOVERS_MAX`](crate::MOVERS_MAX).
    pub movers: Vec<Mover>,
    /// The rooms that the author describes.
    pub rooms: Rooms,
    /// The light for what moves. Worlds that bring their own light have none.
    pub light: Option<BakedLight>,
    /// The poses at which avatars can begin. Never empty.
    pub spawns: Vec<Spawn>,
    /// The shape of every body.
    pub body: Body,
    /// The greatest speed of an avatar's eye, in metres per second.
    pub speed_max: f32,
    /// The brushes and the PVS of the Quake map that the world comes from, to verify the rest
    /// against. Other models have none.
    pub origin: Option<Origin>,
}

impl World {
    /// The smallest box along the world's axes around [`World::confines`].
    pub fn bounds(&self) -> Aabb {
        self.cells.axes.world_box(&self.cells.bounds)
    }

    /// The region in which an eye can be. It contains the whole building.
    pub fn confines(&self) -> Confines {
        Confines { axes: self.cells.axes, bounds: self.cells.bounds }
    }

    /// The light at a place, or None where none is known.
    pub fn light_at(&self, place: Vec3) -> Option<ShownLight> {
        let light = self.light.as_ref()?;
        light.at(place, &self.cells).map(|arriving| arriving.shown(light.exposure))
    }

    /// The light on a mover that fills a box, or None where none is known. Each side has the light
    /// of the place beside it, so that the two sides of a door differ.
    pub fn light_around(&self, bounds: &Aabb) -> Option<ShownLight> {
        let mut around = ShownLight { sides: [0.0; 6], tint: Vec3::ZERO };
        for (side, place) in places_beside(bounds).into_iter().enumerate() {
            let there = self.light_at(place)?;
            around.sides[side] = there.sides[side];
            around.tint += there.tint / 6.0;
        }
        Some(around)
    }
}
