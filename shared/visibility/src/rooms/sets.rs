//! All that may be visible from a viewpoint, by cells and rooms together; kept for viewpoints near by, and
//! joined while a camera is on its way from one to the next.

use std::f32::consts::PI;

use roaring::RoaringBitmap;

use super::{RoomIndex, region::BooleanRegion, sight::Viewpoint};
use sightline_world::{
    World,
    geometry::{Aabb, Frustum},
    motion::Pose,
    rooms::RoomId,
};

/// What may be visible. Never too small, relative to what rooms declare.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct VisibilitySet {
    /// Cells.
    pub cells: RoaringBitmap,
    /// Rooms, by [`RoomId`].
    pub rooms: RoaringBitmap,
    /// Indices into [`World::movers`].
    pub movers: RoaringBitmap,
    /// Indices into [`Rooms::objects`](super::Rooms::objects).
    pub objects: RoaringBitmap,
}

impl VisibilitySet {
    /// What may be visible from a viewpoint.
    pub fn of(world: &World, index: &RoomIndex, viewpoint: &Viewpoint) -> Self {
        let cells = &world.cells;
        let looker = ViewpointSight::new(world, index, viewpoint);
        let mut near = Vec::new();
        cells.overlapping(&viewpoint.eyes, &mut near);
        let given = cells.visible_from(&viewpoint.eyes);
        // An eye in no cell sees what it may.
        let given = if near.is_empty() { (0..cells.cells.len() as u32).collect() } else { given };
        let seen = |cell: &u32| looker.sees(&cells.cells[*cell as usize].bounds);
        let seen: RoaringBitmap = given.iter().filter(seen).collect();
        let shows = |region: &Aabb| {
            let mut around = Vec::new();
            cells.overlapping(region, &mut around);
            let is_seen = around.is_empty() || around.iter().any(|cell| seen.contains(cell.0));
            is_seen && looker.sees(region)
        };
        let own = |region: &Aabb| cells.axes.own_box(region);
        let numbered = |places: &mut dyn Iterator<Item = Aabb>| -> RoaringBitmap {
            (0u32..).zip(places).filter(|(_, place)| shows(place)).map(|(at, _)| at).collect()
        };
        let rooms =
            (0..index.len() as u16).map(|id| index.bounds(RoomId(id)).intersection(&cells.bounds));
        Self {
            movers: numbered(&mut world.movers.iter().map(|mover| own(&mover.everywhere()))),
            objects: numbered(&mut index.objects().iter().copied()),
            rooms: numbered(&mut rooms.into_iter()),
            cells: seen,
        }
    }

    /// What is in either.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            cells: &self.cells | &other.cells,
            rooms: &self.rooms | &other.rooms,
            movers: &self.movers | &other.movers,
            objects: &self.objects | &other.objects,
        }
    }
}

/// What rooms show of boxes, from one viewpoint.
struct ViewpointSight<'a> {
    world: &'a World,
    index: &'a RoomIndex,
    field: BooleanRegion,
    eyes: super::RoomOverlap,
    /// For each room that some eye is in, what its windows show.
    windows: Vec<(RoomId, BooleanRegion)>,
}

impl<'a> ViewpointSight<'a> {
    fn new(world: &'a World, index: &'a RoomIndex, viewpoint: &Viewpoint) -> Self {
        let eyes = index.overlap(&world.cells, &[viewpoint.eyes]);
        let seen = |id: &RoomId| (*id, index.seen(*id, viewpoint));
        let windows = eyes.restricting.iter().map(seen).collect();
        Self { world, index, field: BooleanRegion::within(viewpoint.field()), eyes, windows }
    }

    fn sees(&self, region: &Aabb) -> bool {
        if !self.field.meets(region) {
            return false;
        }
        let place = self.index.overlap(&self.world.cells, &[*region]);
        let shows = |(id, windows): &(RoomId, BooleanRegion)| {
            self.index.shows_by_set(*id, &place) || windows.meets(region)
        };
        self.eyes.may_share_seals(&place) && (self.eyes.is_bare || self.windows.iter().any(shows))
    }
}

/// How near to each other viewpoints are that share a set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewpointTolerance {
    /// Between their eyes, along each axis, in metres.
    pub eye_m: f32,
    /// Between their looks, sideways and upwards, in radians.
    pub look: f32,
}

/// The visibility sets of some viewpoints, each good for all viewpoints within a tolerance.
#[derive(Clone, Debug)]
pub struct VisibilitySets {
    tolerance: ViewpointTolerance,
    /// The angles that a picture spans, across and upright, in radians.
    field: [f32; 2],
    /// The one used last comes last.
    kept: Vec<(Pose, VisibilitySet)>,
    made: u64,
}

impl VisibilitySets {
    /// No more are kept; the one that was not used for longest goes first.
    pub const KEPT_MAX: usize = 64;

    /// For pictures that span these angles, across and upright, in radians.
    pub fn new(tolerance: ViewpointTolerance, field: [f32; 2]) -> Self {
        Self { tolerance, field, kept: Vec::new(), made: 0 }
    }

    /// What may be visible from a viewpoint, and from all within the tolerance of one that was asked
    /// for before it and near it.
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
        &self.kept[self.kept.len() - 1].1
    }

    /// What may be visible on the way from one viewpoint to another: the union of both sets, and where
    /// the two are so far from each other that their tolerances leave a gap, of sets on the straight way
    /// between them.
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

    /// How many sets were made so far.
    pub fn made(&self) -> u64 {
        self.made
    }

    fn is_near(&self, a: &Pose, b: &Pose) -> bool {
        let turn = (a.yaw - b.yaw + PI).rem_euclid(2.0 * PI) - PI;
        (a.eye - b.eye).abs().max_element() <= self.tolerance.eye_m
            && turn.abs().max((a.pitch - b.pitch).abs()) <= self.tolerance.look
    }

    /// All eyes and looks within the tolerance, and between such a one and the next.
    fn viewpoint(&self, world: &World, pose: &Pose) -> Viewpoint {
        let axes = &world.cells.axes;
        let around = Aabb::around(pose.eye, self.tolerance.eye_m * 2.0);
        // Turned by so much both ways, a direction moves by no more than twice that; towards the
        // corners of a picture its sides are half as far apart as in the middle.
        let [across, upright] = self.field.map(|angle| angle + 8.0 * self.tolerance.look);
        let field = Frustum::new(pose.yaw, pose.pitch, across, upright);
        Viewpoint::looking(axes.own_box(&around), &field, axes)
    }
}

impl VisibilitySet {
    /// Whether some of a box of the world may be visible, by its cells.
    pub fn shows(&self, world: &World, region: &Aabb) -> bool {
        let mut cells = Vec::new();
        world.cells.overlapping(&world.cells.axes.own_box(region), &mut cells);
        cells.is_empty() || cells.iter().any(|cell| self.cells.contains(cell.0))
    }

    /// Whether a room may be visible.
    pub fn has_room(&self, room: RoomId) -> bool {
        self.rooms.contains(room.0.into())
    }
}
