//! Who may see whom by rooms, and which room is where.

use glam::Vec3;
use roaring::RoaringBitmap;

use super::{
    RoomOverlap, SealedRooms,
    pieces::{ConvexPiece, cover},
    region::BooleanRegion,
    sight::{RoomWindows, Viewpoint},
};
use sightline_world::{
    CellId, Cells, World,
    geometry::{Aabb, Axes},
    rooms::{ObjectSet, Room, RoomId, RoomVisibility, Rooms},
    tolerance::ROOM_BOUNDARY_M,
};

/// The rooms of a world, ready to be asked. All places are in own axes, but where the world is named.
///
/// Ask [`RoomIndex::overlap`] once for each region, whenever that changes, and [`RoomIndex::may_see`]
/// for each pair: a comparison of short lists, and windows only where those leave it open. Both
/// decide for regions, on their safe side. What is *told* goes through [`RoomIndex::sealed_rooms_at`] besides:
/// people whose last accepted places differ in their sealed rooms are never told of each other,
/// however near to the wall they are.
///
/// ```
/// # use glam::Vec3;
/// # use sightline_shared::{geometry::Aabb, octree::Octree, rooms::*, world::*};
/// # fn example(world: &World, eyes: Aabb, body: Aabb) -> bool {
/// let rooms = RoomIndex::new(world);
/// let viewer = rooms.overlap(&world.cells, &[eyes]);
/// let avatar = rooms.overlap(&world.cells, &[body]);
/// rooms.may_see(&viewer, &avatar)
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct RoomIndex {
    axes: Axes,
    halls: Vec<IndexedRoom>,
    /// The places of [`Rooms::objects`].
    objects: Vec<Aabb>,
    /// For each cell the rooms that have a part in it, ascending.
    near: Vec<Vec<RoomId>>,
    /// The cells that one room holds all of that says what may be seen.
    covered: RoaringBitmap,
    /// Rooms that reach beyond the building.
    unbounded: Vec<RoomId>,
    sealed: Vec<RoomId>,
    restricting: bool,
    names_cells: bool,
}

/// A room, ready to be asked.
#[derive(Clone, Debug)]
struct IndexedRoom {
    bounds: Aabb,
    pieces: Vec<ConvexPiece>,
    panes: RoomWindows,
    restricts: bool,
    sealed: bool,
    rule: VisibilityRule,
    /// The rooms that something of may show through the windows, if not by the set.
    through: RoaringBitmap,
}

/// What a set says.
#[derive(Clone, Debug)]
enum VisibilityRule {
    Only(NamedMembers),
    AllBut(NamedMembers),
}

#[derive(Clone, Debug, Default)]
struct NamedMembers {
    rooms: RoaringBitmap,
    cells: RoaringBitmap,
    objects: Vec<u32>,
}

/// What somebody in one room may see of somebody in another, by rooms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoomVerdict {
    /// Whatever cells give.
    Always,
    /// Nothing.
    Never,
    /// What windows show.
    Windows,
}

impl RoomIndex {
    /// The rooms of a world.
    pub fn new(world: &World) -> Self {
        Self::of(&world.rooms, &world.cells)
    }

    /// Rooms in a subdivision.
    pub fn of(rooms: &Rooms, cells: &Cells) -> Self {
        let axes = cells.axes;
        let halls: Vec<IndexedRoom> = rooms
            .list()
            .iter()
            .zip(0u16..)
            .map(|(room, id)| IndexedRoom::new(room, RoomId(id), &axes))
            .collect();
        let objects = rooms.objects().iter().map(|object| axes.own_box(&object.bounds)).collect();
        let sealed = (0u16..).zip(&halls).filter(|(_, hall)| hall.sealed);
        let mut index = Self {
            axes,
            objects,
            near: vec![Vec::new(); if halls.is_empty() { 0 } else { cells.cells.len() }],
            covered: RoaringBitmap::new(),
            unbounded: Vec::new(),
            sealed: sealed.map(|(id, _)| RoomId(id)).collect(),
            restricting: halls.iter().any(|hall| hall.restricts),
            names_cells: halls.iter().any(|hall| !hall.named().cells.is_empty()),
            halls,
        };
        index.find_cells(cells);
        index.look_through_windows(cells);
        index
    }

    /// Whether there are no rooms.
    pub fn is_empty(&self) -> bool {
        self.halls.is_empty()
    }

