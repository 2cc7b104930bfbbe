//! How policies for comparison divide the world: into squares of a grid, or into rooms.

use glam::{IVec2, Vec2, Vec3, Vec3Swizzles};
use roaring::RoaringBitmap;
use sightline_world::{Cells, Gate, Polygon, Space, World, geometry::Aabb};

use crate::config::Policy;

/// A gate with both sides longer than this is not a door, in metres.
const DOOR_M: f32 = 1.6;
/// A gate that fills at least this share of the side of both its spaces is not a door, from 0 to 1.
/// The subdivision has cut a corridor or a hall there.
const OPEN_SHARE: f32 = 0.5;
/// A part with less floor than this is not a room of its own, in square metres. An example is the
/// way through a wall.
const ROOM_M2: f32 = 2.0;

/// The part of the world that a policy counts an avatar in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Area {
    /// None: the policy does not divide the world, or the avatar has never been in a room.
    #[default]
    None,
    /// A square of a horizontal grid.
    Square(IVec2),
    /// A room, by number.
    Room(u32),
}

/// How a policy divides the world.
#[derive(Clone, Debug)]
pub(crate) enum Partition {
    /// Not at all.
    None,
    /// Into squares. An avatar stays in its square until it is further outside than the margin.
    /// Both are in metres.
    Squares { edge: f32, margin: f32 },
    /// Into rooms.
    Rooms(Rooms),
}

impl Partition {
    pub(crate) fn new(policy: Policy, world: &World) -> Self {
        match policy {
            Policy::Region { edge, margin } => Self::Squares { edge, margin },
            Policy::Room { doors } => Self::Rooms(Rooms::new(&world.cells, doors)),
            _ => Self::None,
        }
    }

    /// The area of an avatar, given the area before. In a wall or outside, it stays the same.
    pub(crate) fn area_of(&self, world: &World, before: Area, eye: Vec3) -> Area {
        match self {
            Self::None => Area::None,
            Self::Squares { edge, margin } => square(*edge, *margin, before, eye.xz()),
            Self::Rooms(rooms) => {
                let cell = world.cells.near(eye);
                cell.map_or(before, |cell| {
                    let space = world.cells.cells[cell.0 as usize].space;
                    Area::Room(rooms.by_space[space as usize])
                })
            }
        }
    }

    /// Whether a viewer in one area is told of an avatar in another.
    pub(crate) fn tells(&self, viewer: Area, avatar: Area) -> bool {
        match (self, viewer, avatar) {
            (Self::Squares { .. }, Area::Square(a), Area::Square(b)) => {
                let apart = a.saturating_sub(b);
                (apart.cmpge(IVec2::NEG_ONE) & apart.cmple(IVec2::ONE)).all()
            }
            (Self::Rooms(rooms), Area::Room(a), Area::Room(b)) => {
                rooms.reached[a as usize].contains(b)
            }
            _ => false,
        }
    }
}

/// The square of an avatar: the one it was in, until it is further outside than the margin.
fn square(edge: f32, margin: f32, before: Area, at: Vec2) -> Area {
    if let Area::Square(square) = before {
        let corner = square.as_vec2();
        let (low, high) = (corner * edge - margin, (corner + 1.0) * edge + margin);
        if at.cmpge(low).all() && at.cmple(high).all() {
            return before;
        }
    }
    Area::Square((at / edge).floor().as_ivec2())
}

/// Rooms that no author named: the world's spaces, merged where a gate between them is more than a
/// door.
///
/// Two spaces are in one room when both sides of a gate between them are longer than [`DOOR_M`], or
/// when the gate fills at least [`OPEN_SHARE`] of the side of both. A part with less floor than
/// [`ROOM_M2`] joins the room that its largest gate leads to.
#[derive(Clone, Debug)]
pub(crate) struct Rooms {
    /// The room of each space.
    by_space: Vec<u32>,
    /// For each room, itself and the rooms within the number of doors that the policy allows.
    reached: Vec<RoaringBitmap>,
}

impl Rooms {
    /// Finds the rooms of a world, and for each the rooms that are at most `doors` doors away.
    fn new(cells: &Cells, doors: u32) -> Self {
        let spaces = &cells.spaces;
        let mut sets = Sets((0..spaces.len() as u32).collect());
        for gate in cells.gates.iter().filter(|gate| is_open(spaces, gate)) {
            sets.join(gate.spaces);
        }
        let mut floors = vec![0.0; spaces.len()];
        for (space, of) in (0..).zip(spaces) {
            floors[sets.find(space) as usize] += of.bounds.size().x * of.bounds.size().z;
        }
        let mut gates: Vec<&Gate> = cells.gates.iter().collect();
        gates.sort_by(|a, b| area(&b.polygon).total_cmp(&area(&a.polygon)));
        for gate in gates {
            let [a, b] = gate.spaces.map(|space| sets.find(space));
            if a != b && floors[a as usize].min(floors[b as usize]) < ROOM_M2 {
                let together = floors[a as usize] + floors[b as usize];
                floors[sets.join([a, b]) as usize] = together;
            }
        }
        let by_space: Vec<u32> = (0..spaces.len() as u32).map(|space| sets.find(space)).collect();
        let reached = reached(&by_space, &cells.gates, doors);
        Self { by_space, reached }
    }
}

