//! Nodes of a glTF as rooms and windows: `room:NAME` and `window:ROOM/NAME`. Their meshes are not
//! drawn and hide nobody.
//!
//! A room is the convex hull of the mesh of its node. A level, flat mesh is a piece of the plan
//! instead. Several nodes of one name are parts of one room. The extras of a node give the other
//! settings, with the keys of the TOML file. `behind` in the extras of a window names another
//! window of the room.

use glam::{Vec2, Vec3};
use sightline_world::{rooms::Shape, tolerance::AUTHORED_POINT_M};

use super::{LocatedName, RoomDeclaration, RoomError, SourceLocation, WindowDeclaration, text};

/// What a node stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum NodeRole<'a> {
    /// A part of the room of this name.
    Room(&'a str),
    /// A window: the name of the room, and its own.
    Window(&'a str, &'a str),
}

/// The role of a node of this name. None for an ordinary node.
pub(crate) fn role(node: &str) -> Option<NodeRole<'_>> {
    if let Some(name) = node.strip_prefix("room:") {
        return Some(NodeRole::Room(without_number(name)));
    }
    let (room, name) = node.strip_prefix("window:")?.split_once('/')?;
    Some(NodeRole::Window(room, name))
}

/// The name without the number that modelling programs add to duplicates: `hall.001` is part of
/// `hall`.
fn without_number(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, number)) if number.len() == 3 && number.bytes().all(|b| b.is_ascii_digit()) => {
            stem
        }
        _ => name,
    }
}

/// Adds a part of a room, or a window, to the rooms so far. `corners` are those of the triangles of
/// the node, in the world's axes.
///
/// # Errors
/// When the node has no mesh, or a mesh without a shape, or unknown extras.
pub(crate) fn add(
    rooms: &mut Vec<RoomDeclaration>,
    node: &str,
    role: &NodeRole<'_>,
    corners: &[Vec3],
    extras: Option<&str>,
) -> Result<(), RoomError> {
    let place = SourceLocation::Node(node.to_owned());
    let named = |text: &str| LocatedName { text: text.to_owned(), place: place.clone() };
    let points = distinct(corners);
    if points.len() < 3 {
        return Err(RoomError::new(&place, "it has no mesh to take a shape from"));
    }
    let (NodeRole::Room(name) | NodeRole::Window(name, _)) = role;
    let at = rooms.iter().position(|room| room.name.text == *name).unwrap_or_else(|| {
        rooms.push(RoomDeclaration::named(named(name)));
        rooms.len() - 1
    });
    let room = &mut rooms[at];
    match role {
        NodeRole::Room(_) => {
            room.name.place = place.clone();
            room.shapes.push(shape(&points));
            extras.map_or(Ok(()), |extras| text::apply_extras(extras, room))
        }
        NodeRole::Window(_, name) => {
            let behind = extras.and_then(|extras| {
                let value: serde_json::Value = serde_json::from_str(extras).ok()?;
                value.get("behind")?.as_str().map(named)
            });
            let Some((normal, _)) = widest_plane(&points) else {
                return Err(RoomError::new(&place, "its mesh has no area"));
            };
            let (u, v) = normal.any_orthonormal_pair();
            let corners = hull2(&points, &|at| Vec2::new(u.dot(at), v.dot(at)));
            room.windows.push(WindowDeclaration { name: named(name), corners, behind });
            Ok(())
        }
    }
}

/// Sorts windows: each comes after the window that it is behind.
pub(crate) fn in_order(rooms: &mut [RoomDeclaration]) {
    for room in rooms {
        let mut left = std::mem::take(&mut room.windows);
        while !left.is_empty() {
            let is_next = |window: &WindowDeclaration| {
                let known =
                    |name: &LocatedName| room.windows.iter().any(|w| w.name.text == name.text);
                window.behind.as_ref().is_none_or(known)
            };
            // A window behind an unknown one stays; it is reported as an error later.
            let next = left.iter().position(is_next).unwrap_or(0);
            let window = left.remove(next);
            room.windows.push(window);
        }
    }
}

