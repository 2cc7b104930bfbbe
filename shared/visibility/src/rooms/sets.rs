//! Visibility sets: everything that may be visible from a viewpoint, by cells and rooms together
//! (Menon and Rossignac 1999, FIG. 8).
//!
//! A set is kept for viewpoints near its own. While a camera moves from one viewpoint to another,
//! the union of their sets is used.

use std::f32::consts::PI;

use roaring::RoaringBitmap;
use sightline_world::{
    World,
    geometry::{Aabb, Frustum},
    motion::Pose,
    rooms::RoomId,
};

use super::{index::RoomIndex, overlap::RoomOverlap, region::BooleanRegion, sight::Viewpoint};

/// A visibility set: everything that may be visible. It is never too small, given what the author
/// says about rooms.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct VisibilitySet {
    /// Indices into [`Cells::cells`](sightline_world::Cells::cells).
    pub cells: RoaringBitmap,
    /// The numbers of [`RoomId`]s.
    pub rooms: RoaringBitmap,
    /// Indices into [`World::movers`].
    pub movers: RoaringBitmap,
    /// Indices into [`Rooms::objects`](sightline_world::rooms::Rooms::objects).
    pub objects: RoaringBitmap,
}

impl VisibilitySet {
    /// What may be visible from a viewpoint.
    pub fn of(world: &World, index: &RoomIndex, viewpoint: &Viewpoint) -> Self {
        let cells = &world.cells;
        let sight = ViewpointSight::new(world, index, viewpoint);
        let mut near = Vec::new();
        cells.overlapping(&viewpoint.eyes, &mut near);
        let pvs = cells.visible_from(&viewpoint.eyes);
        // An eye in no cell may see every cell.
        let pvs = if near.is_empty() { (0..cells.cells.len() as u32).collect() } else { pvs };
        let seen = |cell: &u32| sight.sees(&cells.cells[*cell as usize].bounds);
        let seen: RoaringBitmap = pvs.iter().filter(seen).collect();
        let shows = |region: &Aabb| {
            let mut around = Vec::new();
            cells.overlapping(region, &mut around);
            let is_seen = around.is_empty() || around.iter().any(|cell| seen.contains(cell.0));
            is_seen && sight.sees(region)
        };
        let own = |region: &Aabb| cells.axes.own_box(region);
        let numbered = |places: &mut dyn Iterator<Item = Aabb>| -> RoaringBitmap {
            (0u32..).zip(places).filter(|(_, place)| shows(place)).map(|(at, _)| at).collect()
        };
        let rooms =
            (0..index.len() as u16).map(|id| index.bounds(RoomId(id)).intersection(&cells.bounds));
        Self {
            movers: numbered(&mut world.movers.iter().map(|mover| own(&mover.everywhere()))),
            objects: numbered(&mut index.objects.iter().copied()),
            rooms: numbered(&mut rooms.into_iter()),
            cells: seen,
        }
    }

    /// The union of two sets.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            cells: &self.cells | &other.cells,
            rooms: &self.rooms | &other.rooms,
            movers: &self.movers | &other.movers,
            objects: &self.objects | &other.objects,
        }
    }
}

/// What rooms show from one viewpoint.
struct ViewpointSight<'a> {
    world: &'a World,
    index: &'a RoomIndex,
    field: BooleanRegion,
    eyes: RoomOverlap,
    /// For each restricting room that some eye may be in, what its windows show.
    windows: Vec<(RoomId, BooleanRegion)>,
}

impl<'a> ViewpointSight<'a> {
    fn new(world: &'a World, index: &'a RoomIndex, viewpoint: &Viewpoint) -> Self {
        let eyes = index.overlap(&world.cells, &[viewpoint.eyes]);
        let seen = |id: &RoomId| (*id, index.seen(*id, viewpoint));
        let windows = eyes.restricting.iter().map(seen).collect();
        Self { world, index, field: BooleanRegion::within(viewpoint.field()), eyes, windows }
    }

    /// Whether some of a box may be seen: may be wrongly true, never wrongly false.
    fn sees(&self, region: &Aabb) -> bool {
        if !self.field.meets(region) {
            return false;
        }
        let overlap = self.index.overlap(&self.world.cells, &[*region]);
        let shows = |(id, windows): &(RoomId, BooleanRegion)| {
            self.index.shows_by_set(*id, &overlap) || windows.meets(region)
        };
        self.eyes.may_share_sealed_rooms(&overlap)
            && (self.eyes.is_bare || self.windows.iter().any(shows))
    }
}

