//! Triangles and rectangles in the coordinates of a plane.

use glam::DVec2;

/// A triangle in the coordinates of its plane.
pub(crate) type PlaneTriangle = [DVec2; 3];

/// A rectangle in the coordinates of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlaneRect {
    /// The lesser corner.
    pub min: DVec2,
    /// The greater corner.
    pub max: DVec2,
}

impl PlaneRect {
    /// The smallest rectangle around a triangle.
    pub(crate) fn around(triangle: &PlaneTriangle) -> Self {
        let [a, b, c] = *triangle;
        Self { min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    /// The common part of two rectangles; of negative size when they are apart.
    pub(crate) fn intersection(&self, other: &Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// Whether the rectangle has no area.
    pub(crate) fn is_flat(&self) -> bool {
        !self.min.cmplt(self.max).all()
    }

    /// The area, in square metres; zero when flat.
    pub(crate) fn area(&self) -> f64 {
        if self.is_flat() { 0.0 } else { (self.max - self.min).element_product() }
    }

    /// The corners, anticlockwise.
    pub(crate) fn corners(&self) -> [DVec2; 4] {
        let (a, b) = (self.min, self.max);
        [a, DVec2::new(b.x, a.y), b, DVec2::new(a.x, b.y)]
    }
}

/// The triangle with its corners anticlockwise. None when it has no area.
pub(super) fn anticlockwise([a, b, c]: PlaneTriangle) -> Option<PlaneTriangle> {
    let doubled = (b - a).perp_dot(c - a);
    if doubled > 0.0 {
        Some([a, b, c])
    } else if doubled < 0.0 {
        Some([a, c, b])
    } else {
        None
    }
}