/// The normal and the distance of the plane of a polygon. None when it has no area.
pub(super) fn plane_of(corners: &[Vec3]) -> Option<(Vec3, f32)> {
    let first = *corners.first()?;
    let sum: Vec3 = corners.windows(2).map(|two| (two[0] - first).cross(two[1] - first)).sum();
    let normal = sum.try_normalize()?;
    let middle = corners.iter().sum::<Vec3>() / corners.len() as f32;
    Some((normal, normal.dot(middle)))
}

/// The shape of a mesh: a piece of the plan when level, otherwise a hull.
fn shape(points: &[Vec3]) -> Shape {
    let level = points[0].y;
    if points.iter().all(|at| (at.y - level).abs() < AUTHORED_POINT_M) {
        let plan = |at: Vec3| Vec2::new(at.x, at.z);
        let corners = hull2(points, &plan).into_iter().map(plan).collect();
        return Shape::Plan { corners, heights: None };
    }
    Shape::Hull(extreme(points))
}

/// The points without duplicates.
fn distinct(points: &[Vec3]) -> Vec<Vec3> {
    let mut kept: Vec<Vec3> = Vec::new();
    for point in points {
        // A mesh with more corners is no shape. It is reported as an error later.
        if kept.len() > 1_000 {
            break;
        }
        if !kept.iter().any(|other| other.distance(*point) < AUTHORED_POINT_M) {
            kept.push(*point);
        }
    }
    kept
}

/// The points that are furthest in one of many directions. When there are few enough points for a
/// hull, all are kept.
fn extreme(points: &[Vec3]) -> Vec<Vec3> {
    use sightline_world::rooms::HULL_POINTS_MAX;
    if points.len() <= HULL_POINTS_MAX {
        return points.to_vec();
    }
    let mut kept: Vec<Vec3> = Vec::new();
    for i in 0..2_000 {
        let (t, z) = (i as f32 * 2.399_963, 1.0 - (i as f32 + 0.5) / 1_000.0);
        let r = (1.0 - z * z).sqrt();
        let along = Vec3::new(r * t.cos(), z, r * t.sin());
        let furthest = points.iter().max_by(|a, b| along.dot(**a).total_cmp(&along.dot(**b)));
        kept.extend(furthest.filter(|at| !kept.contains(at)));
    }
    kept
}

/// The plane of three points that are far from each other.
fn widest_plane(points: &[Vec3]) -> Option<(Vec3, f32)> {
    let a = points[0];
    let b = *points.iter().max_by(|p, q| p.distance(a).total_cmp(&q.distance(a)))?;
    let away = |p: &Vec3| (*p - a).cross(b - a).length();
    let c = *points.iter().max_by(|p, q| away(p).total_cmp(&away(q)))?;
    plane_of(&[a, b, c])
}

/// The corners of the convex hull in a plane, in order around it (Andrew 1979).
fn hull2(points: &[Vec3], flat: &dyn Fn(Vec3) -> Vec2) -> Vec<Vec3> {
    let mut sorted: Vec<(Vec2, Vec3)> = points.iter().map(|at| (flat(*at), *at)).collect();
    sorted.sort_by(|(a, _), (b, _)| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &(Vec2, Vec3)>| {
        let mut chain: Vec<(Vec2, Vec3)> = Vec::new();
        for next in points {
            while let [.., (a, _), (b, _)] = chain[..]
                && (b - a).perp_dot(next.0 - b) <= AUTHORED_POINT_M * AUTHORED_POINT_M
            {
                chain.pop();
            }
            chain.push(*next);
        }
        chain.pop();
        chain
    };
    let lower = half(&mut sorted.iter());
    let upper = half(&mut sorted.iter().rev());
    lower.into_iter().chain(upper).map(|(_, at)| at).collect()
}
