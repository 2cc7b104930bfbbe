//! The rooms of a world, prepared for questions, and the rooms at a point.

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_world::{
    CellId, Cells, World,
    geometry::{Aabb, Axes},
    rooms::{ObjectSet, Room, RoomId, RoomVisibility, Rooms},
};

use super::{
    opaque::OpaqueRoom,
    pieces::{ConvexPiece, cover},
    region::BooleanRegion,
    sealed::SealedRooms,
    sight::{RoomWindows, Viewpoint},
};

/// The rooms of a world, prepared for questions. All places are in own axes, except points of the
/// world.
///
/// Find the [overlap](RoomIndex::overlap) of each region once, and again when the region changes.
/// Then ask [`RoomIndex::may_see`] for each pair of regions. It compares short lists, and windows
/// only where the lists leave the answer open.
///
/// Two avatars whose last accepted positions differ in their
/// [sealed rooms](RoomIndex::sealed_rooms_at) must not be told about each other, however near the
/// wall they are. That is for the caller to check, since regions reach across walls.
///
/// ```
/// use glam::Vec3;
/// use sightline_visibility::rooms::RoomIndex;
/// use sightline_world::{
///     geometry::Aabb,
///     rooms::{ObjectSet, Room, RoomVisibility, Rooms, Shape},
/// };
///
/// let mut world = sightline_fixtures::two_rooms::world();
/// // From the first room, only that room itself is seen.
/// let first = Room {
///     name: "first".to_owned(),
///     shapes: vec![Shape::Box(Aabb::new(Vec3::ZERO, Vec3::new(6.0, 3.0, 6.0)))],
///     sees: RoomVisibility::Only(ObjectSet::default()),
///     ..Room::default()
/// };
/// world.rooms = Rooms::new(vec![first], Vec::new())?;
///
/// let rooms = RoomIndex::new(&world);
/// let at = |x: f32| rooms.overlap(&world.cells, &[Aabb::around(Vec3::new(x, 1.5, 3.0), 0.2)]);
/// assert!(rooms.may_see(&at(2.0), &at(4.0)), "inside the room");
/// assert!(!rooms.may_see(&at(2.0), &at(9.0)), "out of the room");
/// assert!(rooms.may_see(&at(9.0), &at(2.0)), "into the room");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct RoomIndex {
    pub(super) axes: Axes,
    rooms: Vec<IndexedRoom>,
    /// The boxes of [`Rooms::objects`].
    pub(super) objects: Vec<Aabb>,
    /// For each cell the rooms that overlap it, ascending.
    pub(super) rooms_of_cell: Vec<Vec<RoomId>>,
    /// The cells that lie entirely in one restricting room.
    pub(super) covered: RoaringBitmap,
    /// The rooms that reach beyond the building.
    pub(super) unbounded: Vec<RoomId>,
    sealed: Vec<RoomId>,
    /// The rooms that hide what is behind them.
    pub(super) opaque: Vec<RoomId>,
    /// Whether some room restricts what is seen from it.
    pub(super) is_restricting: bool,
    /// Whether some room's set names cells.
    pub(super) names_cells: bool,
}

/// A room, prepared for questions.
#[derive(Clone, Debug)]
pub(super) struct IndexedRoom {
    pub bounds: Aabb,
    pub pieces: Vec<ConvexPiece>,
    pub windows: RoomWindows,
    /// Whether the room restricts what is seen from it: it has a set or windows.
    pub restricts: bool,
    pub is_sealed: bool,
    /// What the room hides from outside, if it is opaque.
    pub opaque: Option<OpaqueRoom>,
    pub rule: VisibilityRule,
    /// The rooms of which windows may show something.
    pub through_windows: RoaringBitmap,
}

/// What a room's set says.
#[derive(Clone, Debug)]
pub(super) enum VisibilityRule {
    /// Only the members are visible.
    Only(NamedMembers),
    /// Everything but the members is visible.
    AllBut(NamedMembers),
}

