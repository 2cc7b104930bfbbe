//! Rooms as an author declares them: in a TOML file beside the model, or as named nodes of a glTF.
//!
//! * [`text`] reads the TOML file, and the extras of nodes.
//! * `nodes` turns the meshes of nodes into shapes and windows.
//! * [`resolve`] looks up names once the cells are known. Every error names its line or node.
//! * [`checks`] warns of what is valid but probably not meant, or has no effect yet.

pub mod checks;
pub(crate) mod nodes;
#[cfg(test)]
mod tests;
pub mod text;

use std::{collections::HashMap, fmt};

use glam::Vec3;
use serde::Serialize;
use sightline_visibility::rooms::pieces::ConvexPiece;
use sightline_world::{
    Cells, Mover, Spawn,
    geometry::Aabb,
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
    tolerance::AUTHORED_M,
};

/// Where a declaration is written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub enum SourceLocation {
    /// In a file, at a line, counted from 1.
    Line(String, usize),
    /// In a model, at a node of this name.
    Node(String),
}

impl fmt::Display for SourceLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(file, line) => write!(f, "{file}:{line}"),
            Self::Node(name) => write!(f, "node {name:?}"),
        }
    }
}

/// An error in a declaration of rooms, or a warning, in one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, Serialize)]
#[error("{place}: {what}")]
pub struct RoomError {
    /// Where the declaration is written.
    pub place: SourceLocation,
    /// What is wrong.
    pub what: String,
}

impl RoomError {
    fn new(place: &SourceLocation, what: impl Into<String>) -> Self {
        Self { place: place.clone(), what: what.into() }
    }
}

/// All errors in the rooms of a model.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}", summary(.0))]
pub struct RoomErrors(pub Vec<RoomError>);

/// The first error, and how many more there are.
fn summary(errors: &[RoomError]) -> String {
    match errors {
        [only] => only.to_string(),
        [first, rest @ ..] => format!("{first} (and {} more errors in rooms)", rest.len()),
        [] => "no error in rooms".into(),
    }
}

/// A name, and where it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatedName {
    /// The name.
    pub text: String,
    /// Where it is written.
    pub place: SourceLocation,
}

/// A reference to a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellReference {
    /// The cell that contains this point of the world.
    At(Vec3),
    /// The cell of this number. Numbers may change whenever the model is compiled.
    Number(u32),
}

/// A visible or hidden set, as it is declared.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct SetDeclaration {
    /// Names of rooms.
    pub rooms: Vec<LocatedName>,
    /// Names of movers and nodes of the model.
    pub objects: Vec<LocatedName>,
    /// References to cells.
    pub cells: Vec<CellReference>,
}

/// A room, as it is declared.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomDeclaration {
    /// The name, and where the declaration begins.
    pub name: LocatedName,
    /// The shapes that it fills.
    pub shapes: Vec<Shape>,
    /// The windows.
    pub windows: Vec<WindowDeclaration>,
    /// The potentially visible set, if declared.
    pub visible: Option<SetDeclaration>,
    /// The potentially hidden set, if declared. A room has at most one of the two.
    pub hidden: Option<SetDeclaration>,
    /// Rooms that it overlaps on purpose.
    pub overlaps: Vec<LocatedName>,
    /// As in [`Room::title`].
    pub title: Option<String>,
    /// As in [`Room::sealed`].
    pub sealed: bool,
    /// As in [`Room::opaque`].
    pub opaque: bool,
    /// As in [`Room::spawn`].
    pub spawn: Option<Spawn>,
    /// As in [`Room::capacity`].
    pub capacity: Option<u32>,
    /// As in [`Room::tag`].
    pub tag: Option<String>,
}

impl RoomDeclaration {
    /// A room with a name and nothing else.
    pub fn named(name: LocatedName) -> Self {
        Self {
            name,
            shapes: Vec::new(),
            windows: Vec::new(),
            visible: None,
            hidden: None,
            overlaps: Vec::new(),
            title: None,
            sealed: false,
            opaque: false,
            spawn: None,
            capacity: None,
            tag: None,
        }
    }
}

/// A window, as it is declared.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowDeclaration {
    /// The name, and where the declaration begins.
    pub name: LocatedName,
    /// The corners of a polygon, in the world's axes.
    pub corners: Vec<Vec3>,
    /// The window through which it is visible from outside.
    pub behind: Option<LocatedName>,
}

