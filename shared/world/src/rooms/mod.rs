//! What an author knows about a building: rooms, what may be seen from them, and their windows.
//!
//! After "Efficient rendering utilizing user defined rooms and windows" (seeds: rooms-and-windows). A [`Room`] is a
//! region that is named, and no part of what is drawn. To whoever is inside, it says what may be
//! seen: a set of rooms, cells and objects, or all but such a set; what else there is shows only
//! through its [`Window`]s. To whoever is outside it says nothing, unless it is sealed.
//!
//! An *object* is what the world has that can be named: a room, a cell, a mover (the box that it
//! never leaves), or a node of the model (the box around its triangles). A set stands for the
//! places of its members: somebody belongs to it by being there.

mod shape;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use shape::Shape;

use crate::{cells::CellId, geometry::Aabb, motion::Spawn};

/// No world has more rooms: who shows whom then takes no more than 4 MiB.
pub const ROOMS_MAX: usize = 4_096;
/// No room has more shapes, and none more windows.
pub const PARTS_MAX: usize = 256;
/// All rooms of a world together have no more shapes, and no more windows: the worst take some seconds to take
/// apart.
pub const PARTS_ALL_MAX: usize = 1 << 14;
/// No polygon has more corners.
pub const CORNERS_MAX: usize = 64;
/// No hull has more points.
pub const HULL_POINTS_MAX: usize = 32;
/// Names, titles and tags have no more characters.
pub const NAME_CHARS_MAX: usize = 100;
/// All sets of a world together have no more members.
pub const MEMBERS_MAX: usize = 1 << 18;
/// No room is further out, in metres.
pub const EXTENT_MAX: f32 = 1e6;

/// Index of a room in [`Rooms::list`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct RoomId(pub u16);

impl RoomId {
    /// The colour that it is drawn with, as sRGB: those of rooms that follow each other are far apart.
    pub fn colour(self) -> [u8; 3] {
        // Hues a golden section of a turn from each other.
        let hue = (f32::from(self.0) * 0.618_034).fract() * 6.0;
        [5.0, 3.0, 1.0].map(|n: f32| {
            let k = (n + hue) % 6.0;
            (230.0 * (1.0 - 0.8 * k.min(4.0 - k).clamp(0.0, 1.0))) as u8
        })
    }
}

/// All rooms of a world.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "UncheckedRooms")]
pub struct Rooms {
    list: Vec<Room>,
    objects: Vec<Object>,
}

/// A region that an author names. Places are in metres and the world's axes.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Room {
    /// No other has the same.
    pub name: String,
    /// What people are told that it is called; its name without.
    pub title: Option<String>,
    /// The room is all of these together. Never empty.
    pub shapes: Vec<Shape>,
    /// What may be seen by whoever is inside.
    pub sees: RoomVisibility,
    /// Where one sees out of it.
    pub windows: Vec<Window>,
    /// Nobody inside is told of anybody outside, nor the other way round.
    pub sealed: bool,
    /// Nobody outside sees through it but through its windows: it hides rooms behind it.
    pub opaque: bool,
    /// Where one begins who is sent here.
    pub spawn: Option<Spawn>,
    /// No more people fit in.
    pub capacity: Option<u32>,
    /// For whatever else hangs on to rooms.
    pub tag: Option<String>,
}

impl Room {
    /// What people are told that it is called.
    pub fn title(&self) -> &str {
        self.title.as_deref().unwrap_or(&self.name)
    }

    /// Whether it says what may be seen from inside: it has a set, or windows.
    pub fn restricts(&self) -> bool {
        !self.windows.is_empty() || self.sees != RoomVisibility::Unspecified
    }
}

/// What a room says may be seen from inside.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub enum RoomVisibility {
    /// Nothing is said: with windows itself, and what these show; without, whatever cells give.
    #[default]
    Unspecified,
    /// The potentially visible set: itself and these.
    Only(ObjectSet),
    /// The potentially hidden set: all but these.
    AllBut(ObjectSet),
}

impl RoomVisibility {
    /// The set that is named, if one is.
    pub fn members(&self) -> Option<&ObjectSet> {
        match self {
            Self::Unspecified => None,
            Self::Only(members) | Self::AllBut(members) => Some(members),
        }
    }
}

/// A set of objects.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct ObjectSet {
    /// Rooms.
    pub rooms: Vec<RoomId>,
    /// Cells.
    pub cells: Vec<CellId>,
    /// Indices into [`Rooms::objects`].
    pub objects: Vec<u32>,
}

impl ObjectSet {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.rooms.len() + self.cells.len() + self.objects.len()
    }
}

/// A polygon of a room's boundary through which one sees out of it.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Window {
    /// No other of the room has the same.
    pub name: String,
    /// A plane polygon without crossings, in order around it; it need not be convex.
    pub corners: Vec<Vec3>,
    /// In a room that is not convex: the index of a window before it in the room's list, through
    /// which one sees this one from outside. Windows thus make a tree: what is seen through one of
    /// its first level is outside, what is seen through one of the second is the room again and no
    /// longer what is outside, and so on in turns.
    pub behind: Option<u32>,
}

/// A mover or a node of the model that some set names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// As the model has it.
    pub name: String,
    /// What it never leaves, in the world's axes.
    pub bounds: Aabb,
    /// Index into [`World::movers`](crate::World::movers), when it moves.
    pub mover: Option<u32>,
}

