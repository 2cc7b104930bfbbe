//! Boxes and the half-spaces that cut them.

use glam::DVec3;

use sightline_world::{
    geometry::Aabb,
    tolerance::{DEGENERATE_M, ON_PLANE_F64_M},
};

/// A box in double precision, in metres and own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DAabb {
    /// The corner with the least coordinates.
    pub min: DVec3,
    /// The corner with the greatest coordinates.
    pub max: DVec3,
}

impl DAabb {
    /// A box, grown on every side, in metres.
    pub fn around(region: &Aabb, margin: f64) -> Self {
        Self { min: region.min.as_dvec3() - margin, max: region.max.as_dvec3() + margin }
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(super) fn contains(&self, other: &Self) -> bool {
        self.min.cmple(other.min).all() && other.max.cmple(self.max).all()
    }

    pub(super) fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| [self.min[axis], self.max[axis]][i >> axis & 1];
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// How far apart the nearest points of two boxes are, squared.
    pub(super) fn distance_squared(&self, other: &Self) -> f64 {
        (other.min - self.max).max(self.min - other.max).max(DVec3::ZERO).length_squared()
    }

    /// Cuts off what is outside a half-space, and then whatever of the box is no longer needed to
    /// hold the rest. False when nothing is left.
    pub(super) fn keep(&mut self, half: &HalfSpace) -> bool {
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        let slack = half.limit + ON_PLANE_F64_M - nearest.element_sum();
        if slack < 0.0 {
            return false;
        }
        for axis in 0..3 {
            let n = half.normal[axis];
            if n > 1e-12 {
                self.max[axis] = self.max[axis].min(self.min[axis] + slack / n);
            } else if n < -1e-12 {
                self.min[axis] = self.min[axis].max(self.max[axis] + slack / n);
            }
        }
        true
    }

    pub(super) fn meets(&self, half: &HalfSpace) -> bool {
        let nearest = (half.normal * self.min).min(half.normal * self.max);
        nearest.element_sum() <= half.limit + ON_PLANE_F64_M
    }
}

/// The points where `normal · point ≤ limit`. The normal has unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Out of it.
    pub normal: DVec3,
    /// In metres.
    pub limit: f64,
}

/// A few half-spaces. Kept without heap memory: a search makes millions.
pub(super) struct HalfSpaces {
    pub(super) all: [HalfSpace; Self::MAX],
    pub(super) count: usize,
}

impl HalfSpaces {
    /// Six tangents, and the edges of a gate; those beyond are left out, which cuts less.
    pub(super) const MAX: usize = 24;

    pub(super) const fn none() -> Self {
        Self { all: [HalfSpace { normal: DVec3::ZERO, limit: 0.0 }; Self::MAX], count: 0 }
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

    pub(super) fn cut(&self, extent: &mut DAabb) -> bool {
        self.as_slice().iter().all(|half| extent.keep(half))
    }

    pub(super) fn meet(&self, extent: &DAabb) -> bool {
        self.as_slice().iter().all(|half| extent.meets(half))
    }
}

/// The half-spaces that every line from a box through another stays in, from the second on: those
/// with the first on the outside or the boundary, and the second inside or on the boundary.
pub(super) fn separators(source: &DAabb, pass: &DAabb, found: &mut HalfSpaces) {
    found.count = 0;
    for (u, v) in [(0, 1), (1, 2), (2, 0)] {
        // The axis along which the projections are furthest apart.
        let gap = |axis: usize| {
            (pass.min[axis] - source.max[axis]).max(source.min[axis] - pass.max[axis])
        };
        let (along, across) = if gap(u) >= gap(v) { (u, v) } else { (v, u) };
        if gap(along) > DEGENERATE_M {
            tangents(source, pass, along, across, found);
        }
    }
}

/// The two lines that touch both of two rectangles and pass between them; the rectangles are the
/// projections of two boxes that are apart on the axis `along`.
pub(super) fn tangents(
    source: &DAabb,
    pass: &DAabb,
    along: usize,
    across: usize,
    found: &mut HalfSpaces,
) {
    let is_ahead = pass.min[along] > source.max[along];
    // As if `pass` were always on the greater side.
    let sign = if is_ahead { 1.0 } else { -1.0 };
    let near_far = |extent: &DAabb| {
        if is_ahead {
            (extent.min[along], extent.max[along])
        } else {
            (-extent.max[along], -extent.min[along])
        }
    };
    let ((source_near, source_far), (pass_near, pass_far)) = (near_far(source), near_far(pass));
    // Above: from the lowest of the source to the highest of the pass, as steeply as can be; and
    // the same below, upside down.
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
        found.push(HalfSpace { normal, limit: (high - slope * at) * scale });
    }
}
