//! Warnings about rooms that are valid but probably not meant: settings without an effect, rooms
//! that overlap, and members of a hidden set that are plainly visible.

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_oracle::Oracle;
use sightline_visibility::rooms::{RoomIndex, RoomOverlap, pieces::ConvexPiece};
use sightline_world::{
    Cells,
    geometry::Aabb,
    rooms::{RoomId, RoomVisibility, Rooms},
    tolerance::AUTHORED_M,
};

use super::{RoomDeclaration, RoomError};

/// How many lines of sight are tried for each member of a hidden set.
const LINES: u32 = 4_000;
/// How many points are tried to find one in a shape that fills little of its box.
const TRIES: u32 = 200;

/// All warnings about valid rooms. `sight` makes the oracle, when it is needed.
pub fn warnings(
    declared: &[RoomDeclaration],
    rooms: &Rooms,
    cells: &Cells,
    sight: &dyn Fn() -> Oracle,
) -> Vec<RoomError> {
    assert_eq!(declared.len(), rooms.list().len(), "each declared room is resolved");
    let index = RoomIndex::of(rooms, cells);
    let mut found = ineffective(declared);
    found.extend(overlaps(declared, &index));
    let hides =
        |room: &sightline_world::rooms::Room| matches!(room.sees, RoomVisibility::AllBut(_));
    if rooms.list().iter().any(hides) {
        let sight = sight();
        let checker = Checker { declared, rooms, index: &index, cells, sight: &sight };
        found.extend((0..rooms.list().len()).flat_map(|at| checker.plainly_visible(at)));
    }
    found
}

/// Settings that the format has and that nothing uses yet.
fn ineffective(declared: &[RoomDeclaration]) -> Vec<RoomError> {
    let warn = |room: &RoomDeclaration, setting: &str, effect: &str| {
        let what = format!("room {:?}: {setting} has no effect yet: {effect}", room.name.text);
        RoomError::new(&room.name.place, what)
    };
    let mut found = Vec::new();
    for room in declared {
        if room.capacity.is_some() {
            found.push(warn(room, "capacity", "any number of people may enter"));
        }
    }
    found
}

/// Pairs of rooms that overlap, neither of which holds the other or declares the overlap.
fn overlaps(declared: &[RoomDeclaration], index: &RoomIndex) -> Vec<RoomError> {
    let mut found = Vec::new();
    for (j, second) in declared.iter().enumerate() {
        for (i, first) in declared[..j].iter().enumerate() {
            let says = |a: &RoomDeclaration, b: &RoomDeclaration| {
                a.overlaps.iter().any(|n| n.text == b.name.text)
            };
            let [a, b] = [i, j].map(|at| RoomId(at as u16));
            let apart = !index.bounds(a).grown(-AUTHORED_M).intersects(&index.bounds(b));
            if apart || says(first, second) || says(second, first) {
                continue;
            }
            let shared = index
                .pieces(a)
                .iter()
                .find_map(|piece| index.pieces(b).iter().find_map(|other| shared(piece, other)));
            let holds = |a: RoomId, b: RoomId| {
                let corners = index.pieces(b).iter().flat_map(|piece| piece.faces.iter().flatten());
                let near = |at: &Vec3| index.pieces(a).iter().any(|piece| is_near(piece, *at));
                corners.into_iter().all(near)
            };
            if let Some(at) = shared.filter(|_| !holds(a, b) && !holds(b, a)) {
                let [one, other] = [second, first].map(|room| &room.name.text);
                let what = format!("room {one:?} overlaps room {other:?} at {at}");
                let how = format!("if that is meant, give it overlaps = [{other:?}]");
                found.push(RoomError::new(&second.name.place, format!("{what}; {how}")));
            }
        }
    }
    found
}

