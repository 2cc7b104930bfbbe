//! Occluders in flat surfaces: large rectangles that coplanar triangles cover together.

use std::{collections::HashMap, ops::ControlFlow};

use glam::{DVec2, DVec3, Vec3};
use sightline_world::{
    World,
    geometry::Aabb,
    tolerance::{BESIDE_SURFACE_M, CLOSED_M, COPLANAR_M, SEED_M},
};

use super::{bvh::Bvh, solid_occluders::SolidOccluders};

/// A rectangle narrower than this, in metres, hides nobody.
const WIDTH_MIN_M: f64 = 0.1;
/// A rectangle or triangle smaller than this, in square metres, hides nobody.
const AREA_MIN_M2: f64 = 0.05;
/// The most pieces of strips that are tested in a whole world: some seconds of work.
const WORK_MAX: usize = 20_000_000;

/// A triangle in the coordinates of its plane, counter-clockwise.
type PlaneTriangle = [DVec2; 3];

/// A plane and the triangles in it.
struct TrianglePlane {
    origin: DVec3,
    u: DVec3,
    v: DVec3,
    triangles: Vec<PlaneTriangle>,
}

/// A rectangle along the two directions of its plane.
#[derive(Clone, Copy)]
struct PlaneRect {
    min: DVec2,
    max: DVec2,
}

/// Convex polygons in opaque surfaces that are not the faces of a solid, each with its corners in
/// order.
pub(super) fn surface_occluders(world: &World, solid: &SolidOccluders<'_>) -> Vec<Vec<DVec3>> {
    let axes = &world.cells.axes;
    let corner = |index: u32| axes.own_exact(world.mesh.positions[index as usize].as_dvec3());
    let triangles = world.mesh.triangles.iter().map(|triangle| triangle.map(corner));
    let mut work = WORK_MAX;
    let has_brushes = world.origin.is_some();
    let free: Vec<[DVec3; 3]> =
        triangles.filter(|corners| is_thin(corners, solid, has_brushes)).collect();
    planes(&free).iter().flat_map(|plane| plane.polygons(&mut work)).collect()
}

/// Whether a triangle is not the face of a solid that is an occluder itself. Without brushes, only
/// axial triangles can be such faces.
fn is_thin(corners: &[DVec3; 3], solid: &SolidOccluders<'_>, has_brushes: bool) -> bool {
    let [a, b, c] = *corners;
    let Some(normal) = (b - a).cross(c - a).try_normalize() else { return false };
    if !has_brushes && axis_of(corners).is_none() {
        return true;
    }
    let middle = (a + b + c) / 3.0;
    [BESIDE_SURFACE_M, -BESIDE_SURFACE_M]
        .iter()
        .all(|away| !solid.holds((middle + normal * away).as_vec3()))
}

/// Groups triangles by plane, in the order of the model.
fn planes(triangles: &[[DVec3; 3]]) -> Vec<TrianglePlane> {
    let mut found: Vec<(DVec3, TrianglePlane)> = Vec::new();
    let mut alike: HashMap<[i64; 4], Vec<usize>> = HashMap::new();
    for corners in triangles {
        let [a, b, c] = *corners;
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
        let axis = axis_of(corners);
        let normal = axis.map_or(normal, |axis| DVec3::AXES[axis]);
        let normal = if normal.dot(DVec3::new(1.0, 1.1, 1.2)) < 0.0 { -normal } else { normal };
        let key = |by: f64| {
            let [x, y, z] = (normal * 100.0).round().to_array().map(|n| n as i64);
            [x, y, z, (normal.dot(a) + by).floor() as i64]
        };
        let fits = |index: &&usize| {
            let (normal, plane) = &found[**index];
            corners.iter().all(|corner| normal.dot(corner - plane.origin).abs() <= COPLANAR_M)
        };
        let known = [0.0, 1e-3, -1e-3].map(key);
        let known = known.iter().filter_map(|key| alike.get(key)).flatten().find(fits).copied();
        let index = known.unwrap_or_else(|| {
            alike.entry(key(0.0)).or_default().push(found.len());
            let [u, v] = directions(normal, axis, corners);
            found.push((normal, TrianglePlane { origin: a, u, v, triangles: Vec::new() }));
            found.len() - 1
        });
        let plane = &mut found[index].1;
        let [a, b, c] = corners.map(|corner| {
            DVec2::new((corner - plane.origin).dot(plane.u), (corner - plane.origin).dot(plane.v))
        });
        plane.triangles.push(if (b - a).perp_dot(c - a) > 0.0 { [a, b, c] } else { [a, c, b] });
    }
    found.into_iter().map(|(_, plane)| plane).collect()
}

/// The axis that is normal to a triangle, if there is one.
fn axis_of([a, b, c]: &[DVec3; 3]) -> Option<usize> {
    (0..3).find(|&axis| (a.max(*b).max(*c) - a.min(*b).min(*c))[axis] <= COPLANAR_M)
}