/// The members of a set, for quick look-up.
#[derive(Clone, Debug, Default)]
pub(super) struct NamedMembers {
    pub rooms: RoaringBitmap,
    pub cells: RoaringBitmap,
    /// Indices into [`Rooms::objects`].
    pub objects: Vec<u32>,
}

impl RoomIndex {
    /// The rooms of a world.
    pub fn new(world: &World) -> Self {
        Self::of(&world.rooms, &world.cells)
    }

    /// Rooms in a subdivision.
    pub fn of(rooms: &Rooms, cells: &Cells) -> Self {
        let axes = cells.axes;
        let list: Vec<IndexedRoom> = rooms
            .list()
            .iter()
            .zip(0u16..)
            .map(|(room, id)| IndexedRoom::new(room, RoomId(id), &axes))
            .collect();
        assert_eq!(list.len(), rooms.list().len(), "room ids are 16 bits");
        let objects = rooms.objects().iter().map(|object| axes.own_box(&object.bounds)).collect();
        let all = |is: fn(&IndexedRoom) -> bool| -> Vec<RoomId> {
            let rooms = (0u16..).zip(&list).filter(|(_, room)| is(room));
            rooms.map(|(id, _)| RoomId(id)).collect()
        };
        let mut index = Self {
            axes,
            objects,
            rooms_of_cell: vec![Vec::new(); if list.is_empty() { 0 } else { cells.cells.len() }],
            covered: RoaringBitmap::new(),
            unbounded: Vec::new(),
            sealed: all(|room| room.is_sealed),
            opaque: all(|room| room.opaque.is_some()),
            is_restricting: list.iter().any(|room| room.restricts),
            names_cells: list.iter().any(|room| !room.rule.named().cells.is_empty()),
            rooms: list,
        };
        index.find_rooms_of_cells(cells);
        index.find_rooms_through_windows(cells);
        index
    }

    /// Whether there are no rooms.
    pub fn is_empty(&self) -> bool {
        self.rooms.is_empty()
    }

    /// The number of rooms.
    pub fn len(&self) -> usize {
        self.rooms.len()
    }

    /// Whether rooms can rule out any pair at all.
    pub fn can_rule_out(&self) -> bool {
        self.is_restricting || !self.sealed.is_empty() || !self.opaque.is_empty()
    }

    /// The sealed rooms that a point of the world is in.
    pub fn sealed_rooms_at(&self, point: Vec3) -> SealedRooms {
        let own = self.axes.own(point);
        SealedRooms::of(self.sealed.iter().copied().filter(|id| self.room(*id).contains(own)))
    }

