//! Who is in whose sight.
//!
//! All visitors walk in this process, so it knows where each of them truly is. Rays against the
//! original triangles of the world say who is in whose sight, and the author's rooms say who may
//! be. The server has no part in that.

use std::sync::Arc;

use sightline_oracle::Oracle;
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{World, geometry::Aabb};

use super::VisitorView;

/// Sampled points on each axis of a body's box.
const SAMPLES: u32 = 2;

/// Decides who is in whose sight.
pub struct Sight {
    world: Arc<World>,
    oracle: Oracle,
    rooms: RoomIndex,
}

impl Sight {
    /// Sight in a world.
    pub fn new(world: Arc<World>) -> Self {
        let (oracle, rooms) = (Oracle::new(&world.mesh), RoomIndex::new(&world));
        Self { world, oracle, rooms }
    }

    /// Whether rays reach the other's body, and the author allows to see it.
    pub fn sees(&self, viewer: &VisitorView, other: &VisitorView) -> bool {
        let (eye, body) = (viewer.pose.eye, self.world.body.around(other.pose.eye));
        let cells = &self.world.cells;
        let overlap = |region: &Aabb| self.rooms.overlap(cells, &[cells.axes.own_box(region)]);
        let sealed = [eye, other.pose.eye].map(|eye| self.rooms.sealed_rooms_at(eye));
        let is_allowed = || {
            sealed[0].agrees(&sealed[1])
                && self.rooms.may_see(&overlap(&Aabb::around(eye, 0.0)), &overlap(&body))
        };
        (!self.rooms.can_rule_out() || is_allowed()) && self.oracle.of_box(eye, &body, SAMPLES)
    }
}