    /// Whether rooms rule out anything at all: without, every pair may see each other.
    pub fn rules(&self) -> bool {
        self.restricting || !self.sealed.is_empty()
    }

    /// The rooms of a region, which is some boxes in own axes.
    pub fn overlap(&self, cells: &Cells, boxes: &[Aabb]) -> RoomOverlap {
        if self.halls.is_empty() {
            return RoomOverlap { is_bare: true, ..RoomOverlap::default() };
        }
        RoomOverlap::new(self, cells, boxes)
    }

    /// The rooms of what some cells, ascending, have of a region: of somebody who can be in these cells only,
    /// whatever walls the boxes reach through.
    pub fn overlap_in_cells(&self, cells: &Cells, boxes: &[Aabb], found: &[CellId]) -> RoomOverlap {
        if self.halls.is_empty() {
            return RoomOverlap { is_bare: true, ..RoomOverlap::default() };
        }
        RoomOverlap::within_cells(self, cells, boxes, found)
    }

    /// Whether somebody whose eye is somewhere in one region may, by rooms, see something of a body
    /// that is somewhere in another: not denied unless it is for all places in them. A region that is
    /// part of another is denied wherever that is.
    pub fn may_see(&self, eyes: &RoomOverlap, body: &RoomOverlap) -> bool {
        if !eyes.may_share_seals(body) {
            return false;
        }
        eyes.is_bare || eyes.restricting.iter().any(|id| self.shows(*id, eyes, body))
    }

    /// What somebody who is all in one room, and in no other, may see of somebody who is all in
    /// another, and in no other.
    pub fn verdict(&self, from: RoomId, to: RoomId) -> RoomVerdict {
        let hall = &self.halls[usize::from(from.0)];
        let is_sealed = from != to && (hall.sealed || self.halls[usize::from(to.0)].sealed);
        let named = hall.named();
        let is_shown = match &hall.rule {
            VisibilityRule::Only(named) => named.rooms.contains(to.0.into()),
            VisibilityRule::AllBut(named) => !named.rooms.contains(to.0.into()),
        };
        let may_be = !named.cells.is_empty() || !named.objects.is_empty();
        if is_sealed {
            RoomVerdict::Never
        } else if is_shown || !hall.restricts {
            RoomVerdict::Always
        } else if hall.through.contains(to.0.into()) || may_be {
            RoomVerdict::Windows
        } else {
            RoomVerdict::Never
        }
    }

    /// The sealed rooms that a point of the world is in.
    pub fn sealed_rooms_at(&self, point: Vec3) -> SealedRooms {
        let own = self.axes.own(point);
        SealedRooms::of(
            self.sealed.iter().copied().filter(|id| self.halls[usize::from(id.0)].contains(own)),
        )
    }