/// The two directions in a plane along which rectangles lie. They are axes in an axial plane, level
/// and upwards in an upright one, and else along and across the longest edge of a triangle.
fn directions(normal: DVec3, axis: Option<usize>, corners: &[DVec3; 3]) -> [DVec3; 2] {
    if let Some(axis) = axis {
        return [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
    }
    let [a, b, c] = *corners;
    let longest =
        [b - a, c - b, a - c].into_iter().max_by(|a, b| a.length().total_cmp(&b.length()));
    let level = DVec3::Y.cross(normal).try_normalize();
    let is_upright = normal.y.abs() < 1e-6;
    let along = longest.unwrap_or(DVec3::X).normalize_or(DVec3::X);
    let u = if is_upright { level.unwrap_or(along) } else { along };
    [u, normal.cross(u)]
}

impl TrianglePlane {
    /// The occluders in this plane: large rectangles, and large triangles in no rectangle. `work`
    /// is the number of pieces that may still be tested.
    fn polygons(&self, work: &mut usize) -> Vec<Vec<DVec3>> {
        let flat = |point: DVec2| Vec3::new(point.x as f32, point.y as f32, 0.0);
        let boxes: Vec<Aabb> =
            self.triangles.iter().map(|t| Aabb::from_points(t.map(flat))).collect();
        let cover = PlaneCover { triangles: &self.triangles, bvh: Bvh::new(&boxes) };
        let all = boxes.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
        debug_assert!((self.u.dot(self.v)).abs() < 1e-9, "the directions are orthogonal");
        let limits = PlaneRect {
            min: DVec2::new(all.min.x.into(), all.min.y.into()) - 1.0,
            max: DVec2::new(all.max.x.into(), all.max.y.into()) + 1.0,
        };
        let mut polygons = Vec::new();
        let mut rects: [Vec<PlaneRect>; 2] = [Vec::new(), Vec::new()];
        for triangle in &self.triangles {
            let [a, b, c] = *triangle;
            let middle = (a + b + c) / 3.0;
            let seeds = [middle, a.lerp(middle, 0.1), b.lerp(middle, 0.1), c.lerp(middle, 0.1)];
            for seed in seeds {
                for (axis, known) in rects.iter_mut().enumerate() {
                    if known.iter().any(|rect| rect.holds(seed)) || *work == 0 {
                        continue;
                    }
                    let mut rect = PlaneRect { min: seed - SEED_M, max: seed + SEED_M };
                    for axis in [axis, 1 - axis] {
                        cover.grow(&mut rect, axis, true, &limits, work);
                        cover.grow(&mut rect, axis, false, &limits, work);
                    }
                    known.push(rect);
                }
            }
            let is_in = |rect: &PlaneRect| {
                triangle.iter().all(|&corner| rect.grown(CLOSED_M).holds(corner))
            };
            let doubled = (b - a).perp_dot(c - a);
            if doubled > 2.0 * AREA_MIN_M2 && !rects.iter().flatten().any(is_in) {
                polygons.push(self.placed(triangle));
            }
        }
        let rects: Vec<PlaneRect> = rects.into_iter().flatten().filter(|r| r.is_large()).collect();
        for (index, rect) in rects.iter().enumerate() {
            let inside = |(other, of): (usize, &PlaneRect)| {
                let holds = of.grown(CLOSED_M).contains(rect);
                other != index && holds && (other < index || !rect.grown(CLOSED_M).contains(of))
            };
            if !rects.iter().enumerate().any(inside) {
                polygons.push(self.placed(&rect.corners()));
            }
        }
        polygons
    }

    fn placed(&self, corners: &[DVec2]) -> Vec<DVec3> {
        let place = |corner: &DVec2| self.origin + self.u * corner.x + self.v * corner.y;
        corners.iter().map(place).collect()
    }
}

/// The part of a plane that triangles cover.
struct PlaneCover<'a> {
    triangles: &'a [PlaneTriangle],
    bvh: Bvh,
}

