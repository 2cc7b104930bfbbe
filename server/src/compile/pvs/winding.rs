//! Convex polygons in space, cut by planes: in double precision, and always towards keeping more.

use glam::DVec3;

/// A point this close to a plane, in metres, counts as on it, and what is cut keeps it.
pub const ON_PLANE: f64 = 1e-6;

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

/// Corners of a convex polygon, in order.
#[derive(Clone, Debug, Default)]
pub struct Winding {
    /// In metres.
    pub corners: Vec<DVec3>,
}

impl Winding {
    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// Cuts away what lies behind a plane. A polygon within [`ON_PLANE`] of it stays whole, so
    /// that a sight line that grazes is kept.
    pub fn keep_front(&mut self, plane: &Plane, heights: &mut Vec<f64>) {
        heights.clear();
        heights.extend(self.corners.iter().map(|&c| plane.height(c)));
        if heights.iter().all(|&h| h >= -ON_PLANE) {
            return;
        }
        if heights.iter().all(|&h| h < -ON_PLANE) {
            self.corners.clear();
            return;
        }
        let corners = std::mem::take(&mut self.corners);
        for (i, &corner) in corners.iter().enumerate() {
            let j = (i + 1) % corners.len();
            let (here, there) = (heights[i], heights[j]);
            if here >= -ON_PLANE {
                self.corners.push(corner);
            }
            // Cut a little behind the plane, where the tolerance ends.
            let (here, there) = (here + ON_PLANE, there + ON_PLANE);
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                self.corners.push(corner.lerp(corners[j], here / (here - there)));
            }
        }
    }
}

/// The planes through an edge of `source` and a corner of `pass` that have all of the one behind
/// and all of the other in front. Every line that meets both, in this order, stays in front of
/// them beyond `pass`. Calls `found` for each until it answers `false`.
pub fn separators(source: &Winding, pass: &Winding, mut found: impl FnMut(&Plane) -> bool) {
    for i in 0..source.corners.len() {
        let (a, b) = (source.corners[i], source.corners[(i + 1) % source.corners.len()]);
        for &corner in &pass.corners {
            let normal = (b - a).cross(corner - a);
            let length = normal.length();
            // Three corners almost in line define no plane; another pair will.
            if length < 1e-9 {
                continue;
            }
            let normal = normal / length;
            let plane = Plane { normal, distance: normal.dot(a) };
            let Some(plane) = facing(plane, source, pass) else { continue };
            if !found(&plane) {
                return;
            }
        }
    }
}

/// The plane turned so that `source` is behind and `pass` in front; none when it parts them not,
/// or parts nothing because one of them lies in it.
fn facing(plane: Plane, source: &Winding, pass: &Winding) -> Option<Plane> {
    let (low, high) = range(&plane, source);
    let plane = match (low < -ON_PLANE, high > ON_PLANE) {
        (true, false) => plane,
        (false, true) => plane.flipped(),
        _ => return None,
    };
    let (low, high) = range(&plane, pass);
    (low >= -ON_PLANE && high > ON_PLANE).then_some(plane)
}

fn range(plane: &Plane, winding: &Winding) -> (f64, f64) {
    winding
        .corners
        .iter()
        .map(|&c| plane.height(c))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
}
