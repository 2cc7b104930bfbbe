//! The openings of a room: portals from its cells to others, joined to a few windows.

use std::collections::{BTreeMap, HashMap};

use glam::Vec3;
use sightline_world::{Polygon, World, geometry::Aabb, tolerance::TOUCH_M};

use super::room::{SuggestedRoom, SuggestedWindow};

/// Rectangles no farther apart than this are one window, in metres.
const APART_M: f32 = 0.02;

/// A narrower window is a crack, in metres. It joins the nearest window beside it, or else becomes
/// this wide: nobody wants to edit windows of half a millimetre, and leaving one out would deny
/// what is visible through it.
const NARROW_M: f32 = 0.05;

/// The plane of an opening and the room behind it. Openings with the same key are joined.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Wall {
    axis: u8,
    at_mm: i64,
    to: Option<usize>,
}

/// The windows of a room. `taken` gives the room of each cell.
pub(super) fn windows(
    world: &World,
    taken: &[Option<usize>],
    room: usize,
    own: &SuggestedRoom,
    names: &[String],
) -> Vec<SuggestedWindow> {
    let cells = &world.cells;
    let boxes = &own.boxes;
    let mut walls: BTreeMap<Wall, Vec<Aabb>> = BTreeMap::new();
    let mut slanted: Vec<(Option<usize>, Vec<Vec3>)> = Vec::new();
    for cell in &own.cells {
        for portal in &cells.cells[cell.0 as usize].portals {
            let portal = &cells.portals[*portal as usize];
            let beyond = portal.cells[usize::from(portal.cells[0] == *cell)];
            let to = taken[beyond.0 as usize];
            if to == Some(room) {
                continue;
            }
            let bounds = portal.polygon.bounds();
            let flat = (0..3u8).find(|axis| bounds.size()[usize::from(*axis)] < TOUCH_M);
            match (flat, &portal.polygon) {
                (Some(axis), _) => {
                    let at_mm = (f64::from(bounds.min[usize::from(axis)]) * 1e3).round() as i64;
                    walls.entry(Wall { axis, at_mm, to }).or_default().push(bounds);
                }
                (None, Polygon::Other { corners, .. }) => slanted.push((to, corners.to_vec())),
                (None, Polygon::Rectangle { .. }) => (),
            }
        }
    }
    let flat = walls.into_iter().flat_map(|(wall, parts)| {
        let is_on = |part: &Aabb| is_on_boundary(boxes, part, wall.axis);
        without_cracks(joined(parts, is_on), wall.axis, is_on)
            .into_iter()
            .map(move |part| (wall.to, corners(&part, wall.axis)))
    });
    let mut count: HashMap<Option<usize>, usize> = HashMap::new();
    flat.chain(slanted)
        .map(|(to, own)| {
            let number = count.entry(to).or_default();
            *number += 1;
            let to = to.and_then(|to| names.get(to)).map_or("elsewhere", String::as_str);
            let name = if *number == 1 { format!("to {to}") } else { format!("to {to}, {number}") };
            SuggestedWindow {
                name,
                corners: own.into_iter().map(|at| cells.axes.world(at)).collect(),
            }
        })
        .collect()
}

/// Joins rectangles of one plane that touch, where the rectangle around them is on the boundary of
/// the room too. Windows become larger, never smaller.
fn joined(mut parts: Vec<Aabb>, is_on: impl Fn(&Aabb) -> bool) -> Vec<Aabb> {
    let mut at = 0;
    while at < parts.len() {
        let touching = (at + 1..parts.len()).find(|other| {
            parts[at].grown(APART_M).intersects(&parts[*other])
                && is_on(&parts[at].union(&parts[*other]))
        });
        match touching {
            Some(other) => {
                let other = parts.swap_remove(other);
                parts[at] = parts[at].union(&other);
                // The joined rectangle may touch others.
                at = 0;
            }
            None => at += 1,
        }
    }
    parts
}

