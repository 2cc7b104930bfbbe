//! Which pieces of a world an avatar may have where the geometry is private: those that may be seen
//! from where its body can be, and those around it.

use std::{collections::BTreeSet, sync::Arc};

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_world::{
    Cells, Viewpoints, World, WorldHead,
    geometry::Aabb,
    motion::Tbv,
    tolerance::{TOUCH_M, WIRE_POSE_M},
};

/// What may be seen from where in a world whose pieces are private.
#[derive(Debug)]
pub struct PrivateGeometry {
    world: Arc<World>,
    head: WorldHead,
    /// The viewpoints of each space.
    viewpoints: Vec<Vec<usize>>,
}

/// Where an avatar is, as far as its client has said.
#[derive(Clone, Copy, Debug)]
pub struct Whereabouts {
    /// The last accepted place of its eye, in metres.
    pub eye: Vec3,
    /// Where its eye can be.
    pub region: Tbv,
}

impl PrivateGeometry {
    /// Of a world with this head.
    pub fn new(world: &Arc<World>, head: WorldHead) -> Self {
        let mut viewpoints = vec![Vec::new(); world.cells.spaces.len()];
        for (viewpoint, &space) in Viewpoints::of(&world.cells).spaces().iter().enumerate() {
            viewpoints[space as usize].push(viewpoint);
        }
        Self { world: world.clone(), head, viewpoints }
    }

    /// The branches whose pieces an avatar may have: what may be seen from the spaces that its body
    /// can have reached, and what is around its body there.
    pub fn branches(&self, whereabouts: &Whereabouts) -> RoaringBitmap {
        let (cells, octree) = (&self.world.cells, &self.head.octree);
        let within = whereabouts.region.within.grown(WIRE_POSE_M + TOUCH_M);
        let reached = reached(cells, whereabouts.eye, &within);
        let seen = |space: &u32| self.viewpoints.get(*space as usize).into_iter().flatten();
        let seen = reached.iter().flat_map(seen).filter_map(|at| self.head.seen().get(*at));
        let mut all = seen.fold(RoaringBitmap::new(), |all, seen| all | seen);
        for space in reached {
            let own = cells.spaces[space as usize].cells.clone();
            for cell in &cells.cells[own.start as usize..own.end as usize] {
                let eyes = cell.bounds.intersection(&within);
                if !eyes.is_empty() {
                    let body = self.world.body.surroundings(&cells.axes.world_box(&eyes));
                    all.extend(octree.branches_in(body).map(|branch| branch as u32));
                }
            }
        }
        all
    }

    /// Whether a piece is one of these branches.
    pub fn is_of(&self, number: u32, branches: &RoaringBitmap) -> bool {
        branches.contains(number / u32::from(self.head.octree.grades()).max(1))
    }
}

/// The spaces that a body reaches from where its eye is, within a box in own axes: it goes through
/// gates.
fn reached(cells: &Cells, eye: Vec3, within: &Aabb) -> BTreeSet<u32> {
    let Some(cell) = cells.at(eye) else { return BTreeSet::new() };
    let start = cells.cells[cell.0 as usize].space;
    let mut reached = BTreeSet::from([start]);
    let mut waiting = vec![start];
    while let Some(space) = waiting.pop() {
        for &gate in &cells.spaces[space as usize].gates {
            let gate = &cells.gates[gate as usize];
            if gate.polygon.bounds().intersects(within) {
                let others = gate.spaces.into_iter().filter(|other| reached.insert(*other));
                waiting.extend(others.collect::<Vec<_>>());
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use sightline_fixtures::two_rooms;
    use sightline_visibility::streaming::pieces_of;
    use sightline_world::motion::Body;

    use super::*;

    fn whereabouts(world: &World, eye: Vec3, around: f32) -> Whereabouts {
        let axes = world.cells.axes;
        let (expiry, notice) = (Duration::ZERO, Duration::ZERO);
        let within = Aabb::around(axes.own(eye), around);
        Whereabouts { eye, region: Tbv { within, axes, expiry, notice } }
    }

    #[test]
    fn who_is_in_a_closed_room_may_have_what_is_in_it_and_around_the_body() {
        let world = Arc::new(two_rooms::without_door());
        let head = WorldHead::read(&pieces_of(&world, &[]).head).unwrap();
        let (branches, edge) = (head.octree.branches(), head.octree.edge_after(0));
        let bounds: Vec<Aabb> = (0..branches).filter_map(|at| head.octree.bounds_of(at)).collect();
        let private = PrivateGeometry::new(&world, head);
        let reach = edge + Body::PERSON.half_width + 0.6;
        for (x, others) in [(3.0, 6.0 + reach..99.0), (9.0, -99.0..6.0 - reach)] {
            // A region that the wall cuts: no body goes through it.
            let whereabouts = whereabouts(&world, Vec3::new(x, 1.6, 3.0), 4.0);
            let may = private.branches(&whereabouts);
            assert!(!may.is_empty() && (may.len() as usize) < branches);
            for branch in &may {
                let centre = bounds[branch as usize].centre().x;
                assert!(!others.contains(&centre), "{x}: {centre}");
            }
            let grades = u32::from(private.head.octree.grades());
            let first = may.min().unwrap();
            assert!(private.is_of(first * grades + grades - 1, &may));
            let hidden = (0..branches as u32).find(|branch| !may.contains(*branch)).unwrap();
            assert!(!private.is_of(hidden * grades, &may));
        }
    }

    #[test]
    fn what_is_beyond_a_gate_may_be_had_once_the_body_can_have_gone_through() {
        let world = Arc::new(two_rooms::world());
        let eye = world.spawns[0].eye;
        let space = |around: f32| {
            let Whereabouts { eye, region } = whereabouts(&world, eye, around);
            reached(&world.cells, eye, &region.within).len()
        };
        assert_eq!([space(0.1), space(99.0)], [1, 2]);
    }
}