    /// The rooms that a point of the world is in, ascending.
    pub fn at(&self, point: Vec3) -> impl Iterator<Item = RoomId> + '_ {
        let own = self.axes.own(point);
        (0u16..)
            .zip(&self.halls)
            .filter(move |(_, hall)| hall.contains(own))
            .map(|(id, _)| RoomId(id))
    }

    /// The smallest room that a point of the world is in, if it is in one.
    pub fn room_at(&self, point: Vec3) -> Option<RoomId> {
        let size = |id: &RoomId| {
            let pieces = &self.halls[usize::from(id.0)].pieces;
            pieces.iter().map(|piece| piece.bounds.size().as_dvec3().element_product()).sum::<f64>()
        };
        self.at(point).min_by(|a, b| size(a).total_cmp(&size(b)))
    }

    /// What is seen from a viewpoint through the windows of a room that it is in: around all that any
    /// of the eyes sees.
    pub fn seen(&self, room: RoomId, viewpoint: &Viewpoint) -> BooleanRegion {
        self.halls[usize::from(room.0)].panes.seen(viewpoint)
    }

    /// The windows of a room that are in the field of view, nearest first.
    pub fn windows_in_view(&self, room: RoomId, viewpoint: &Viewpoint) -> Vec<u32> {
        self.halls[usize::from(room.0)].panes.in_view(viewpoint)
    }

    /// The convex pieces of a room.
    pub fn pieces(&self, room: RoomId) -> &[ConvexPiece] {
        &self.halls[usize::from(room.0)].pieces
    }

    /// How many rooms there are.
    pub fn len(&self) -> usize {
        self.halls.len()
    }

    /// The smallest box around a room.
    pub fn bounds(&self, room: RoomId) -> Aabb {
        self.halls[usize::from(room.0)].bounds
    }

    /// The places of [`Rooms::objects`].
    pub(super) fn objects(&self) -> &[Aabb] {
        &self.objects
    }

    pub(super) fn axes(&self) -> &Axes {
        &self.axes
    }

    /// Whether somebody in a room is shown some of a body by its set, or through its windows.
    pub(super) fn shows(&self, id: RoomId, eyes: &RoomOverlap, body: &RoomOverlap) -> bool {
        let hall = &self.halls[usize::from(id.0)];
        if self.shows_by_set(id, body) {
            return true;
        }
        if hall.panes.is_empty() {
            return false;
        }
        // Who is all in a room into which no window leads need not be looked for.
        if body.within.iter().any(|id| !hall.through.contains(id.0.into())) {
            return false;
        }
        let inside = |from: &Aabb| from.intersection(&hall.bounds.grown(ROOM_BOUNDARY_M));
        let looks = |from: &Aabb| body.boxes.iter().any(|body| hall.panes.show(from, body));
        eyes.boxes.iter().map(inside).filter(|from| !from.is_empty()).any(|from| looks(&from))
    }

    /// Whether some of a body may belong to what a room shows by its set.
    pub(super) fn shows_by_set(&self, id: RoomId, body: &RoomOverlap) -> bool {
        match &self.halls[usize::from(id.0)].rule {
            VisibilityRule::Only(named) => {
                body.touched.iter().any(|room| named.rooms.contains(room.0.into()))
                    || body.cells.iter().any(|cell| named.cells.contains(cell.0))
                    || body
                        .boxes
                        .iter()
                        .any(|body| self.named_near(named).any(|at| at.intersects(body)))
            }
            VisibilityRule::AllBut(named) => {
                let in_cells = |overlap: &RoomOverlap| {
                    !overlap.cells.is_empty()
                        && overlap.cells.iter().all(|cell| named.cells.contains(cell.0))
                };
                let in_objects = |overlap: &RoomOverlap| {
                    let holds =
                        |body: &Aabb| self.named_near(named).any(|at| at.contains_box(body));
                    !overlap.boxes.is_empty() && overlap.boxes.iter().all(holds)
                };
                let in_rooms = body.within.iter().any(|room| named.rooms.contains(room.0.into()));
                !in_rooms && !in_cells(body) && !in_objects(body)
            }
        }
    }

    fn named_near<'a>(&'a self, named: &'a NamedMembers) -> impl Iterator<Item = &'a Aabb> {
        named.objects.iter().filter_map(|at| self.objects.get(*at as usize))
    }

    pub(super) fn restricts(&self, id: RoomId) -> bool {
        self.halls[usize::from(id.0)].restricts
    }

    pub(super) fn is_sealed(&self, id: RoomId) -> bool {
        self.halls[usize::from(id.0)].sealed
    }

    pub(super) fn names_cells(&self) -> bool {
        self.names_cells
    }

    pub(super) fn unbounded(&self) -> impl Iterator<Item = RoomId> + '_ {
        self.unbounded.iter().copied()
    }

    /// The rooms that have a part in a cell, ascending.
    pub(super) fn rooms_near(&self, cell: CellId) -> &[RoomId] {
        self.near.get(cell.0 as usize).map_or(&[], Vec::as_slice)
    }

    /// Whether some of a box may be in a room: never wrongly denied.
    pub(super) fn meets(&self, id: RoomId, region: &Aabb) -> bool {
        self.halls[usize::from(id.0)].pieces.iter().any(|piece| piece.meets(region))
    }

    /// Whether all of a box is in a room; sometimes denied though it is.
    pub(super) fn covers(&self, id: RoomId, region: &Aabb) -> bool {
        cover(self.pieces(id).iter(), region)
    }

    /// Whether an eye somewhere in a box, which overlaps some cells, may be in no room that says what may
    /// be seen. Eyes are in cells, or a little way into what is solid.
    pub(super) fn is_bare(&self, cells: &Cells, region: &Aabb, found: &[CellId]) -> bool {
        if !self.restricting {
            return true;
        }
        let covered = |part: &Aabb, near: &[RoomId]| {
            let near = near.iter().filter(|id| self.restricts(**id));
            cover(near.flat_map(|id| self.pieces(*id)), part)
        };
        let overlaps = |cell: &&CellId| cells.cells[cell.0 as usize].bounds.intersects(region);
        !found.iter().any(|cell| overlaps(&cell))
            || found.iter().filter(overlaps).any(|cell| {
                let part = cells.cells[cell.0 as usize].bounds.intersection(region);
                !self.covered.contains(cell.0)
                    && !part.is_empty()
                    && !covered(&part, self.rooms_near(*cell))
            })
    }

    /// Which rooms are where.
    fn find_cells(&mut self, cells: &Cells) {
        let mut found = Vec::new();
        for (id, hall) in (0u16..).map(RoomId).zip(&self.halls) {
            found.clear();
            for piece in &hall.pieces {
                let start = found.len();
                cells.overlapping(&piece.bounds.intersection(&cells.bounds), &mut found);
                let near = |cell: &CellId| piece.meets(&cells.cells[cell.0 as usize].bounds);
                let kept: Vec<CellId> = found.drain(start..).filter(near).collect();
                found.extend(kept);
            }
            found.sort_unstable();
            found.dedup();
            for cell in &found {
                self.near[cell.0 as usize].push(id);
                let bounds = &cells.cells[cell.0 as usize].bounds;
                if hall.restricts && cover(hall.pieces.iter(), bounds) {
                    self.covered.insert(cell.0);
                }
            }
            if !cells.bounds.contains_box(&hall.bounds) {
                self.unbounded.push(id);
            }
        }
    }

    /// Finds for each room the others that its windows may show: by cells, and by the windows as seen
    /// from all of the room.
    fn look_through_windows(&mut self, cells: &Cells) {
        let mut of_room: Vec<RoaringBitmap> = vec![RoaringBitmap::new(); self.halls.len()];
        for (cell, rooms) in (0u32..).zip(&self.near) {
            for id in rooms {
                of_room[usize::from(id.0)].insert(cell);
            }
        }
        for (at, here) in of_room.iter().enumerate() {
            let hall = &self.halls[at];
            if hall.panes.is_empty() {
                continue;
            }
            let mut seen = RoaringBitmap::new();
            here.iter().for_each(|cell| seen |= &cells.pvs[cell as usize]);
            let mut others: Vec<RoomId> =
                seen.iter().flat_map(|cell| &self.near[cell as usize]).copied().collect();
            others.sort_unstable();
            others.dedup();
            let eyes = hall.bounds.intersection(&cells.bounds.grown(1.0));
            let shows = |id: &RoomId| hall.panes.show(&eyes, &self.halls[usize::from(id.0)].bounds);
            let through = others.iter().filter(|id| shows(id)).map(|id| u32::from(id.0)).collect();
            self.halls[at].through = through;
        }
    }
}

