//! Which voxels and movers of a building rooms show to an eye.
//!
//! An eye outside an opaque room is not shown what is behind that room. Everything else is shown to
//! an eye in no room that restricts what is seen from it. In such a room:
//!
//! * A set of what is visible shows the voxels in its places.
//! * A set of what is hidden shows all voxels but those in its places.
//! * A window shows the voxels of which it shows some part.
//!
//! An eye in several such rooms is shown what any of them shows.
//!
//! A surface lies on the boundary of its place, and its voxels reach beyond it. So a voxel is in
//! the place of an object when it reaches out of it by no more than its own edge. A visible room or
//! cell has the walls around it, too, with the frames of doors: a voxel may reach out by
//! [`WALL_M`]. A voxel is in a hidden room or cell only when all of it is: the other side of a wall
//! stays. A hidden object leaves the floor below it: its place reaches no further down than the
//! object.
//!
//! Movers are not made of voxels. A mover that a set names is itself shown or hidden, and the
//! voxels around it are not. A mover counts with the box that it never leaves: some of that box in
//! a visible place is enough to show it, and all of it in a hidden place is needed to hide it.

use glam::Vec3;
use sightline_world::{
    Mover, World,
    geometry::{Aabb, Axes},
    rooms::RoomId,
    tolerance::ROOM_BOUNDARY_M,
};

use super::{
    index::{NamedMembers, RoomIndex, VisibilityRule},
    pieces::ConvexPiece,
    region::BooleanRegion,
    sight::Viewpoint,
};
use crate::{Containment, HalfSpace};

/// A box of voxels holds no voxel of a place when it shares less than this part of a voxel's edge
/// with it, along some axis.
const WHOLE_VOXEL: f32 = 0.999;
/// How thick the walls around a visible room or cell may be to belong to it, in metres.
const WALL_M: f32 = 0.3;

/// Which voxels and movers of a building rooms show to one eye.
#[derive(Clone, Debug)]
pub struct BuildingSight {
    eye: Vec3,
    axes: Axes,
    /// The edge of a voxel, in metres.
    voxel: f32,
    /// The restricting rooms around the eye. Where there is none, everything is shown that no
    /// opaque room hides.
    rooms: Vec<RoomSight>,
    /// What each opaque room hides, in own axes.
    hidden: Vec<BooleanRegion>,
}

/// What one room shows.
#[derive(Clone, Debug)]
struct RoomSight {
    /// Whether the room's set says what is hidden, and not what is visible.
    hides: bool,
    /// The places of the set, without movers.
    places: Vec<Place>,
    /// The places of the movers in the set.
    movers: Vec<Place>,
    windows: BooleanRegion,
}

/// A convex place of a set, in own axes, as far as its voxels reach.
#[derive(Clone, Debug)]
struct Place {
    bounds: Aabb,
    sides: Vec<HalfSpace>,
}

impl BuildingSight {
    /// What the rooms of a world show to an eye in the world's axes. `None` when they show
    /// everything.
    pub fn of(world: &World, index: &RoomIndex, eye: Vec3) -> Option<Self> {
        if !index.is_restricting && index.opaque.is_empty() {
            return None;
        }
        let own = index.axes.own(eye);
        let viewpoint = Viewpoint::all_round(Aabb::new(own, own));
        let restricting = index.at(eye).filter(|id| index.room(*id).restricts);
        let rooms: Vec<RoomSight> =
            restricting.map(|id| RoomSight::new(world, index, id, &viewpoint)).collect();
        let voxel = world.octree.voxel();
        let wall_m = voxel.max(WALL_M) * index.axes.widening();
        let opaque = index.opaque.iter().filter_map(|id| index.room(*id).opaque.as_ref());
        let building = index.axes.own_box(&world.octree.bounds());
        let hidden = opaque.filter_map(|room| room.hidden_from(own, wall_m));
        let hidden: Vec<_> = hidden.filter(|hidden| hidden.meets(&building)).collect();
        let is_all = rooms.is_empty() && hidden.is_empty();
        (!is_all).then_some(Self { eye, axes: index.axes, voxel, rooms, hidden })
    }

    /// The eye, in the world's axes.
    pub fn eye(&self) -> Vec3 {
        self.eye
    }

    /// How many of the voxels in a box of the world are shown: all, none, or it is not known.
    pub fn containment(&self, region: &Aabb) -> Containment {
        let own = self.axes.own_box(region);
        let mut shown = self.by_rooms(&own);
        for hidden in &self.hidden {
            match hidden.containment(&own) {
                Containment::Inside => return Containment::Outside,
                Containment::Partial if shown == Containment::Inside => {
                    shown = Containment::Partial;
                }
                Containment::Partial | Containment::Outside => {}
            }
        }
        shown
    }

    /// How many of the voxels in a box the rooms around the eye show.
    fn by_rooms(&self, own: &Aabb) -> Containment {
        if self.rooms.is_empty() {
            return Containment::Inside;
        }
        let mut shown = Containment::Outside;
        for room in &self.rooms {
            for part in [room.by_set(own, self.voxel), room.windows.containment(own)] {
                match part {
                    Containment::Inside => return Containment::Inside,
                    Containment::Partial => shown = Containment::Partial,
                    Containment::Outside => (),
                }
            }
        }
        shown
    }