/// Whether a gate is wider than a door.
fn is_open(spaces: &[Space], gate: &Gate) -> bool {
    let sides = sides(&gate.polygon);
    if sides[0] > DOOR_M {
        return true;
    }
    let Polygon::Rectangle { axis, bounds } = &gate.polygon else { return false };
    let across = |of: &Aabb| {
        let size = of.size();
        let [u, v] = [1, 2].map(|next| size[(usize::from(*axis) + next) % 3]);
        u * v
    };
    let side_of = |space: u32| across(&spaces[space as usize].bounds);
    gate.spaces.iter().all(|space| across(bounds) >= OPEN_SHARE * side_of(*space))
}

/// The lengths of a polygon's sides in metres, the lesser first. A slanted polygon counts by its
/// width and height.
fn sides(polygon: &Polygon) -> [f32; 2] {
    let size = polygon.bounds().size();
    let sides = match polygon {
        Polygon::Rectangle { axis, .. } => [1, 2].map(|next| size[(usize::from(*axis) + next) % 3]),
        Polygon::Other { .. } => [size.xz().length(), size.y],
    };
    [sides[0].min(sides[1]), sides[0].max(sides[1])]
}

fn area(polygon: &Polygon) -> f32 {
    let [lesser, greater] = sides(polygon);
    lesser * greater
}

/// For each room, itself and the rooms that are at most `doors` doors away.
fn reached(by_space: &[u32], gates: &[Gate], doors: u32) -> Vec<RoaringBitmap> {
    let mut next = vec![RoaringBitmap::new(); by_space.len()];
    for gate in gates {
        let [a, b] = gate.spaces.map(|space| by_space[space as usize]);
        next[a as usize].insert(b);
        next[b as usize].insert(a);
    }
    let reached_from = |room: u32| {
        let mut all = RoaringBitmap::from_iter([room]);
        let mut edge = all.clone();
        for _ in 0..doors {
            let beyond = edge.iter().fold(RoaringBitmap::new(), |sum, r| sum | &next[r as usize]);
            edge = beyond - &all;
            if edge.is_empty() {
                break;
            }
            all |= &edge;
        }
        all
    };
    (0..by_space.len() as u32).map(reached_from).collect()
}

/// Disjoint sets of numbers. Each number names its parent; the root of a set names itself.
struct Sets(Vec<u32>);

impl Sets {
    fn find(&mut self, mut one: u32) -> u32 {
        while self.0[one as usize] != one {
            let up = self.0[one as usize];
            self.0[one as usize] = self.0[up as usize];
            one = up;
        }
        one
    }

    /// Joins the sets of two numbers. Returns the root of the union: the lesser of the two roots.
    fn join(&mut self, two: [u32; 2]) -> u32 {
        let [a, b] = two.map(|one| self.find(one));
        let (lesser, greater) = (a.min(b), a.max(b));
        self.0[greater as usize] = lesser;
        lesser
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::stage;

    #[test]
    fn a_square_is_left_only_past_the_margin() {
        let partition = Partition::Squares { edge: 10.0, margin: 2.0 };
        let world = stage::row(3);
        let mut area = Area::None;
        for (x, square) in [(9.0, 0), (11.9, 0), (12.1, 1), (8.1, 1), (7.9, 0), (35.0, 3)] {
            area = partition.area_of(&world, area, Vec3::new(x, 1.6, 5.0));
            assert_eq!(area, Area::Square(IVec2::new(square, 0)), "{x}");
        }
        let at = |x, z| Area::Square(IVec2::new(x, z));
        assert!(partition.tells(at(0, 0), at(1, -1)) && !partition.tells(at(0, 0), at(2, 0)));
        assert!(!partition.tells(Area::None, at(0, 0)));
    }

    #[test]
    fn rooms_end_at_doors() {
        let mut world = stage::row(5);
        // A door is between rooms 1 and 2, and the way through a wall behind it. The rest is open.
        for (gate, width) in [(1, 1.0), (2, 1.5)] {
            let Polygon::Rectangle { bounds, .. } = &mut world.cells.gates[gate].polygon else {
                unreachable!("rooms in a row join in rectangles")
            };
            bounds.max.z = width;
        }
        let spaces = &mut world.cells.spaces;
        spaces[2].bounds.max.x = spaces[2].bounds.min.x + 0.15;
        let check = |doors: u32, told: [bool; 5]| {
            let partition = Partition::new(Policy::Room { doors }, &world);
            let at = |x: f32| partition.area_of(&world, Area::None, Vec3::new(x, 1.6, 5.0));
            let from_first =
                [0, 1, 2, 3, 4].map(|i| partition.tells(at(5.0), at(5.0 + 10.0 * i as f32)));
            assert_eq!(from_first, told, "{doors} doors");
        };
        check(0, [true, true, false, false, false]);
        check(1, [true; 5]);
    }

    #[test]
    fn a_corridor_as_narrow_as_a_door_is_one_room() {
        let mut world = stage::row(3);
        for space in &mut world.cells.spaces {
            space.bounds.max.z = 1.2;
        }
        for gate in &mut world.cells.gates {
            let Polygon::Rectangle { bounds, .. } = &mut gate.polygon else {
                unreachable!("rooms in a row join in rectangles")
            };
            bounds.max.z = 1.2;
        }
        let rooms = Rooms::new(&world.cells, 0);
        assert_eq!(rooms.by_space, [0, 0, 0]);
        assert_eq!(rooms.reached[0].len(), 1);
    }
}
