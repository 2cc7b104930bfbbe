//! Convex polygons in space, cut by planes: in double precision, and always towards keeping more.

use glam::DVec3;

/// A point this close to a plane, in metres, counts as on it, and what is cut keeps it.
pub const ON_PLANE: f64 = 1e-6;

/// A polygon that would get more corners stays as it is: larger, never wrong. An exact cut adds one
/// corner at most, but slivers are not quite convex.
const CORNERS_MAX: usize = 16;

/// A plane: the points where `normal · point = distance`. The normal has unit length.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// Towards the front.
    pub normal: DVec3,
    /// From the origin, along the normal, in metres.
    pub distance: f64,
}

impl Plane {
    /// How far in front of the plane a point is, in metres.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }

    /// The same plane, seen from the other side.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, distance: -self.distance }
    }
}

/// A convex polygon. Kept without heap memory: the search makes millions.
#[derive(Clone, Copy, Debug)]
pub struct Winding {
    corners: [DVec3; CORNERS_MAX],
    count: usize,
}

impl Winding {
    /// A polygon with no corner.
    pub const EMPTY: Self = Self { corners: [DVec3::ZERO; CORNERS_MAX], count: 0 };

    /// A polygon with four corners, in order, in metres.
    pub fn quad(corners: [DVec3; 4]) -> Self {
        let mut quad = Self::EMPTY;
        quad.corners[..4].copy_from_slice(&corners);
        quad.count = 4;
        quad
    }

    /// Corners, in order, in metres.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Makes this the same as another.
    pub fn copy_from(&mut self, other: &Self) {
        self.corners[..other.count].copy_from_slice(other.corners());
        self.count = other.count;
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Cuts away what lies behind a plane. A polygon within [`ON_PLANE`] of it stays whole, so
    /// that a sight line that grazes is kept.
    pub fn keep_front(&mut self, plane: &Plane) {
        // The cut is made a little behind the plane, where the tolerance ends.
        let mut heights = [0.0; CORNERS_MAX];
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (height, &corner) in heights.iter_mut().zip(self.corners()) {
            *height = plane.height(corner) + ON_PLANE;
            low = low.min(*height);
            high = high.max(*height);
        }
        if low >= 0.0 {
            return;
        }
        if high < 0.0 {
            self.count = 0;
            return;
        }
        let whole = *self;
        if self.cut(&whole, &heights).is_none() {
            *self = whole;
        }
    }

    /// Makes this the part of `whole` at heights that are not negative; none when that needs too
    /// many corners.
    fn cut(&mut self, whole: &Self, heights: &[f64; CORNERS_MAX]) -> Option<()> {
        self.count = 0;
        for i in 0..whole.count {
            let j = if i + 1 == whole.count { 0 } else { i + 1 };
            let (here, there) = (heights[i], heights[j]);
            if here >= 0.0 {
                self.push(whole.corners[i])?;
            }
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                self.push(whole.corners[i].lerp(whole.corners[j], here / (here - there)))?;
            }
        }
        Some(())
    }

    fn push(&mut self, corner: DVec3) -> Option<()> {
        *self.corners.get_mut(self.count)? = corner;
        self.count += 1;
        Some(())
    }
}

/// The planes through an edge of `source` and a corner of `pass` that have all of the one behind
/// and all of the other in front. Every line that meets both, in this order, stays in front of
/// them beyond `pass`. Calls `found` for each until it answers `false`.
pub fn separators(source: &Winding, pass: &Winding, mut found: impl FnMut(&Plane) -> bool) {
    let edges = source.corners();
    for (i, &a) in edges.iter().enumerate() {
        let b = edges[if i + 1 == edges.len() { 0 } else { i + 1 }];
        for &corner in pass.corners() {
            let normal = (b - a).cross(corner - a);
            let length_squared = normal.length_squared();
            // Three corners almost in line define no plane; another pair will.
            if length_squared < 1e-18 {
                continue;
            }
            let normal = normal / length_squared.sqrt();
            let plane = Plane { normal, distance: normal.dot(a) };
            let Some(plane) = facing(plane, source, pass) else { continue };
            if !found(&plane) {
                return;
            }
        }
    }
}

/// The plane turned so that `source` is behind and `pass` in front; none when it does not part
/// them, or parts nothing because one of them lies in it.
fn facing(plane: Plane, source: &Winding, pass: &Winding) -> Option<Plane> {
    let (mut behind, mut front) = (false, false);
    for &corner in source.corners() {
        let height = plane.height(corner);
        behind |= height < -ON_PLANE;
        front |= height > ON_PLANE;
        if behind && front {
            return None;
        }
    }
    if behind == front {
        return None;
    }
    let plane = if behind { plane } else { plane.flipped() };
    let mut beyond = false;
    for &corner in pass.corners() {
        let height = plane.height(corner);
        if height < -ON_PLANE {
            return None;
        }
        beyond |= height > ON_PLANE;
    }
    beyond.then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Winding {
        Winding::quad([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y])
    }

    fn check(normal: DVec3, distance: f64, expected: &[(f64, f64)]) {
        let mut cut = square();
        cut.keep_front(&Plane { normal, distance });
        let near = |&(x, y): &(f64, f64)| {
            cut.corners().iter().any(|c| c.distance(DVec3::new(x, y, 0.0)) < 1e-5)
        };
        assert!(expected.iter().all(near), "{:?}", cut.corners());
        assert_eq!(cut.corners().len(), expected.len());
    }

    #[test]
    fn polygons_are_cut() {
        check(DVec3::X, 0.25, &[(0.25, 0.0), (1.0, 0.0), (1.0, 1.0), (0.25, 1.0)]);
        check(-DVec3::X, -0.25, &[(0.0, 0.0), (0.25, 0.0), (0.25, 1.0), (0.0, 1.0)]);
        check(DVec3::X, 2.0, &[]);
        check(DVec3::X, -1.0, &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
        // Grazing: a plane along an edge, or the polygon's own, cuts nothing.
        check(DVec3::Y, 0.0, &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
        check(DVec3::Z, 0.0, &[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
    }

    #[test]
    fn lines_through_both_stay_in_front_of_every_separator() {
        let source = square();
        let pass = Winding::quad([
            DVec3::new(1.5, 0.2, 2.0),
            DVec3::new(2.0, 0.2, 2.0),
            DVec3::new(2.0, 0.4, 2.0),
            DVec3::new(1.5, 0.4, 2.0),
        ]);
        let mut planes = Vec::new();
        separators(&source, &pass, |plane| {
            planes.push(*plane);
            true
        });
        assert!(planes.len() >= 4, "{planes:?}");
        for from in source.corners() {
            for through in pass.corners() {
                let beyond = *from + (*through - *from) * 5.0;
                assert!(planes.iter().all(|plane| plane.height(beyond) > -1e-4));
            }
        }
    }
}