    /// Whether a voxel is shown, given as a box of the world.
    pub fn shows(&self, voxel: &Aabb) -> bool {
        let own = self.axes.own_box(voxel);
        let holds = |room: &RoomSight| room.places.iter().any(|place| place.holds(&own));
        let shows = |room: &RoomSight| holds(room) != room.hides || room.windows.meets(&own);
        !self.is_behind(&own) && (self.rooms.is_empty() || self.rooms.iter().any(shows))
    }

    /// Whether some of a mover of the world may be shown, wherever it is on its way: never wrongly
    /// denied.
    pub fn may_show(&self, mover: &Mover) -> bool {
        let own = self.axes.own_box(&mover.everywhere());
        let by_rooms = self.rooms.is_empty() || self.rooms.iter().any(|room| room.may_show(&own));
        by_rooms && !self.is_behind(&own)
    }

    /// Whether an opaque room hides all of a box.
    fn is_behind(&self, own: &Aabb) -> bool {
        self.hidden.iter().any(|hidden| hidden.containment(own) == Containment::Inside)
    }
}

impl RoomSight {
    fn new(world: &World, index: &RoomIndex, id: RoomId, viewpoint: &Viewpoint) -> Self {
        let rule = &index.room(id).rule;
        let hides = matches!(rule, VisibilityRule::AllBut(_));
        let mut places = room_and_cell_places(world, index, rule.named(), hides);
        let [objects, movers] = object_places(world, index, rule.named(), hides);
        places.extend(objects);
        Self { hides, places, movers, windows: index.seen(id, viewpoint) }
    }

    /// Whether some of a mover that never leaves a box may be shown.
    fn may_show(&self, region: &Aabb) -> bool {
        let mut places = self.places.iter().chain(&self.movers);
        let by_set = if self.hides {
            !places.any(|place| place.holds(region))
        } else {
            places.any(|place| place.may_share(region, 0.0))
        };
        by_set || self.windows.meets(region)
    }

    /// How many of the voxels in a box the set shows.
    fn by_set(&self, region: &Aabb, voxel: f32) -> Containment {
        let all = self.places.iter().any(|place| place.holds(region));
        let least = voxel * WHOLE_VOXEL;
        let some = || self.places.iter().any(|place| place.may_share(region, least));
        match (all, self.hides) {
            (true, false) => Containment::Inside,
            (true, true) => Containment::Outside,
            (false, _) if some() => Containment::Partial,
            (false, false) => Containment::Outside,
            (false, true) => Containment::Inside,
        }
    }
}

/// The places of the rooms and cells of a set.
fn room_and_cell_places(
    world: &World,
    index: &RoomIndex,
    named: &NamedMembers,
    hides: bool,
) -> Vec<Place> {
    let reach = if hides { 0.0 } else { world.octree.voxel().max(WALL_M) };
    let grown = reach * index.axes.widening() + ROOM_BOUNDARY_M;
    let rooms = named.rooms.iter().flat_map(|id| index.pieces(RoomId(id as u16)));
    let cells = named.cells.iter().filter_map(|id| world.cells.cells.get(id as usize));
    let rooms = rooms.map(|piece| Place::around(piece, grown));
    rooms.chain(cells.map(|cell| Place::of(cell.bounds.grown(grown)))).collect()
}

/// The places of the objects of a set: of nodes of the model, and of movers.
fn object_places(
    world: &World,
    index: &RoomIndex,
    named: &NamedMembers,
    hides: bool,
) -> [Vec<Place>; 2] {
    let grown = world.octree.voxel() * index.axes.widening() + ROOM_BOUNDARY_M;
    let [mut nodes, mut movers] = [Vec::new(), Vec::new()];
    for at in named.objects.iter().map(|at| *at as usize) {
        let Some(bounds) = index.objects.get(at) else { continue };
        let is_mover = world.rooms.objects().get(at).is_some_and(|object| object.mover.is_some());
        if is_mover {
            movers.push(Place::of(bounds.grown(ROOM_BOUNDARY_M)));
            continue;
        }
        let mut place = Place::of(bounds.grown(grown));
        if hides {
            place.bounds.min.y = bounds.min.y - ROOM_BOUNDARY_M;
        }
        nodes.push(place);
    }
    [nodes, movers]
}

impl Place {
    fn of(bounds: Aabb) -> Self {
        Self { bounds, sides: Vec::new() }
    }

    /// A convex piece, grown by a length in metres along each axis.
    fn around(piece: &ConvexPiece, grown: f32) -> Self {
        let sides = piece.sides.iter();
        let sides =
            sides.map(|side| side.moved(f64::from(grown) * side.normal.abs().element_sum()));
        Self { bounds: piece.bounds.grown(grown), sides: sides.collect() }
    }

    /// Whether all of a box is inside.
    fn holds(&self, region: &Aabb) -> bool {
        let inside = |side: &HalfSpace| side.containment(region) == Containment::Inside;
        self.bounds.contains_box(region) && self.sides.iter().all(inside)
    }

    /// Whether a box may share with the place a length of at least `least` along each axis, in
    /// metres: may be wrongly true, never wrongly false.
    fn may_share(&self, region: &Aabb, least: f32) -> bool {
        let shared = self.bounds.intersection(region).size();
        let outside = |side: &HalfSpace| side.containment(region) == Containment::Outside;
        shared.min_element() >= least && !self.sides.iter().any(outside)
    }
}

#[cfg(test)]
mod tests;
