//! The convex pieces that a room's shapes consist of.

use glam::{DVec3, Vec2, Vec3};
use sightline_world::{
    geometry::{Aabb, Axes},
    rooms::{EXTENT_MAX, Shape},
    tolerance::ROOM_BOUNDARY_M,
};

use crate::{Containment, HalfSpace};

/// The most times that a box is split to find out whether several pieces cover it.
const SPLITS_MAX: u32 = 48;

/// A convex piece of a room, in own axes.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexPiece {
    /// The smallest box around it.
    pub bounds: Aabb,
    /// The sides that are not axial. The piece is the intersection of these and the box.
    pub sides: Vec<HalfSpace>,
    /// The corners of each face, in order.
    pub faces: Vec<Vec<Vec3>>,
}

impl ConvexPiece {
    /// The convex pieces of a shape, in own axes. A flat shape has none.
    pub fn of(shape: &Shape, axes: &Axes) -> Vec<Self> {
        let own = |points: Vec<Vec3>| points.into_iter().map(|point| axes.own(point)).collect();
        match shape {
            Shape::Plan { corners, heights } => {
                let heights = heights.unwrap_or([-EXTENT_MAX, EXTENT_MAX]);
                let own = |at: &Vec2| {
                    let own = axes.own(Vec3::new(at.x, 0.0, at.y));
                    Vec2::new(own.x, own.z)
                };
                let parts = convex_parts(&corners.iter().map(own).collect::<Vec<_>>());
                parts.iter().filter_map(|ring| Self::prism(ring, heights)).collect()
            }
            Shape::Box(region) => Self::hull(own(region.corners().to_vec())).into_iter().collect(),
            Shape::Hull(points) => Self::hull(own(points.clone())).into_iter().collect(),
        }
    }

    /// A prism over a convex polygon of the plan, between two heights. Corners are x and z, in the
    /// order that turns from x towards z. None if the polygon has no area.
    fn prism(ring: &[Vec2], [low, high]: [f32; 2]) -> Option<Self> {
        if ring.len() < 3 || area(ring) <= 0.0 {
            return None;
        }
        let level = |y: f32| ring.iter().map(move |at| Vec3::new(at.x, y, at.y));
        let bounds = Aabb::from_points(level(low).chain(level(high)));
        let mut faces = vec![level(low).collect::<Vec<_>>(), level(high).collect()];
        let mut sides = Vec::new();
        for (from, to) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            let along = (*to - *from).as_dvec2();
            let normal = tidied(DVec3::new(along.y, 0.0, -along.x).normalize_or_zero());
            let at = DVec3::new(from.x.into(), 0.0, from.y.into());
            sides.push(HalfSpace { normal, distance: normal.dot(at) });
            let [a, b] = [from, to].map(|at| [low, high].map(|y| Vec3::new(at.x, y, at.y)));
            faces.push(vec![a[0], b[0], b[1], a[1]]);
        }
        sides.retain(|side| side.normal.abs().max_element() < 1.0 - 1e-9);
        Some(Self { bounds, sides, faces })
    }

    /// The convex hull of some points. None if it is flat. Every plane through three points that
    /// has all other points on one side is a side. That is fast enough, since there are few points.
    pub fn hull(points: Vec<Vec3>) -> Option<Self> {
        let bounds = Aabb::from_points(points.iter().copied());
        let exact: Vec<DVec3> = points.iter().map(|point| point.as_dvec3()).collect();
        let mut sides: Vec<HalfSpace> = Vec::new();
        for (i, a) in exact.iter().enumerate() {
            for (j, b) in exact.iter().enumerate().skip(i + 1) {
                for c in &exact[j + 1..] {
                    sides.extend(
                        side_of([*a, *b, *c], &exact).filter(|side| !is_known(&sides, side)),
                    );
                }
            }
        }
        if sides.len() < 4 {
            return None;
        }
        debug_assert!(sides.iter().all(|side| (side.normal.length() - 1.0).abs() < 1e-6));
        let faces = sides.iter().map(|side| face(side, &exact)).collect();
        sides.retain(|side| side.normal.abs().max_element() < 1.0 - 1e-9);
        Some(Self { bounds, sides, faces })
    }

    /// Whether a point is inside or on the boundary.
    pub fn contains(&self, point: Vec3) -> bool {
        self.bounds.contains(point) && self.sides.iter().all(|side| side.holds(point, 0.0))
    }

    /// Whether all of a box is inside, or outside by rounding only.
    pub fn contains_box(&self, region: &Aabb) -> bool {
        let within = |side: &HalfSpace| {
            side.moved(ROOM_BOUNDARY_M.into()).containment(region) == Containment::Inside
        };
        self.bounds.grown(ROOM_BOUNDARY_M).contains_box(region) && self.sides.iter().all(within)
    }

    /// Whether some of a box may be inside: may be wrongly true, never wrongly false.
    pub fn meets(&self, region: &Aabb) -> bool {
        let apart = |side: &HalfSpace| {
            side.moved(ROOM_BOUNDARY_M.into()).containment(region) == Containment::Outside
        };
        self.bounds.grown(ROOM_BOUNDARY_M).intersects(region) && !self.sides.iter().any(apart)
    }

    /// All sides, those of the box around the piece included.
    pub fn all_sides(&self) -> impl Iterator<Item = HalfSpace> + '_ {
        let axial = (0..6).map(|i| HalfSpace::of_box(&self.bounds, i));
        axial.chain(self.sides.iter().copied())
    }
}