/// The names that declarations can refer to.
pub struct RoomScope<'a> {
    /// The cells of the world.
    pub cells: &'a Cells,
    /// The movers of the model.
    pub movers: &'a [Mover],
    /// The named nodes that do not move, each with the box around its triangles.
    pub nodes: &'a [(String, Aabb)],
}

/// Resolves declarations to rooms.
///
/// # Errors
/// All errors at once: names that are taken or unknown, flat shapes, windows that are not flat or
/// lie off the boundary of their room.
pub fn resolve(declared: &[RoomDeclaration], known: &RoomScope<'_>) -> Result<Rooms, RoomErrors> {
    let mut resolver =
        Resolver { known, ids: HashMap::new(), objects: Vec::new(), errors: Vec::new() };
    for (id, room) in (0u16..).zip(declared.iter().take(usize::from(u16::MAX))) {
        let LocatedName { text, place } = &room.name;
        if resolver.ids.insert(text, RoomId(id)).is_some() {
            resolver.error(place, format!("there is a room {text:?} already"));
        }
    }
    let list: Vec<Room> = declared.iter().map(|room| resolver.room(room)).collect();
    let Resolver { objects, mut errors, .. } = resolver;
    if !errors.is_empty() {
        return Err(RoomErrors(errors));
    }
    Rooms::new(list, objects).map_err(|error| {
        let place = declared
            .first()
            .map_or(SourceLocation::Node(String::new()), |room| room.name.place.clone());
        errors.push(RoomError { place, what: format!("the rooms: {error}") });
        RoomErrors(errors)
    })
}

/// Declarations that are being resolved.
struct Resolver<'a> {
    known: &'a RoomScope<'a>,
    ids: HashMap<&'a str, RoomId>,
    objects: Vec<Object>,
    errors: Vec<RoomError>,
}

impl<'a> Resolver<'a> {
    fn error(&mut self, place: &SourceLocation, what: String) {
        self.errors.push(RoomError::new(place, what));
    }

    fn room(&mut self, declared: &'a RoomDeclaration) -> Room {
        let LocatedName { text, place } = &declared.name;
        let mut room = Room {
            name: text.clone(),
            title: declared.title.clone(),
            shapes: declared.shapes.clone(),
            sealed: declared.sealed,
            opaque: declared.opaque,
            spawn: declared.spawn,
            capacity: declared.capacity,
            tag: declared.tag.clone(),
            ..Room::default()
        };
        // A room is checked alone, so that the error names its own place.
        if let Err(error) = Rooms::new(vec![room.clone()], Vec::new()) {
            self.error(place, format!("room {text:?}: {error}"));
            return room;
        }
        let axes = &self.known.cells.axes;
        if room.shapes.iter().any(|shape| ConvexPiece::of(shape, axes).is_empty()) {
            self.error(place, format!("room {text:?}: a shape of it is flat"));
        }
        room.sees = match (&declared.visible, &declared.hidden) {
            (Some(_), Some(_)) => {
                let what = "has a visible and a hidden set: a room has one of the two";
                self.error(place, format!("room {text:?} {what}"));
                RoomVisibility::Unspecified
            }
            (Some(names), None) => RoomVisibility::Only(self.members(names, place)),
            (None, Some(names)) => RoomVisibility::AllBut(self.members(names, place)),
            (None, None) => RoomVisibility::Unspecified,
        };
        for other in &declared.overlaps {
            self.room_id(other);
        }
        room.windows = self.windows(declared, &room);
        room
    }

    fn room_id(&mut self, name: &LocatedName) -> Option<RoomId> {
        let id = self.ids.get(name.text.as_str()).copied();
        if id.is_none() {
            self.error(&name.place, format!("there is no room {:?}", name.text));
        }
        id
    }

    fn members(&mut self, names: &SetDeclaration, place: &SourceLocation) -> ObjectSet {
        let rooms = names.rooms.iter().filter_map(|name| self.room_id(name)).collect();
        let objects = names.objects.iter().flat_map(|name| self.named(name)).collect();
        let mut cells = Vec::new();
        for name in &names.cells {
            let cell = match *name {
                CellReference::At(point) => self.known.cells.at(point),
                CellReference::Number(number) => {
                    let is_there = (number as usize) < self.known.cells.cells.len();
                    is_there.then_some(sightline_world::CellId(number))
                }
            };
            match (cell, name) {
                (Some(cell), _) => cells.push(cell),
                (None, CellReference::At(at)) => {
                    self.error(place, format!("there is no cell at {at}"))
                }
                (None, CellReference::Number(n)) => {
                    self.error(place, format!("there is no cell {n}"))
                }
            }
        }
        ObjectSet { rooms, cells, objects }
    }