/// Windows of one plane, without cracks as far as the boundary of the room allows.
fn without_cracks(parts: Vec<Aabb>, axis: u8, is_on: impl Fn(&Aabb) -> bool) -> Vec<Aabb> {
    let (cracks, mut wide): (Vec<Aabb>, Vec<Aabb>) =
        parts.into_iter().partition(|part| !narrow_sides(part, axis).is_empty());
    for crack in cracks {
        let away = |part: &Aabb| (part.centre() - crack.centre()).length_squared();
        let nearest = (0..wide.len())
            .filter(|other| is_on(&crack.union(&wide[*other])))
            .min_by(|a, b| away(&wide[*a]).total_cmp(&away(&wide[*b])));
        match nearest {
            Some(other) => wide[other] = wide[other].union(&crack),
            None => wide.push(widened(crack, axis, &is_on)),
        }
    }
    wide
}

/// The axes along which a window is narrow.
fn narrow_sides(part: &Aabb, axis: u8) -> Vec<usize> {
    let sides = [(axis + 1) % 3, (axis + 2) % 3].map(usize::from);
    sides.into_iter().filter(|side| part.size()[*side] < NARROW_M).collect()
}

/// A crack made wider, on both sides or on the one where the room's boundary goes on.
fn widened(crack: Aabb, axis: u8, is_on: &impl Fn(&Aabb) -> bool) -> Aabb {
    narrow_sides(&crack, axis).into_iter().fold(crack, |window, side| {
        let more = NARROW_M - window.size()[side];
        let grown = [0.5, 0.0, 1.0].map(|share| {
            let mut grown = window;
            grown.min[side] -= more * share;
            grown.max[side] += more * (1.0 - share);
            grown
        });
        grown.into_iter().find(is_on).unwrap_or(window)
    })
}

/// Whether a rectangle is part of one side of one box, and inside no other box.
fn is_on_boundary(boxes: &[Aabb], part: &Aabb, axis: u8) -> bool {
    let axis = usize::from(axis);
    let beside = |far: f32| {
        let mut beside = part.grown(-APART_M * 0.5);
        (beside.min[axis], beside.max[axis]) = (part.min[axis] + far, part.max[axis] + far);
        beside
    };
    let sides = [beside(APART_M), beside(-APART_M)];
    let holds = |side: &Aabb| boxes.iter().any(|region| region.contains_box(side));
    let meets = |side: &Aabb| boxes.iter().any(|region| region.intersects(side));
    (holds(&sides[0]) && !meets(&sides[1])) || (holds(&sides[1]) && !meets(&sides[0]))
}

/// The corners of a rectangle perpendicular to an axis, in order.
fn corners(part: &Aabb, axis: u8) -> Vec<Vec3> {
    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(usize::from);
    let ends = [part.min, part.max];
    [(0, 0), (1, 0), (1, 1), (0, 1)]
        .into_iter()
        .map(|(i, j): (usize, usize)| {
            let mut at = part.min;
            at[u] = ends[i][u];
            at[v] = ends[j][v];
            at
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rectangle at x = 0.
    fn part(y: [f32; 2], z: [f32; 2]) -> Aabb {
        Aabb::new(Vec3::new(0.0, y[0], z[0]), Vec3::new(0.0, y[1], z[1]))
    }

    #[test]
    fn cracks_join_the_window_beside_them_or_become_wider() {
        let room = [Aabb::new(Vec3::ZERO, Vec3::new(5.0, 3.0, 5.0))];
        let is_on = |part: &Aabb| is_on_boundary(&room, part, 0);
        let (door, crack) = (part([0.0, 2.0], [1.0, 2.0]), part([0.0, 2.0], [2.5, 2.5004]));
        let found = without_cracks(vec![crack, door], 0, is_on);
        assert_eq!(found, [part([0.0, 2.0], [1.0, 2.5004])]);
        let [alone] = without_cracks(vec![crack], 0, is_on)[..] else { panic!("one window") };
        assert!(alone.contains_box(&crack) && (alone.size().z - NARROW_M).abs() < 1.0e-5);
        let [top] = without_cracks(vec![part([2.999, 3.0], [1.0, 4.0])], 0, is_on)[..] else {
            panic!("one window")
        };
        assert!((top.size().y - NARROW_M).abs() < 1.0e-5 && top.max.y <= 3.0, "{top:?}");
        assert_eq!(without_cracks(vec![door], 0, is_on), [door]);
    }
}
