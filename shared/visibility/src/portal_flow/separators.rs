//! The half-spaces that separate two boxes.

use glam::DVec3;
use sightline_world::tolerance::DEGENERATE_M;

use super::daabb::DAabb;
use crate::HalfSpace;

/// A few half-spaces, without heap memory: a search makes millions of such lists.
pub(super) struct HalfSpaces {
    pub(super) all: [HalfSpace; Self::MAX],
    pub(super) count: usize,
}

impl HalfSpaces {
    /// Room for six tangents and the edges of a gate. Further half-spaces are left out, which only
    /// cuts less.
    pub(super) const MAX: usize = 24;

    pub(super) const fn none() -> Self {
        Self { all: [HalfSpace { normal: DVec3::ZERO, distance: 0.0 }; Self::MAX], count: 0 }
    }

    pub(super) fn push(&mut self, half: HalfSpace) {
        if let Some(place) = self.all.get_mut(self.count) {
            *place = half;
            self.count += 1;
        }
    }

    pub(super) fn as_slice(&self) -> &[HalfSpace] {
        &self.all[..self.count]
    }

    /// Shrinks a box to its part in all half-spaces. False if nothing is left.
    pub(super) fn cut(&self, region: &mut DAabb) -> bool {
        self.as_slice().iter().all(|half| region.keep(half))
    }

    /// Whether some of a box is in each half-space.
    pub(super) fn meet(&self, region: &DAabb) -> bool {
        self.as_slice().iter().all(|half| region.meets(half))
    }
}

/// Finds half-spaces that every line from a box through another stays in, from the second box on.
/// The first box is outside each of them or on its plane, and the second box is inside or on its
/// plane.
pub(super) fn separators(source: &DAabb, pass: &DAabb, found: &mut HalfSpaces) {
    found.count = 0;
    for (u, v) in [(0, 1), (1, 2), (2, 0)] {
        // Tangents exist along the axis on which the projections are furthest apart.
        let gap = |axis: usize| {
            (pass.min[axis] - source.max[axis]).max(source.min[axis] - pass.max[axis])
        };
        let (along, across) = if gap(u) >= gap(v) { (u, v) } else { (v, u) };
        if gap(along) > DEGENERATE_M {
            tangents(source, pass, along, across, found);
        }
    }
}

/// Adds the two lines that touch two rectangles and pass between them. The rectangles are the
/// projections of two boxes that are apart on the axis `along`.
pub(super) fn tangents(
    source: &DAabb,
    pass: &DAabb,
    along: usize,
    across: usize,
    found: &mut HalfSpaces,
) {
    debug_assert!(along != across && along < 3 && across < 3);
    let is_ahead = pass.min[along] > source.max[along];
    // From here on, `pass` counts as the one on the greater side.
    let sign = if is_ahead { 1.0 } else { -1.0 };
    let near_far = |region: &DAabb| {
        if is_ahead {
            (region.min[along], region.max[along])
        } else {
            (-region.max[along], -region.min[along])
        }
    };
    let ((source_near, source_far), (pass_near, pass_far)) = (near_far(source), near_far(pass));
    // The upper tangent goes from the lowest point of the source to the highest of the pass, as
    // steeply as possible. The lower tangent is the same upside down.
    for up in [1.0, -1.0] {
        let (low, high) = if up > 0.0 {
            (source.min[across], pass.max[across])
        } else {
            (-source.max[across], -pass.min[across])
        };
        let rise = high - low;
        let (run, at) = if rise >= 0.0 {
            (pass_near - source_far, pass_near)
        } else {
            (pass_far - source_near, pass_far)
        };
        let slope = rise / run;
        let scale = 1.0 / (1.0 + slope * slope).sqrt();
        let mut normal = DVec3::ZERO;
        normal[along] = -slope * sign * scale;
        normal[across] = up * scale;
        found.push(HalfSpace { normal, distance: (high - slope * at) * scale });
    }
}
