//! Rooms as an author describes them: regions, what may be seen from inside, and windows.
//!
//! (*Efficient rendering utilizing user defined rooms and windows*, a patent application.) A
//! [`Room`] is a named region. It is not drawn. For an eye inside, it says what may be seen: a set
//! of rooms, cells and objects, or all but such a set. Everything else shows only through the
//! room's [`Window`]s. For an eye outside, it says nothing unless it is sealed or opaque.
//!
//! A set ([`ObjectSet`]) can name rooms, cells, movers (by the boxes that they never leave) and
//! nodes of the model (by the boxes around their triangles). It stands for places: an avatar
//! belongs to a set while it is in one of them.

mod shape;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use shape::Shape;

use crate::{cells::CellId, geometry::Aabb, motion::Spawn};

/// The greatest number of rooms of a world. A bit for each pair of them takes at most 4 MiB.
pub const ROOMS_MAX: usize = 4_096;
/// The greatest number of shapes of a room, and of its windows.
pub const PARTS_MAX: usize = 256;
/// The greatest number of shapes of all rooms of a world together, and of windows. In the worst
/// case it takes some seconds to cut that number into convex pieces.
pub const PARTS_ALL_MAX: usize = 1 << 14;
/// The greatest number of corners of a polygon.
pub const CORNERS_MAX: usize = 64;
/// The greatest number of points of a hull.
pub const HULL_POINTS_MAX: usize = 32;
/// The greatest number of characters of a name, a title or a tag.
pub const NAME_CHARS_MAX: usize = 100;
/// The greatest number of members of all sets of a world together.
pub const MEMBERS_MAX: usize = 1 << 18;
/// The greatest coordinate of a room, in metres.
pub const EXTENT_MAX: f32 = 1e6;

/// The number of a room: an index into [`Rooms::list`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct RoomId(pub u16);

impl RoomId {
    /// The sRGB colour that the room's outline is drawn in. Consecutive rooms have clearly
    /// different colours.
    pub fn colour(self) -> [u8; 3] {
        // Consecutive hues differ by a golden section of a full turn.
        let hue = (f32::from(self.0) * 0.618_034).fract() * 6.0;
        [5.0, 3.0, 1.0].map(|n: f32| {
            let k = (n + hue) % 6.0;
            (230.0 * (1.0 - 0.8 * k.min(4.0 - k).clamp(0.0, 1.0))) as u8
        })
    }
}

/// All rooms of a world, checked.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "UncheckedRooms")]
pub struct Rooms {
    list: Vec<Room>,
    objects: Vec<Object>,
}

/// A region that an author names, in metres and the world's axes.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Room {
    /// The name, unique among the rooms of the world.
    pub name: String,
    /// The title shown to people; the name if there is none.
    pub title: Option<String>,
    /// The shapes whose union is the room. Never empty.
    pub shapes: Vec<Shape>,
    /// What an eye inside may see.
    pub sees: RoomVisibility,
    /// The windows through which an eye inside sees out.
    pub windows: Vec<Window>,
    /// Whether avatars inside and avatars outside are hidden from one another.
    pub sealed: bool,
    /// Whether the room hides what is behind it from eyes outside, except through its windows.
    pub opaque: bool,
    /// The pose at which an avatar that is sent here begins.
    pub spawn: Option<Spawn>,
    /// The greatest number of avatars inside.
    pub capacity: Option<u32>,
    /// Free text for the host's own use.
    pub tag: Option<String>,
}

impl Room {
    /// The title shown to people.
    pub fn title(&self) -> &str {
        self.title.as_deref().unwrap_or(&self.name)
    }

    /// Whether the room restricts what may be seen from inside: it has a set or windows.
    pub fn restricts(&self) -> bool {
        !self.windows.is_empty() || self.sees != RoomVisibility::Unspecified
    }
}

/// What an eye inside of a room may see.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub enum RoomVisibility {
    /// The author says nothing. A room with windows then shows itself and what its windows show; a
    /// room without shows whatever the PVS allows.
    #[default]
    Unspecified,
    /// The potentially visible set: the room itself and these.
    Only(ObjectSet),
    /// The potentially hidden set: everything but these.
    AllBut(ObjectSet),
}

impl RoomVisibility {
    /// The set that the author names, if any.
    pub fn members(&self) -> Option<&ObjectSet> {
        match self {
            Self::Unspecified => None,
            Self::Only(members) | Self::AllBut(members) => Some(members),
        }
    }
}

/// A set of rooms, cells and objects.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct ObjectSet {
    /// The rooms in the set.
    pub rooms: Vec<RoomId>,
    /// The cells in the set.
    pub cells: Vec<CellId>,
    /// The objects in the set: indices into [`Rooms::objects`].
    pub objects: Vec<u32>,
}

impl ObjectSet {
    /// Whether the set has no member.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of members.
    pub fn len(&self) -> usize {
        self.rooms.len() + self.cells.len() + self.objects.len()
    }
}

/// A polygon in a room's boundary through which an eye inside sees out.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Window {
    /// The name, unique among the windows of the room.
    pub name: String,
    /// The corners in order around a plane, simple polygon. It need not be convex.
    pub corners: Vec<Vec3>,
    /// In a room that is not convex: the index of an earlier window of the room through which this
    /// window is seen from outside. The windows make a tree. Through a window of the first level an
    /// eye sees outside; through one of the second it sees the room again, and so on in turns.
    pub behind: Option<u32>,
}

/// A mover or a node of the model that a set names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// The name in the model.
    pub name: String,
    /// A box that the object never leaves, in metres and the world's axes.
    pub bounds: Aabb,
    /// The mover, if the object is one: an index into [`World::movers`](crate::World::movers).
    pub mover: Option<u32>,
}

/// Why rooms are invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RoomsError {
    /// There are too many rooms, shapes, windows, corners or members.
    #[error("there are too many {0}")]
    TooMany(&'static str),
    /// A name is empty, too long or not unique.
    #[error("the name of {0} is empty, too long or not unique")]
    Name(&'static str),
    /// There are too few or too many corners, a coordinate is NaN or too large, or an interval is
    /// reversed.
    #[error("{0} has an invalid number of corners, or coordinates out of range")]
    Place(&'static str),
    /// An index refers to nothing.
    #[error("{0} refers to something that does not exist")]
    Index(&'static str),
}

impl Rooms {
    /// Checks rooms and the objects that their sets name.
    ///
    /// # Errors
    /// When something exceeds its limit or refers to nothing. Cells and movers are not known here:
    /// see [`Rooms::fits`].
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
        debug_assert!(rooms.list.iter().all(|room| !room.shapes.is_empty()));
        Ok(rooms)
    }

    /// All rooms.
    pub fn list(&self) -> &[Room] {
        &self.list
    }

    /// The room with a number.
    pub fn get(&self, id: RoomId) -> Option<&Room> {
        self.list.get(usize::from(id.0))
    }

    /// The number of the room with a name.
    pub fn named(&self, name: &str) -> Option<RoomId> {
        self.list.iter().position(|room| room.name == name).map(|at| RoomId(at as u16))
    }

    /// The objects that sets name.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Whether all cells and movers that the rooms name exist, in a world with these numbers of
    /// cells and movers.
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

/// Checks that names are neither empty nor too long, and that each is unique.
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

/// Rooms as they are read, before the check.
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
