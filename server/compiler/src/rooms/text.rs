//! Rooms in TOML, and the same keys in JSON as extras of nodes.
//!
//! ```toml
//! [[room]]
//! name = "meeting 1"
//! title = "Board room"                       # all but the name and a shape is optional
//! rectangle = [[0.0, 0.0], [6.0, 4.0]]       # x and z of two corners; or
//! # polygon = [[0, 0], [6, 0], [6, 4]]       # x and z, in order around it; or
//! # box = [[0, 0, 0], [6, 3, 4]]             # or boxes = [...], of several
//! # hull = [[0, 0, 0], [6, 0, 0], ...]       # the convex hull of points; or hulls = [...]
//! heights = [0.0, 3.0]                       # of a rectangle or a polygon; all heights without
//! visible = { rooms = ["hall"], objects = ["lift"], cells = [[1.0, 1.5, 2.0], 17] }
//! # hidden = { ... }                         # all but these, in place of visible
//! sealed = true
//! opaque = false
//! overlaps = ["hall"]                        # on purpose
//! spawn = { eye = [1.0, 1.6, 1.0], yaw = 90 }   # degrees
//! capacity = 12
//! tag = "private"
//!
//! [[room.window]]
//! name = "door"
//! polygon = [[6, 0, 1], [6, 0, 2], [6, 2, 2], [6, 2, 1]]
//! # behind = "glass"                         # in rooms that are not convex
//! ```

use std::{fs, io::Read, path::Path};

use glam::{Vec2, Vec3};
use serde::{Deserialize, de::DeserializeOwned};
use sightline_world::{Spawn, geometry::Aabb, rooms::Shape};
use toml::Spanned;

use super::{
    CellReference, LocatedName, RoomDeclaration, RoomError, RoomErrors, SetDeclaration,
    SourceLocation, WindowDeclaration,
};

/// The longest file with rooms, in bytes.
pub const BYTES_MAX: u64 = 16 << 20;

/// Why a file with rooms cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// The cause.
        source: std::io::Error,
    },
    /// The file has errors.
    #[error(transparent)]
    RoomErrors(#[from] RoomErrors),
}

/// Reads a file with rooms.
///
/// # Errors
/// When the file cannot be read, is too long or has errors.
pub fn read_file(path: &Path) -> Result<Vec<RoomDeclaration>, FileError> {
    let io = |source| FileError::Io { path: path.display().to_string(), source };
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(io)?;
    file.take(BYTES_MAX + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(io(std::io::Error::other("the file is too long")));
    }
    let text = String::from_utf8(bytes).map_err(|error| io(std::io::Error::other(error)))?;
    Ok(read(&text, &path.display().to_string())?)
}

/// Reads rooms from the text of a file. The name of the file appears in errors.
///
/// # Errors
/// When the text is not TOML, or has unknown keys or values.
pub fn read(text: &str, file: &str) -> Result<Vec<RoomDeclaration>, RoomErrors> {
    let line = |at: usize| {
        let before = text.as_bytes().iter().take(at);
        SourceLocation::Line(file.to_owned(), 1 + before.filter(|byte| **byte == b'\n').count())
    };
    let read: File = toml::from_str(text).map_err(|error| {
        let place = line(error.span().map_or(0, |span| span.start));
        RoomErrors(vec![RoomError::new(&place, error.message().replace('\n', ", "))])
    })?;
    let name = |said: &Spanned<String>| LocatedName {
        text: said.get_ref().clone(),
        place: line(said.span().start),
    };
    let mut errors = Vec::new();
    let mut rooms = Vec::new();
    for entry in read.room {
        let at = line(entry.span().start);
        let entry = entry.into_inner();
        let Some(said) = entry.name.as_ref() else {
            errors.push(RoomError::new(&at, "a room without a name"));
            continue;
        };
        let mut room = RoomDeclaration::named(name(said));
        match entry.shapes() {
            Ok(shapes) => room.shapes = shapes,
            Err(what) => {
                errors.push(RoomError::new(&at, format!("room {:?}: {what}", said.get_ref())))
            }
        }
        entry.apply(&mut room, &name);
        rooms.push(room);
    }
    if errors.is_empty() { Ok(rooms) } else { Err(RoomErrors(errors)) }
}