impl PlaneCover<'_> {
    /// Moves one side of a rectangle outwards, as far as the whole rectangle stays covered.
    fn grow(
        &self,
        rect: &mut PlaneRect,
        axis: usize,
        up: bool,
        limits: &PlaneRect,
        work: &mut usize,
    ) {
        let mut step = 2.0;
        loop {
            let mut strip = *rect;
            if up {
                strip.min[axis] = rect.max[axis];
                strip.max[axis] = (rect.max[axis] + step).min(limits.max[axis]);
            } else {
                strip.max[axis] = rect.min[axis];
                strip.min[axis] = (rect.min[axis] - step).max(limits.min[axis]);
            }
            let end = if up { strip.max[axis] } else { strip.min[axis] };
            let at = self.covered_to(&strip, axis, up, work).unwrap_or(end);
            if up {
                rect.max[axis] = at
            } else {
                rect.min[axis] = at
            }
            if at != end || strip.max[axis] - strip.min[axis] <= 0.0 {
                return;
            }
            step *= 2.0;
        }
    }

    /// The place along an axis at which the first gap in a strip begins. None if the whole strip is
    /// covered.
    fn covered_to(
        &self,
        strip: &PlaneRect,
        axis: usize,
        up: bool,
        work: &mut usize,
    ) -> Option<f64> {
        let flat = |point: DVec2| Vec3::new(point.x as f32, point.y as f32, 0.0);
        let region = Aabb::new(flat(strip.min), flat(strip.max));
        let mut left = vec![strip.corners().to_vec()];
        let _ = self.bvh.touching(&region, |index| {
            let triangle = &self.triangles[index as usize];
            left = left.drain(..).flat_map(|piece| outside(piece, triangle)).collect();
            *work = work.saturating_sub(left.len() + 1);
            if left.is_empty() || *work == 0 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        let corners = left.iter().flatten().map(|corner| corner[axis]);
        if up { corners.min_by(f64::total_cmp) } else { corners.max_by(f64::total_cmp) }
    }
}

/// The parts of a convex polygon outside a triangle, without slivers.
fn outside(mut piece: Vec<DVec2>, triangle: &PlaneTriangle) -> Vec<Vec<DVec2>> {
    let mut parts = Vec::new();
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let (from, to) = (triangle[from], triangle[to]);
        let Some(along) = (to - from).try_normalize() else { return vec![piece] };
        let height = |corner: DVec2| along.perp_dot(corner - from);
        let out = clip(&piece, |corner| -height(corner));
        if width(&out) > CLOSED_M {
            parts.push(out);
        }
        piece = clip(&piece, height);
        if width(&piece) <= CLOSED_M {
            break;
        }
    }
    parts
}

/// The part of a convex polygon where a linear function is not negative.
fn clip(piece: &[DVec2], height: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(piece.len() + 1);
    for (i, &from) in piece.iter().enumerate() {
        let to = piece[(i + 1) % piece.len()];
        let (a, b) = (height(from), height(to));
        if a >= 0.0 {
            kept.push(from);
        }
        if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
            kept.push(from.lerp(to, a / (a - b)));
        }
    }
    kept
}

/// The approximate width of a convex polygon across its longest edge: twice its area over the
/// length of that edge.
fn width(piece: &[DVec2]) -> f64 {
    if piece.len() < 3 {
        return 0.0;
    }
    let first = piece[0];
    let doubled: f64 = piece.windows(2).map(|p| (p[0] - first).perp_dot(p[1] - first)).sum();
    let longest = (0..piece.len())
        .map(|i| piece[i].distance(piece[(i + 1) % piece.len()]))
        .fold(f64::MIN_POSITIVE, f64::max);
    doubled.abs() / longest
}

impl PlaneRect {
    fn corners(&self) -> [DVec2; 4] {
        let (a, b) = (self.min, self.max);
        [a, DVec2::new(b.x, a.y), b, DVec2::new(a.x, b.y)]
    }

    fn holds(&self, point: DVec2) -> bool {
        self.min.cmple(point).all() && point.cmple(self.max).all()
    }

    fn contains(&self, other: &Self) -> bool {
        self.holds(other.min) && self.holds(other.max)
    }

    fn grown(&self, by: f64) -> Self {
        Self { min: self.min - by, max: self.max + by }
    }

    /// Whether the rectangle is large enough to hide somebody.
    fn is_large(&self) -> bool {
        let size = self.max - self.min;
        size.min_element() >= WIDTH_MIN_M && size.element_product() >= AREA_MIN_M2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall around a door, turned about the vertical. It has three panels of two triangles each.
    fn wall(turn: f64) -> Vec<[DVec3; 3]> {
        let panels = [[0.0, 0.0, 2.0, 3.0], [3.0, 0.0, 6.0, 3.0], [2.0, 2.0, 3.0, 3.0]];
        let place = |x: f64, y: f64| DVec3::new(x * turn.cos(), y, x * turn.sin());
        let panel = |[x0, y0, x1, y1]: [f64; 4]| {
            let [a, b, c, d] = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| place(x, y));
            [[a, b, c], [a, c, d]]
        };
        panels.into_iter().flat_map(panel).collect()
    }

    #[test]
    fn rectangles_beside_a_door_and_above_it_overlap() {
        for turn in [0.0, 0.4] {
            let planes = planes(&wall(turn));
            assert_eq!(planes.len(), 1);
            let mut sizes: Vec<[i64; 2]> = planes[0]
                .polygons(&mut { WORK_MAX })
                .iter()
                .map(|corners| {
                    let size = |a: usize, b: usize| corners[a].distance(corners[b]);
                    let mut size = [size(0, 1), size(1, 2)].map(|m| (m * 100.0).round() as i64);
                    size.sort_unstable();
                    size
                })
                .collect();
            sizes.sort_unstable();
            assert_eq!(sizes, [[100, 600], [200, 300], [300, 300]]);
        }
    }

    #[test]
    fn without_work_left_only_triangles_are_occluders() {
        let planes = planes(&wall(0.0));
        assert!(planes[0].polygons(&mut 0).iter().all(|corners| corners.len() == 3));
    }
}