/// Why rooms make no sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RoomsError {
    /// More rooms, shapes, windows, corners or members than there may be.
    #[error("there are too many {0}")]
    TooMany(&'static str),
    /// A name that is empty, too long, or taken.
    #[error("the name of {0} is empty, too long or taken")]
    Name(&'static str),
    /// A number that is none, too large, or an interval the wrong way round.
    #[error("{0} is not a sane place")]
    Place(&'static str),
    /// An index of something that is not there.
    #[error("{0} refers to something that is not there")]
    Index(&'static str),
}

impl Rooms {
    /// Rooms, and the objects that their sets name.
    ///
    /// # Errors
    /// When something is beyond its limits or refers to what is not there. Cells cannot be
    /// checked here: see [`Rooms::fits`].
    pub fn new(list: Vec<Room>, objects: Vec<Object>) -> Result<Self, RoomsError> {
        if list.len() > ROOMS_MAX {
            return Err(RoomsError::TooMany("rooms"));
        }
        if objects.len() > MEMBERS_MAX {
            return Err(RoomsError::TooMany("objects"));
        }
        let parts = |count: &dyn Fn(&Room) -> usize| list.iter().map(count).sum::<usize>();
        if parts(&|room| room.shapes.len()).max(parts(&|room| room.windows.len())) > PARTS_ALL_MAX {
            return Err(RoomsError::TooMany("shapes or windows"));
        }
        let members = list.iter().filter_map(|room| room.sees.members());
        if members.map(ObjectSet::len).sum::<usize>() > MEMBERS_MAX {
            return Err(RoomsError::TooMany("members of sets"));
        }
        let is_good = |object: &Object| is_sane(&object.bounds.corners());
        if !objects.iter().all(|object| is_good(object) && !object.bounds.is_empty()) {
            return Err(RoomsError::Place("an object"));
        }
        names("a room", list.iter().map(|room| room.name.as_str()))?;
        let rooms = Self { list, objects };
        rooms.list.iter().try_for_each(|room| rooms.check(room))?;
        Ok(rooms)
    }

    /// All rooms.
    pub fn list(&self) -> &[Room] {
        &self.list
    }

    /// One of them.
    pub fn get(&self, id: RoomId) -> Option<&Room> {
        self.list.get(usize::from(id.0))
    }

    /// The one of this name.
    pub fn named(&self, name: &str) -> Option<RoomId> {
        self.list.iter().position(|room| room.name == name).map(|at| RoomId(at as u16))
    }

    /// What sets name besides rooms and cells.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Whether all cells and movers that are named are among so many.
    pub fn fits(&self, cells: usize, movers: usize) -> bool {
        let sets = self.list.iter().filter_map(|room| room.sees.members());
        let is_there = |index: u32, count: usize| (index as usize) < count;
        let mut named = sets.flat_map(|set| &set.cells);
        named.all(|cell| is_there(cell.0, cells))
            && self.objects.iter().filter_map(|o| o.mover).all(|mover| is_there(mover, movers))
    }

    fn check(&self, room: &Room) -> Result<(), RoomsError> {
        if !(1..=PARTS_MAX).contains(&room.shapes.len()) || room.windows.len() > PARTS_MAX {
            return Err(RoomsError::TooMany("shapes or windows of a room"));
        }
        let texts = [room.title.as_deref(), room.tag.as_deref()];
        if texts.into_iter().flatten().any(|text| text.chars().count() > NAME_CHARS_MAX) {
            return Err(RoomsError::Name("a title or a tag"));
        }
        if !room.shapes.iter().all(Shape::is_sane) {
            return Err(RoomsError::Place("a room"));
        }
        let is_good = |spawn: &Spawn| is_sane(&[spawn.eye]) && spawn.yaw.is_finite();
        if !room.spawn.iter().all(is_good) {
            return Err(RoomsError::Place("the spawn point of a room"));
        }
        names("a window", room.windows.iter().map(|window| window.name.as_str()))?;
        for (at, window) in (0..).zip(&room.windows) {
            if !(3..=CORNERS_MAX).contains(&window.corners.len()) || !is_sane(&window.corners) {
                return Err(RoomsError::Place("a window"));
            }
            if window.behind.is_some_and(|behind| behind >= at) {
                return Err(RoomsError::Index("a window"));
            }
        }
        let Some(set) = room.sees.members() else { return Ok(()) };
        let known = set.rooms.iter().all(|id| usize::from(id.0) < self.list.len())
            && set.objects.iter().all(|at| (*at as usize) < self.objects.len());
        if known { Ok(()) } else { Err(RoomsError::Index("the set of a room")) }
    }
}

/// Checks that names are there, short, and all different.
fn names<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<(), RoomsError> {
    let mut sorted: Vec<&str> = names.collect();
    sorted.sort_unstable();
    let is_good = |name: &&str| (1..=NAME_CHARS_MAX).contains(&name.chars().count());
    let all_good = sorted.iter().all(is_good) && sorted.windows(2).all(|two| two[0] != two[1]);
    if all_good { Ok(()) } else { Err(RoomsError::Name(what)) }
}

fn is_sane(points: &[Vec3]) -> bool {
    points.iter().all(|point| point.abs().cmple(Vec3::splat(EXTENT_MAX)).all())
}

/// Rooms as they are read, not checked.
#[derive(Deserialize)]
struct UncheckedRooms {
    list: Vec<Room>,
    objects: Vec<Object>,
}

impl TryFrom<UncheckedRooms> for Rooms {
    type Error = RoomsError;

    fn try_from(UncheckedRooms { list, objects }: UncheckedRooms) -> Result<Self, RoomsError> {
        Self::new(list, objects)
    }
}
