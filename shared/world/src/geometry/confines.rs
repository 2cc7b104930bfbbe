use glam::Vec3;

use super::Axes;
use crate::{geometry::Aabb, tolerance::INWARD_M};

/// A box along a building's own axes. Around a turned building, it has far less room than a box
/// along the world's, and beyond it there is no cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confines {
    /// Own axes.
    pub axes: Axes,
    /// In these.
    pub bounds: Aabb,
}

impl Confines {
    /// Whether a point of the world is inside.
    pub fn contains(&self, point: Vec3) -> bool {
        self.bounds.contains(self.axes.own(point))
    }

    /// Whether all of a box of the world is inside.
    pub fn contains_box(&self, region: &Aabb) -> bool {
        region.corners().into_iter().all(|corner| self.contains(corner))
    }

    /// The point itself when it is inside, else one inside that is near.
    pub fn clamp(&self, point: Vec3) -> Vec3 {
        if self.contains(point) {
            return point;
        }
        let inward = if self.axes.turn() == 0.0 { 0.0 } else { INWARD_M };
        let within = self.grown(-inward).bounds;
        self.axes.world(self.axes.own(point).max(within.min).min(within.max))
    }

    /// The same with its faces further out, in metres; where that is negative further in, but
    /// never by more than a quarter of its size.
    pub fn grown(&self, by: f32) -> Self {
        let by = by.max(self.bounds.size().max(Vec3::ZERO).min_element() * -0.25);
        Self { bounds: self.bounds.grown(by), ..*self }
    }

    /// Its middle, in the world.
    pub fn centre(&self) -> Vec3 {
        self.axes.world(self.bounds.centre())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_clamped_is_inside() {
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

    /// The corners of the box around it in the world are outside.
    #[test]
    fn a_turned_one_has_less_room() {
        let confines = Confines { axes: Axes::turned(0.5), bounds: Aabb::around(Vec3::ONE, 5.0) };
        let around = confines.axes.world_box(&confines.bounds);
        assert!(around.corners().into_iter().all(|corner| !confines.contains(corner)));
        assert!(!confines.contains_box(&around));
        assert!(confines.contains_box(&Aabb::around(confines.centre(), 3.0)));
    }
}
