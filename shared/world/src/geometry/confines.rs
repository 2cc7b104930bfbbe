//! The region that eyes are confined to.

use glam::Vec3;

use super::Axes;
use crate::{geometry::Aabb, tolerance::INWARD_M};

/// The box along a building's own axes in which all cells lie. Around a turned building it is much
/// smaller than a box along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confines {
    /// The building's own axes.
    pub axes: Axes,
    /// The box along these axes, in metres.
    pub bounds: Aabb,
}

impl Confines {
    /// Whether a point, given in the world's axes, is inside.
    pub fn contains(&self, point: Vec3) -> bool {
        self.bounds.contains(self.axes.own(point))
    }

    /// Whether a box along the world's axes is wholly inside.
    pub fn contains_box(&self, region: &Aabb) -> bool {
        region.corners().into_iter().all(|corner| self.contains(corner))
    }

    /// The point itself when it is inside; otherwise the nearest point inside, up to rounding.
    pub fn clamp(&self, point: Vec3) -> Vec3 {
        if self.contains(point) {
            return point;
        }
        debug_assert!(!self.bounds.is_empty(), "no point is inside of empty confines");
        let inward = if self.axes.turn() == 0.0 { 0.0 } else { INWARD_M };
        let within = self.grown(-inward).bounds;
        self.axes.world(self.axes.own(point).max(within.min).min(within.max))
    }

    /// The confines with every face moved outwards by `by` metres. A negative number moves them
    /// inwards, but by at most a quarter of the size.
    pub fn grown(&self, by: f32) -> Self {
        let by = by.max(self.bounds.size().max(Vec3::ZERO).min_element() * -0.25);
        Self { bounds: self.bounds.grown(by), ..*self }
    }

    /// The centre, in the world's axes.
    pub fn centre(&self) -> Vec3 {
        self.axes.world(self.bounds.centre())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamped_points_are_inside() {
        let bounds = Aabb::new(Vec3::new(-900.0, 1.0, 70.0), Vec3::new(-100.0, 9.0, 2_000.0));
        for turn in [0.0, 0.1, 0.5, 1.5] {
            let confines = Confines { axes: Axes::turned(turn), bounds };
            for corner in bounds.grown(3.0).corners() {
                let outside = confines.axes.world(corner);
                assert!(!confines.contains(outside));
                let inside = confines.clamp(outside);
                assert!(confines.contains(inside));
                assert_eq!(confines.clamp(inside), inside);
                assert!(inside.distance(outside) < 3.0 * 1.733);
            }
            assert!(confines.contains(confines.centre()));
        }
    }

    /// The corners of the world's box around the confines are outside.
    #[test]
    fn turned_confines_are_smaller_than_the_box_around_them() {
        let confines = Confines { axes: Axes::turned(0.5), bounds: Aabb::around(Vec3::ONE, 5.0) };
        let around = confines.axes.world_box(&confines.bounds);
        assert!(around.corners().into_iter().all(|corner| !confines.contains(corner)));
        assert!(!confines.contains_box(&around));
        assert!(confines.contains_box(&Aabb::around(confines.centre(), 3.0)));
    }
}