/// A point well inside both pieces.
fn shared(a: &ConvexPiece, b: &ConvexPiece) -> Option<Vec3> {
    let region = a.bounds.intersection(&b.bounds);
    if region.size().min_element() <= AUTHORED_M {
        return None;
    }
    let within = |at: Vec3| {
        let deep = |piece: &ConvexPiece| {
            piece.all_sides().all(|side| side.holds(at, -f64::from(AUTHORED_M) * 0.5))
        };
        deep(a) && deep(b)
    };
    let mut rng = SmallRng::seed_from_u64(1);
    std::iter::once(region.centre())
        .chain((0..TRIES).map(|_| inside(&mut rng, &region)))
        .find(|at| within(*at))
}

/// Whether a point lies in a piece, or nearly.
fn is_near(piece: &ConvexPiece, at: Vec3) -> bool {
    piece.all_sides().all(|side| side.holds(at, AUTHORED_M.into()))
}

/// A uniform random point of a box.
fn inside(rng: &mut SmallRng, region: &Aabb) -> Vec3 {
    let mut share = || rng.random_range(0.0..=1.0f32);
    region.min + region.size() * Vec3::new(share(), share(), share())
}

/// What the check of hidden sets needs.
struct Checker<'a> {
    declared: &'a [RoomDeclaration],
    rooms: &'a Rooms,
    index: &'a RoomIndex,
    cells: &'a Cells,
    sight: &'a Oracle,
}

impl Checker<'_> {
    /// Warns of members of a hidden set that a free line reaches, without a window of the room.
    fn plainly_visible(&self, at: usize) -> Vec<RoomError> {
        let id = RoomId(at as u16);
        let RoomVisibility::AllBut(set) = &self.rooms.list()[at].sees else { return Vec::new() };
        let rooms = set.rooms.iter().filter(|other| **other != id).map(|other| {
            let name = format!("room {:?}", self.rooms.list()[usize::from(other.0)].name);
            (name, self.index.pieces(*other).iter().map(|piece| piece.bounds).collect::<Vec<_>>())
        });
        let objects = set.objects.iter().filter_map(|object| {
            let object = self.rooms.objects().get(*object as usize)?;
            Some((
                format!("object {:?}", object.name),
                vec![self.cells.axes.own_box(&object.bounds)],
            ))
        });
        let cells = set.cells.iter().filter_map(|cell| {
            let bounds = self.cells.cells.get(cell.0 as usize)?.bounds;
            Some((format!("cell {}", cell.0), vec![bounds]))
        });
        let place = &self.declared[at].name.place;
        let hidden = rooms.chain(objects).chain(cells);
        hidden
            .filter_map(|(name, boxes)| {
                let [eye, point] = self.line(id, &boxes)?;
                let room = &self.rooms.list()[at].name;
                let what =
                    format!("room {room:?} hides {name}, but from {eye} one sees {point} in it");
                Some(RoomError::new(place, what))
            })
            .collect()
    }

    /// A free line from a room to boxes that it hides: its two ends, in the world's axes.
    fn line(&self, room: RoomId, targets: &[Aabb]) -> Option<[Vec3; 2]> {
        let mut rng = SmallRng::seed_from_u64(u64::from(room.0));
        let pieces = self.index.pieces(room);
        (0..LINES).find_map(|_| {
            let piece = &pieces[rng.random_range(0..pieces.len())];
            let eye = self.open(&mut rng, &piece.bounds)?;
            let target = &targets[rng.random_range(0..targets.len())];
            let point = self.open(&mut rng, target)?;
            let place =
                |at: Vec3| -> RoomOverlap { self.index.overlap(self.cells, &[Aabb::new(at, at)]) };
            let (from, to) = (place(eye), place(point));
            let is_hidden = from.touched().contains(&room) && !self.index.may_see(&from, &to);
            let ends = [eye, point].map(|at| self.cells.axes.world(at));
            (is_hidden && self.sight.between(ends[0], ends[1])).then_some(ends)
        })
    }

    /// A random point of a box that lies in a cell, in own axes. None when the drawn point does
    /// not.
    fn open(&self, rng: &mut SmallRng, region: &Aabb) -> Option<Vec3> {
        let region = region.intersection(&self.cells.bounds);
        if region.is_empty() {
            return None;
        }
        let at = inside(rng, &region);
        self.cells.at_own(at).map(|_| at)
    }
}
