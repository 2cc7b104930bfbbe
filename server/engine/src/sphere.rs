//! The ball that bounds where an eye can be by its top speed alone.

use glam::Vec3;
use sightline_world::{geometry::Aabb, motion::Body};

/// A ball about the last eye position, in the building's own axes: what
/// [`TbvShape::Sphere`](crate::TbvShape::Sphere) means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sphere {
    pub(crate) centre: Vec3,
    /// In metres.
    pub(crate) radius_m: f32,
}

impl Sphere {
    /// The smallest box around the ball.
    pub(crate) fn bounds(&self) -> Aabb {
        Aabb::around(self.centre, self.radius_m)
    }

    /// Whether a point is in the ball, or no further than a margin outside it.
    pub(crate) fn contains(&self, point: Vec3, margin_m: f32) -> bool {
        self.centre.distance(point) <= self.radius_m + margin_m
    }

    /// Whether the ball and a box have a point in common.
    pub(crate) fn touches(&self, region: &Aabb) -> bool {
        self.contains(self.centre.clamp(region.min, region.max), 0.0)
    }

    /// Whether a body whose eye is in the ball can have a part in a box.
    pub(crate) fn body_touches(&self, body: &Body, region: &Aabb) -> bool {
        let Aabb { min, max } = body.around(Vec3::ZERO);
        self.touches(&Aabb::new(region.min - max, region.max - min))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_the_box_around_a_sphere_are_outside_it() {
        let sphere = Sphere { centre: Vec3::ONE, radius_m: 2.0 };
        let corner = sphere.bounds().max;
        assert!(!sphere.contains(corner, 0.0) && sphere.contains(corner, 1.5));
        let beside = Aabb::new(corner - 0.1, corner + 1.0);
        assert!(!sphere.touches(&beside) && sphere.bounds().intersects(&beside));
        assert!(sphere.touches(&Aabb::new(Vec3::new(2.9, 0.0, 0.0), Vec3::splat(9.0))));
        // The soles are 1.6 m below the eye, and the top 0.1 m above it.
        let (body, far) = (Body::PERSON, 100.0);
        let slab = |y: [f32; 2]| Aabb::new(Vec3::new(-far, y[0], -far), Vec3::new(far, y[1], far));
        assert!(sphere.body_touches(&body, &slab([-9.0, -2.5])));
        assert!(!sphere.body_touches(&body, &slab([-9.0, -2.7])));
        assert!(sphere.body_touches(&body, &slab([3.05, 9.0])));
        assert!(!sphere.body_touches(&body, &slab([3.2, 9.0])));
    }
}