/// Whether pieces together hold all of a box: may be wrongly false, never wrongly true.
pub(super) fn cover<'a>(pieces: impl Iterator<Item = &'a ConvexPiece>, region: &Aabb) -> bool {
    let pieces: Vec<&ConvexPiece> = pieces.filter(|piece| piece.meets(region)).collect();
    let mut open = vec![*region];
    let mut splits = 0;
    while let Some(part) = open.pop() {
        if pieces.iter().any(|piece| piece.contains_box(&part)) {
            continue;
        }
        let cut = pieces.iter().filter(|piece| piece.meets(&part)).find_map(|piece| {
            let inside = piece.bounds.intersection(&part);
            (0..3).find_map(|axis| {
                let at = |at: f32| {
                    at > part.min[axis] + ROOM_BOUNDARY_M && at < part.max[axis] - ROOM_BOUNDARY_M
                };
                [inside.min[axis], inside.max[axis]].into_iter().find(|x| at(*x)).map(|x| (axis, x))
            })
        });
        let Some((axis, at)) = cut.filter(|_| splits < SPLITS_MAX) else { return false };
        splits += 1;
        let (mut low, mut high) = (part, part);
        (low.max[axis], high.min[axis]) = (at, at);
        open.extend([low, high]);
    }
    true
}

/// The half-space whose plane holds three points, if all points are in it.
fn side_of([a, b, c]: [DVec3; 3], all: &[DVec3]) -> Option<HalfSpace> {
    let normal = (b - a).cross(c - a);
    let scale = (b - a).length() * (c - a).length();
    let normal = (normal.length() > 1e-6 * scale).then(|| tidied(normal.normalize()))?;
    let ahead = |point: &DVec3| normal.dot(*point - a);
    let (least, most) =
        all.iter().map(ahead).fold((0.0_f64, 0.0_f64), |(x, y), d| (x.min(d), y.max(d)));
    let tolerance = f64::from(ROOM_BOUNDARY_M) * 0.5;
    if most < tolerance && least < -tolerance {
        Some(HalfSpace { normal, distance: normal.dot(a) + most })
    } else if least > -tolerance && most > tolerance {
        Some(HalfSpace { normal: -normal, distance: -normal.dot(a) - least })
    } else {
        None
    }
}

/// Makes a normal exactly axial if it is axial but for rounding.
fn tidied(normal: DVec3) -> DVec3 {
    let is_axis = normal.abs().max_element() > 1.0 - 1e-10;
    if is_axis { normal.round() } else { normal }
}

/// Whether sides hold another one already, but for rounding.
fn is_known(sides: &[HalfSpace], side: &HalfSpace) -> bool {
    let alike = |known: &HalfSpace| {
        known.normal.dot(side.normal) > 1.0 - 1e-9
            && (known.distance - side.distance).abs() < f64::from(ROOM_BOUNDARY_M)
    };
    sides.iter().any(alike)
}

/// The points on a side, in order around their centre.
fn face(side: &HalfSpace, points: &[DVec3]) -> Vec<Vec3> {
    let on = |point: &&DVec3| side.normal.dot(**point) > side.distance - f64::from(ROOM_BOUNDARY_M);
    let mut on: Vec<DVec3> = points.iter().filter(on).copied().collect();
    let centre = on.iter().sum::<DVec3>() / on.len().max(1) as f64;
    let (u, v) = side.normal.any_orthonormal_pair();
    let angle = |point: &DVec3| v.dot(*point - centre).atan2(u.dot(*point - centre));
    on.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    on.into_iter().map(|point| point.as_vec3()).collect()
}