impl IndexedRoom {
    fn new(room: &Room, id: RoomId, axes: &Axes) -> Self {
        let pieces: Vec<ConvexPiece> =
            room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, axes)).collect();
        let panes = RoomWindows::new(room, &pieces, axes);
        let rule = match &room.sees {
            // With windows and without a set, a room shows itself.
            RoomVisibility::Unspecified => {
                VisibilityRule::Only(NamedMembers::with(&ObjectSet::default(), Some(id)))
            }
            RoomVisibility::Only(members) => {
                VisibilityRule::Only(NamedMembers::with(members, Some(id)))
            }
            RoomVisibility::AllBut(members) => {
                VisibilityRule::AllBut(NamedMembers::with(members, None))
            }
        };
        Self {
            bounds: pieces.iter().fold(Aabb::EMPTY, |all, piece| all.union(&piece.bounds)),
            restricts: room.restricts() && !pieces.is_empty(),
            sealed: room.sealed,
            pieces,
            panes,
            rule,
            through: RoaringBitmap::new(),
        }
    }

    /// Whether a point in own axes is inside.
    fn contains(&self, own: Vec3) -> bool {
        self.bounds.contains(own) && self.pieces.iter().any(|piece| piece.contains(own))
    }

    fn named(&self) -> &NamedMembers {
        match &self.rule {
            VisibilityRule::Only(named) | VisibilityRule::AllBut(named) => named,
        }
    }
}

impl NamedMembers {
    fn with(members: &ObjectSet, own: Option<RoomId>) -> Self {
        Self {
            rooms: members.rooms.iter().chain(&own).map(|id| u32::from(id.0)).collect(),
            cells: members.cells.iter().map(|cell| cell.0).collect(),
            objects: members.objects.clone(),
        }
    }
}
