//! Whether a triangle touches a cube: by its box, its plane, and its projection along each axis
//! (Schwarz and Seidel 2010, section 3).

use arrayvec::ArrayVec;
use glam::Vec3;

/// A bound on accumulated rounding, in voxels: rather a voxel too many than a hole.
const SLACK: f32 = 1.0e-3;

/// A triangle cut by the six sides of a cube. Each side adds at most one corner, and rounding
/// perhaps another.
type Clipped = ArrayVec<Vec3, 16>;

/// A triangle prepared for many tests. Lengths are in voxels.
pub(super) struct Overlap {
    corners: [Vec3; 3],
    min: Vec3,
    max: Vec3,
    normal: Vec3,
    offset: f32,
    /// For each axis, the three edge lines of the projection along it.
    outlines: [[Line; 3]; 3],
}

/// A line in a plane. The inside is where `across · point + offset` is positive.
#[derive(Clone, Copy)]
struct Line {
    across: [f32; 2],
    offset: f32,
    reach: f32,
}

impl Overlap {
    /// `None` for a triangle without area, or with corners that are not finite.
    pub(super) fn new(corners: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).try_normalize()?;
        let outline = |axis: usize| {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            // Seen from the side, a triangle is a line, and its plane alone decides.
            if normal[axis] == 0.0 {
                return [Line::NONE; 3];
            }
            let turn = if normal[axis] < 0.0 { -1.0 } else { 1.0 };
            [(a, b), (b, c), (c, a)].map(|(from, to)| {
                let along = to - from;
                Line::new([-along[j] * turn, along[i] * turn], [from[i], from[j]])
            })
        };
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let outlines = [outline(0), outline(1), outline(2)];
        Some(Self { corners, min, max, normal, offset: normal.dot(a), outlines })
    }

    /// Whether the triangle and a cube share a point.
    pub(super) fn touches(&self, centre: Vec3, half: f32) -> bool {
        let reach = half + SLACK;
        let apart = (self.max - centre).cmplt(Vec3::splat(-reach))
            | (self.min - centre).cmpgt(Vec3::splat(reach));
        !apart.any()
            && self.plane_touches(centre, half)
            && self.outlines.iter().enumerate().all(|(axis, outline)| {
                let point = [centre[(axis + 1) % 3], centre[(axis + 2) % 3]];
                outline.iter().all(|line| line.at(point) + line.reach * half >= -SLACK)
            })
    }

    /// Whether the triangle's plane and a cube share a point, or nearly so.
    pub(super) fn plane_touches(&self, centre: Vec3, half: f32) -> bool {
        let off_plane = (self.normal.dot(centre) - self.offset).abs();
        off_plane <= self.normal.abs().element_sum() * half + SLACK
    }

    /// Whether a cube lies wholly between the triangle's edges, along each axis. Then the plane
    /// alone decides which parts of the cube the triangle touches.
    pub(super) fn is_between(&self, centre: Vec3, half: f32) -> bool {
        self.outlines.iter().enumerate().all(|(axis, outline)| {
            let point = [centre[(axis + 1) % 3], centre[(axis + 2) % 3]];
            outline.iter().all(|line| line.at(point) >= line.reach * half)
        })
    }

    /// The unit normal, on the side given by the order of the corners.
    pub(super) fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Barycentric weights of the point of the triangle that is nearly the nearest to a point.
    pub(super) fn weights(&self, point: Vec3) -> [f32; 3] {
        let [a, b, c] = self.corners;
        let share =
            |from: Vec3, to: Vec3| (to - from).cross(point - from).dot(self.normal).max(0.0);
        let shares = [share(b, c), share(c, a), share(a, b)];
        let sum = shares.iter().sum::<f32>();
        if sum > 0.0 { shares.map(|share| share / sum) } else { [1.0 / 3.0; 3] }
    }

    /// The area of the part inside the unit cube around a point, plus a little.
    pub(super) fn area_in(&self, centre: Vec3) -> f32 {
        let mut polygon = ArrayVec::from_iter(self.corners.map(|corner| corner - centre));
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                polygon = clipped(&polygon, axis, side);
            }
        }
        let fan = polygon.windows(2).skip(1).map(|edge| {
            let first = polygon[0];
            (edge[0] - first).cross(edge[1] - first)
        });
        fan.sum::<Vec3>().length() * 0.5 + SLACK
    }
}

impl Line {
    /// A line that everything is inside of.
    const NONE: Self = Self { across: [0.0; 2], offset: 0.0, reach: 0.0 };

    fn new(across: [f32; 2], through: [f32; 2]) -> Self {
        let length = across[0].hypot(across[1]);
        let across = if length > 0.0 { across.map(|part| part / length) } else { [0.0; 2] };
        let offset = -(across[0] * through[0] + across[1] * through[1]);
        Self { across, offset, reach: across[0].abs() + across[1].abs() }
    }

    fn at(&self, point: [f32; 2]) -> f32 {
        self.across[0] * point[0] + self.across[1] * point[1] + self.offset
    }
}

/// The part of a polygon where `side` times the coordinate is at most a half.
fn clipped(polygon: &Clipped, axis: usize, side: f32) -> Clipped {
    let mut kept = Clipped::new();
    for (i, &to) in polygon.iter().enumerate() {
        let from = polygon[(i + polygon.len() - 1) % polygon.len()];
        let (inside_from, inside_to) = (0.5 - side * from[axis], 0.5 - side * to[axis]);
        if (inside_from < 0.0) != (inside_to < 0.0) {
            let _ = kept.try_push(from.lerp(to, inside_from / (inside_from - inside_to)));
        }
        if inside_to >= 0.0 {
            let _ = kept.try_push(to);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_that_of_the_part_inside() {
        let check = |corners: [[f32; 3]; 3], expected: f32| {
            let overlap = Overlap::new(corners.map(Vec3::from)).expect("has an area");
            let area = overlap.area_in(Vec3::splat(0.5)) - SLACK;
            assert!((area - expected).abs() < 1.0e-5, "{area} instead of {expected}");
        };
        check([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]], 0.5);
        check([[-9.0, -9.0, 0.5], [99.0, -9.0, 0.5], [-9.0, 99.0, 0.5]], 1.0);
        check([[-9.0, -9.0, 1.5], [99.0, -9.0, 1.5], [-9.0, 99.0, 1.5]], 0.0);
        check([[0.5, 0.0, 0.0], [2.5, 0.0, 0.0], [0.5, 0.0, 2.0]], 0.5);
    }

    #[test]
    fn weights_are_those_of_the_corners() {
        let overlap =
            Overlap::new([Vec3::ZERO, Vec3::X * 2.0, Vec3::Z * 2.0]).expect("has an area");
        let [a, b, c] = overlap.weights(Vec3::new(0.5, 7.0, 1.0));
        assert!((a - 0.25).abs() < 1.0e-6 && (b - 0.25).abs() < 1.0e-6 && (c - 0.5).abs() < 1.0e-6);
        assert_eq!(overlap.weights(Vec3::new(-5.0, 0.0, -3.0)), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn degenerate_triangles_are_refused() {
        assert!(Overlap::new([Vec3::ZERO, Vec3::X, Vec3::X * 2.0]).is_none());
        assert!(Overlap::new([Vec3::ZERO, Vec3::X, Vec3::NAN]).is_none());
        assert!(Overlap::new([Vec3::ZERO, Vec3::X, Vec3::INFINITY]).is_none());
    }
}