    /// All movers and nodes with a name, as indices of objects.
    fn named(&mut self, name: &LocatedName) -> Vec<u32> {
        let text = name.text.as_str();
        let movers = self.known.movers.iter().zip(0u32..).filter(|(mover, _)| mover.name == text);
        let movers = movers.map(|(mover, at)| (mover.everywhere(), Some(at)));
        let nodes = self.known.nodes.iter().filter(|(node, _)| node == text);
        let found: Vec<_> = movers.chain(nodes.map(|(_, bounds)| (*bounds, None))).collect();
        if found.is_empty() {
            self.error(&name.place, format!("the model has no mover and no node {text:?}"));
        }
        let mut numbers = Vec::new();
        for (bounds, mover) in found {
            let object = Object { name: text.to_owned(), bounds, mover };
            let known = self.objects.iter().position(|other| *other == object);
            numbers.push(known.unwrap_or(self.objects.len()) as u32);
            if known.is_none() {
                self.objects.push(object);
            }
        }
        numbers
    }

    fn windows(&mut self, declared: &'a RoomDeclaration, room: &Room) -> Vec<Window> {
        let mut windows: Vec<Window> = Vec::new();
        for window in &declared.windows {
            let LocatedName { text, place } = &window.name;
            let full = format!("window {:?} of room {:?}", text, room.name);
            let behind = window.behind.as_ref().and_then(|name| {
                let at = windows.iter().position(|before| before.name == name.text);
                if at.is_none() {
                    let what =
                        format!("{full} is behind {:?}, which is no window before it", name.text);
                    self.error(&name.place, what);
                }
                at.map(|at| at as u32)
            });
            let made = Window { name: text.clone(), corners: window.corners.clone(), behind };
            let alone =
                Room { windows: vec![Window { behind: None, ..made.clone() }], ..room.clone() };
            if let Err(error) =
                Rooms::new(vec![Room { sees: RoomVisibility::Unspecified, ..alone }], Vec::new())
            {
                self.error(place, format!("{full}: {error}"));
            } else if windows.iter().any(|before| before.name == *text) {
                self.error(place, format!("room {:?} has a window {text:?} already", room.name));
            } else if let Some(what) = misplaced(&made, room, self.known.cells) {
                self.error(place, format!("{full} {what}"));
            }
            windows.push(made);
        }
        windows
    }
}

/// What is wrong with the place of a window.
fn misplaced(window: &Window, room: &Room, cells: &Cells) -> Option<String> {
    let corners = &window.corners;
    let Some(plane) = nodes::plane_of(corners) else { return Some("has no area".into()) };
    let off = |at: &Vec3| (plane.0.dot(*at) - plane.1).abs();
    if let Some(corner) = corners.iter().find(|at| off(at) > AUTHORED_M) {
        return Some(format!(
            "is not flat: its corner {corner} is {:.2} m off its plane",
            off(corner)
        ));
    }
    let axes = &cells.axes;
    let pieces: Vec<_> =
        room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, axes)).collect();
    let within = shrunk(corners);
    let ring = within.iter().zip(within.iter().cycle().skip(1));
    let probes = ring.flat_map(|(a, b)| [*a, a.midpoint(*b)]);
    let is_in = |at: Vec3| pieces.iter().any(|piece| piece.contains(axes.own(at)));
    for probe in probes {
        let beside = [AUTHORED_M, -AUTHORED_M].map(|far| is_in(probe + plane.0 * far));
        match beside {
            [true, true] => return Some(format!("is inside its room at {probe}")),
            [false, false] => return Some(format!("is off the boundary of its room at {probe}")),
            _ => (),
        }
    }
    None
}

/// The corners of a polygon, moved inwards along their edges: by hand, nobody measures to the
/// millimetre where a window ends.
fn shrunk(corners: &[Vec3]) -> Vec<Vec3> {
    let count = corners.len();
    let inwards = |at: Vec3, next: Vec3| {
        let length = at.distance(next);
        let by = (0.02 * length).max(2.0 * AUTHORED_M).min(0.25 * length);
        (next - at).normalize_or_zero() * by
    };
    let moved = |i: usize| {
        let (at, next, last) =
            (corners[i], corners[(i + 1) % count], corners[(i + count - 1) % count]);
        at + inwards(at, next) + inwards(at, last)
    };
    (0..count).map(moved).collect()
}