    /// The rooms that a point of the world is in, ascending.
    pub fn at(&self, point: Vec3) -> impl Iterator<Item = RoomId> + '_ {
        let own = self.axes.own(point);
        (0u16..)
            .zip(&self.rooms)
            .filter(move |(_, room)| room.contains(own))
            .map(|(id, _)| RoomId(id))
    }

    /// The smallest room that a point of the world is in, if it is in one.
    pub fn room_at(&self, point: Vec3) -> Option<RoomId> {
        let size = |id: &RoomId| {
            let pieces = &self.room(*id).pieces;
            pieces.iter().map(|piece| piece.bounds.size().as_dvec3().element_product()).sum::<f64>()
        };
        self.at(point).min_by(|a, b| size(a).total_cmp(&size(b)))
    }

    /// What is seen from a viewpoint in a room through its windows. The region holds everything
    /// that any of the eyes sees.
    pub fn seen(&self, room: RoomId, viewpoint: &Viewpoint) -> BooleanRegion {
        self.room(room).windows.seen(viewpoint)
    }

    /// The windows of a room that are in the field of view, nearest first, as indices into
    /// [`Room::windows`].
    pub fn windows_in_view(&self, room: RoomId, viewpoint: &Viewpoint) -> Vec<u32> {
        self.room(room).windows.in_view(viewpoint)
    }

    /// The convex pieces of a room.
    pub fn pieces(&self, room: RoomId) -> &[ConvexPiece] {
        &self.room(room).pieces
    }

    /// The smallest box around a room.
    pub fn bounds(&self, room: RoomId) -> Aabb {
        self.room(room).bounds
    }

    pub(super) fn room(&self, id: RoomId) -> &IndexedRoom {
        &self.rooms[usize::from(id.0)]
    }

    /// Finds for each cell the rooms that overlap it.
    fn find_rooms_of_cells(&mut self, cells: &Cells) {
        let mut found = Vec::new();
        for (id, room) in (0u16..).map(RoomId).zip(&self.rooms) {
            found.clear();
            for piece in &room.pieces {
                let start = found.len();
                cells.overlapping(&piece.bounds.intersection(&cells.bounds), &mut found);
                let near = |cell: &CellId| piece.meets(&cells.cells[cell.0 as usize].bounds);
                let kept: Vec<CellId> = found.drain(start..).filter(near).collect();
                found.extend(kept);
            }
            found.sort_unstable();
            found.dedup();
            for cell in &found {
                self.rooms_of_cell[cell.0 as usize].push(id);
                let bounds = &cells.cells[cell.0 as usize].bounds;
                if room.restricts && cover(room.pieces.iter(), bounds) {
                    self.covered.insert(cell.0);
                }
            }
            if !cells.bounds.contains_box(&room.bounds) {
                self.unbounded.push(id);
            }
        }
    }

    /// Finds for each room the others of which its windows may show something. Cells decide first,
    /// then the windows as seen from anywhere in the room.
    fn find_rooms_through_windows(&mut self, cells: &Cells) {
        let mut cells_of_room: Vec<RoaringBitmap> = vec![RoaringBitmap::new(); self.rooms.len()];
        for (cell, rooms) in (0u32..).zip(&self.rooms_of_cell) {
            for id in rooms {
                cells_of_room[usize::from(id.0)].insert(cell);
            }
        }
        for (at, here) in cells_of_room.iter().enumerate() {
            let room = &self.rooms[at];
            if room.windows.is_empty() {
                continue;
            }
            let mut seen = RoaringBitmap::new();
            here.iter().for_each(|cell| seen |= &cells.pvs[cell as usize]);
            let mut others: Vec<RoomId> =
                seen.iter().flat_map(|cell| &self.rooms_of_cell[cell as usize]).copied().collect();
            others.sort_unstable();
            others.dedup();
            let eyes = room.bounds.intersection(&cells.bounds.grown(EYES_OUTSIDE_M));
            let shows = |id: &RoomId| room.windows.show(&eyes, &self.room(*id).bounds);
            let through = others.iter().filter(|id| shows(id)).map(|id| u32::from(id.0)).collect();
            self.rooms[at].through_windows = through;
        }
    }
}

/// The furthest that eyes are expected outside the building, in metres.
const EYES_OUTSIDE_M: f32 = 1.0;

impl IndexedRoom {
    fn new(room: &Room, id: RoomId, axes: &Axes) -> Self {
        let pieces: Vec<ConvexPiece> =
            room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, axes)).collect();
        let windows = RoomWindows::new(room, &pieces, axes);
        let opaque =
            room.opaque.then(|| OpaqueRoom::new(&pieces, RoomWindows::inward(room, &pieces, axes)));
        let rule = match &room.sees {
            // A room with windows and without a set shows itself.
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
            is_sealed: room.sealed,
            opaque: opaque.filter(|_| !pieces.is_empty()),
            pieces,
            windows,
            rule,
            through_windows: RoaringBitmap::new(),
        }
    }

    /// Whether a point in own axes is in the room.
    fn contains(&self, own: Vec3) -> bool {
        self.bounds.contains(own) && self.pieces.iter().any(|piece| piece.contains(own))
    }
}

impl VisibilityRule {
    /// The members that the set names.
    pub fn named(&self) -> &NamedMembers {
        match self {
            Self::Only(named) | Self::AllBut(named) => named,
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