/// Sets what the extras of a node say of a room. Unknown keys belong to other programs.
pub(super) fn apply_extras(json: &str, room: &mut RoomDeclaration) -> Result<(), RoomError> {
    let place = room.name.place.clone();
    let error_of =
        |error: serde_json::Error| RoomError::new(&place, format!("its extras: {error}"));
    let mut value: serde_json::Value = serde_json::from_str(json).map_err(error_of)?;
    if let Some(extras) = value.as_object_mut() {
        const KEYS: [&str; 11] = [
            "title", "heights", "visible", "hidden", "overlaps", "sealed", "opaque", "spawn",
            "capacity", "tag", "behind",
        ];
        extras.retain(|key, _| KEYS.contains(&key.as_str()));
        extras.remove("behind");
    }
    let entry: Entry<String> = serde_json::from_value(value).map_err(error_of)?;
    if let Some(heights) = entry.heights {
        for shape in &mut room.shapes {
            if let Shape::Plan { heights: all, .. } = shape {
                *all = Some(heights);
            }
        }
    }
    entry.apply(room, &|text: &String| LocatedName { text: text.clone(), place: place.clone() });
    Ok(())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    room: Vec<Spanned<Entry<Spanned<String>>>>,
}

/// A room. `S` is a name.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound = "S: DeserializeOwned")]
struct Entry<S> {
    name: Option<S>,
    title: Option<String>,
    rectangle: Option<[Vec2; 2]>,
    polygon: Option<Vec<Vec2>>,
    heights: Option<[f32; 2]>,
    r#box: Option<[Vec3; 2]>,
    #[serde(default = "Vec::new")]
    boxes: Vec<[Vec3; 2]>,
    hull: Option<Vec<Vec3>>,
    #[serde(default = "Vec::new")]
    hulls: Vec<Vec<Vec3>>,
    visible: Option<Set<S>>,
    hidden: Option<Set<S>>,
    #[serde(default = "Vec::new")]
    overlaps: Vec<S>,
    #[serde(default)]
    sealed: bool,
    #[serde(default)]
    opaque: bool,
    spawn: Option<Place3>,
    capacity: Option<u32>,
    tag: Option<String>,
    #[serde(default = "Vec::new")]
    window: Vec<Pane<S>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound = "S: DeserializeOwned")]
struct Set<S> {
    #[serde(default = "Vec::new")]
    rooms: Vec<S>,
    #[serde(default = "Vec::new")]
    objects: Vec<S>,
    #[serde(default)]
    cells: Vec<Cell>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a cell is a number, or a point [x, y, z] that is in it")]
enum Cell {
    Number(u32),
    At(Vec3),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Place3 {
    eye: Vec3,
    #[serde(default)]
    yaw: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound = "S: DeserializeOwned")]
struct Pane<S> {
    name: S,
    polygon: Vec<Vec3>,
    behind: Option<S>,
}

impl<S: DeserializeOwned> Entry<S> {
    fn shapes(&self) -> Result<Vec<Shape>, &'static str> {
        let mut shapes = Vec::new();
        let heights = self.heights;
        if let Some([a, b]) = self.rectangle {
            let (min, max) = (a.min(b), a.max(b));
            let corners = vec![min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)];
            shapes.push(Shape::Plan { corners, heights });
        }
        if let Some(corners) = self.polygon.clone() {
            shapes.push(Shape::Plan { corners, heights });
        }
        if shapes.is_empty() && heights.is_some() {
            return Err("heights are of a rectangle or a polygon, and it has none");
        }
        let boxes = self.r#box.iter().chain(&self.boxes);
        shapes.extend(boxes.map(|[a, b]| Shape::Box(Aabb::new(a.min(*b), a.max(*b)))));
        shapes.extend(self.hull.iter().chain(&self.hulls).cloned().map(Shape::Hull));
        if shapes.is_empty() {
            return Err("it has no shape: give a rectangle, polygon, box or hull");
        }
        Ok(shapes)
    }

    /// Sets all of a room but its shapes.
    fn apply(self, room: &mut RoomDeclaration, name: &dyn Fn(&S) -> LocatedName) {
        let set = |set: Set<S>| SetDeclaration {
            rooms: set.rooms.iter().map(name).collect(),
            objects: set.objects.iter().map(name).collect(),
            cells: set.cells.iter().map(CellReference::from).collect(),
        };
        room.title = self.title.or(room.title.take());
        room.visible = self.visible.map(set).or(room.visible.take());
        room.hidden = self.hidden.map(set).or(room.hidden.take());
        room.overlaps.extend(self.overlaps.iter().map(name));
        room.sealed |= self.sealed;
        room.opaque |= self.opaque;
        let spawn = self.spawn.map(|at| Spawn { eye: at.eye, yaw: at.yaw.to_radians() });
        room.spawn = spawn.or(room.spawn.take());
        room.capacity = self.capacity.or(room.capacity);
        room.tag = self.tag.or(room.tag.take());
        room.windows.extend(self.window.iter().map(|window| WindowDeclaration {
            name: name(&window.name),
            corners: window.polygon.clone(),
            behind: window.behind.as_ref().map(name),
        }));
    }
}

impl From<&Cell> for CellReference {
    fn from(cell: &Cell) -> Self {
        match *cell {
            Cell::Number(number) => Self::Number(number),
            Cell::At(point) => Self::At(point),
        }
    }
}
