//! Questions about what is visible between two boxes, and their answers.

use glam::Vec3;
use sightline_world::geometry::Aabb;

/// A straight line from an eye to a point, in the building's own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SightLine {
    /// The eye.
    pub from: Vec3,
    /// The point that the eye looks at.
    pub to: Vec3,
}

impl SightLine {
    /// Whether the line begins in a box of eyes and ends in a box of bodies.
    pub fn joins(&self, eyes: &Aabb, bodies: &Aabb) -> bool {
        eyes.contains(self.from) && bodies.contains(self.to)
    }
}

/// A box of eyes or bodies, and the spaces that they can be in.
#[derive(Clone, Copy, Debug)]
pub struct BoxInSpaces<'a> {
    /// The box, in the building's own axes.
    pub bounds: &'a Aabb,
    /// Indices into [`Cells::spaces`](sightline_world::Cells::spaces).
    pub spaces: &'a [u32],
}

/// What is known about the lines from one box to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoxVisibility {
    /// Every line is blocked.
    Hidden,
    /// This line meets no occluder. As long as it joins two boxes, they cannot be found hidden.
    Visible(SightLine),
    /// Some line may be free: the budget was used up, or occluders do not overlap at a seam.
    Unknown,
}