/// How near two viewpoints have to be to share a visibility set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewpointTolerance {
    /// The greatest difference of their eyes along each axis, in metres.
    pub eye_m: f32,
    /// The greatest difference of their yaws, and of their pitches, in radians.
    pub look: f32,
}

/// The visibility sets of several viewpoints. Each is good for all viewpoints within a tolerance.
#[derive(Clone, Debug)]
pub struct VisibilitySets {
    tolerance: ViewpointTolerance,
    /// The angles of the field of view, across and upright, in radians.
    field: [f32; 2],
    /// Sorted by last use: the latest comes last.
    kept: Vec<(Pose, VisibilitySet)>,
    made: u64,
}

impl VisibilitySets {
    /// The most sets that are kept. The least recently used one is dropped first.
    pub const KEPT_MAX: usize = 64;

    /// Keeps no set yet. `field` has the angles of the field of view, across and upright, in
    /// radians.
    pub fn new(tolerance: ViewpointTolerance, field: [f32; 2]) -> Self {
        Self { tolerance, field, kept: Vec::new(), made: 0 }
    }

    /// What may be visible from a viewpoint. A set that was made for a viewpoint within the
    /// tolerance is used again.
    pub fn at(&mut self, world: &World, index: &RoomIndex, pose: &Pose) -> &VisibilitySet {
        let known = self.kept.iter().position(|(of, _)| self.is_near(of, pose));
        let entry = match known {
            Some(at) => self.kept.remove(at),
            None => {
                if self.kept.len() >= Self::KEPT_MAX {
                    self.kept.remove(0);
                }
                self.made += 1;
                (*pose, VisibilitySet::of(world, index, &self.viewpoint(world, pose)))
            }
        };
        self.kept.push(entry);
        assert!(self.kept.len() <= Self::KEPT_MAX, "the oldest set was dropped");
        &self.kept[self.kept.len() - 1].1
    }

    /// What may be visible on the straight way from one viewpoint to another: the union of their
    /// two sets. Where their tolerances leave a gap, sets on the way between them are added.
    pub fn between(
        &mut self,
        world: &World,
        index: &RoomIndex,
        from: &Pose,
        to: &Pose,
    ) -> VisibilitySet {
        let turn = (to.yaw - from.yaw + PI).rem_euclid(2.0 * PI) - PI;
        let far = (to.eye - from.eye).abs().max_element() / self.tolerance.eye_m.max(1e-3);
        let turned = turn.abs().max((to.pitch - from.pitch).abs()) / self.tolerance.look.max(1e-3);
        let steps = far.max(turned).ceil().clamp(1.0, 1_000.0) as u32;
        let mut all = self.at(world, index, from).clone();
        for step in 1..=steps {
            let share = step as f32 / steps as f32;
            let eye = from.eye.lerp(to.eye, share);
            let (yaw, pitch) =
                (from.yaw + turn * share, from.pitch + (to.pitch - from.pitch) * share);
            all = all.union(self.at(world, index, &Pose { eye, yaw, pitch, ..Pose::default() }));
        }
        all
    }

    /// The number of sets made so far.
    pub fn made(&self) -> u64 {
        self.made
    }

    fn is_near(&self, a: &Pose, b: &Pose) -> bool {
        let turn = (a.yaw - b.yaw + PI).rem_euclid(2.0 * PI) - PI;
        (a.eye - b.eye).abs().max_element() <= self.tolerance.eye_m
            && turn.abs().max((a.pitch - b.pitch).abs()) <= self.tolerance.look
    }

    /// All viewpoints within the tolerance of one, or between it and the next set on the way.
    fn viewpoint(&self, world: &World, pose: &Pose) -> Viewpoint {
        let axes = &world.cells.axes;
        let around = Aabb::around(pose.eye, self.tolerance.eye_m * 2.0);
        // Yaw and pitch together move a direction by at most twice the tolerance. Towards the
        // corners of a picture, its sides are half as far apart as in the middle.
        let [across, upright] = self.field.map(|angle| angle + 8.0 * self.tolerance.look);
        let field = Frustum::new(pose.yaw, pose.pitch, across, upright);
        Viewpoint::looking(axes.own_box(&around), &field, axes)
    }
}