/// Divides a polygon that does not cross itself into convex ones, by cutting off ears. The parts of
/// one that does lie in its bounding box.
pub(super) fn convex_parts(corners: &[Vec2]) -> Vec<Vec<Vec2>> {
    let mut ring: Vec<Vec2> = corners.to_vec();
    ring.dedup_by(|a, b| a.distance(*b) < ROOM_BOUNDARY_M);
    if area(&ring) < 0.0 {
        ring.reverse();
    }
    if ring.len() < 3 || is_convex(&ring) {
        return vec![ring];
    }
    let mut parts: Vec<Vec<Vec2>> = Vec::new();
    while ring.len() > 3 {
        let count = ring.len();
        let at = |i: usize| ring[i % count];
        let is_ear = |&i: &usize| {
            let ear = [at(i), at(i + 1), at(i + 2)];
            let inside = |p: &Vec2| !ear.contains(p) && is_inside(&ear, *p);
            cross(ear[0], ear[1], ear[2]) > 0.0 && !ring.iter().any(inside)
        };
        let tip = (0..count).find(is_ear).unwrap_or(0);
        parts.push(vec![at(tip), at(tip + 1), at(tip + 2)]);
        ring.remove((tip + 1) % count);
    }
    parts.push(ring);
    parts.retain(|part| area(part) > 0.0);
    join(parts)
}

/// Merges parts that share an edge, where the result is convex.
fn join(mut parts: Vec<Vec<Vec2>>) -> Vec<Vec<Vec2>> {
    let mut at = 0;
    while at < parts.len() {
        let other = (at + 1..parts.len()).find_map(|other| {
            let joined = joined(&parts[at], &parts[other])?;
            Some((other, joined))
        });
        match other {
            Some((other, joined)) => {
                parts[at] = joined;
                parts.swap_remove(other);
            }
            None => at += 1,
        }
    }
    parts
}

/// Two polygons that share an edge as one, if that is convex.
fn joined(a: &[Vec2], b: &[Vec2]) -> Option<Vec<Vec2>> {
    for i in 0..a.len() {
        let (from, to) = (a[i], a[(i + 1) % a.len()]);
        let shared = (0..b.len()).find(|&j| b[j] == to && b[(j + 1) % b.len()] == from);
        let Some(j) = shared else { continue };
        let rest_of_a = (1..=a.len()).map(|k| a[(i + k) % a.len()]);
        let rest_of_b = (2..b.len()).map(|k| b[(j + k) % b.len()]);
        let ring: Vec<Vec2> = rest_of_a.chain(rest_of_b).collect();
        return is_convex(&ring).then_some(ring);
    }
    None
}

fn cross(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    (b - a).perp_dot(c - b)
}

/// The signed area of a polygon.
fn area(ring: &[Vec2]) -> f32 {
    let Some(first) = ring.first() else { return 0.0 };
    ring.windows(2).map(|two| (two[0] - first).perp_dot(two[1] - first)).sum::<f32>() * 0.5
}

fn is_convex(ring: &[Vec2]) -> bool {
    let count = ring.len();
    let bends = (0..count).map(|i| cross(ring[i], ring[(i + 1) % count], ring[(i + 2) % count]));
    let turn: f32 = (0..count)
        .map(|i| {
            (ring[(i + 1) % count] - ring[i])
                .angle_to(ring[(i + 2) % count] - ring[(i + 1) % count])
        })
        .sum();
    bends.into_iter().all(|bend| bend >= -1e-6) && turn < std::f32::consts::TAU * 1.25
}

fn is_inside(ring: &[Vec2], point: Vec2) -> bool {
    let count = ring.len();
    (0..count).all(|i| (ring[(i + 1) % count] - ring[i]).perp_dot(point - ring[i]) >= 0.0)
}

/// Divides a polygon in space into convex ones, in its plane. A polygon without an area has none.
pub(super) fn convex_polygons(corners: &[Vec3]) -> Vec<Vec<DVec3>> {
    let exact: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3()).collect();
    let Some(normal) = normal(&exact) else { return Vec::new() };
    let (u, v) = normal.any_orthonormal_pair();
    let origin = exact[0];
    let flat: Vec<Vec2> = exact
        .iter()
        .map(|corner| Vec2::new(u.dot(*corner - origin) as f32, v.dot(*corner - origin) as f32))
        .collect();
    let back = |at: &Vec2| origin + u * f64::from(at.x) + v * f64::from(at.y);
    convex_parts(&flat).iter().map(|part| part.iter().map(back).collect()).collect()
}

/// The unit normal of a polygon, by Newell's method (Sutherland, Sproull and Schumacker 1974). None
/// if the polygon has no area.
pub(super) fn normal(corners: &[DVec3]) -> Option<DVec3> {
    let first = corners.first()?;
    let sum: DVec3 = corners.windows(2).map(|two| (two[0] - first).cross(two[1] - first)).sum();
    (sum.length() > 1e-9).then(|| tidied(sum.normalize()))
}
