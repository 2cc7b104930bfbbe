//! Whether one line meets all of some axial boxes: the exact test.
//!
//! A line meets a box when its three projections along the axes meet the projected rectangles. Take
//! a line that rises along all three axes (other signs are reflections) with direction `d` and
//! moment `m = point × d`. Its projection along x meets the rectangle [y₀, y₁] × [z₀, z₁] when
//!
//! ```text
//! y₀·d.z − z₁·d.y ≤ m.x ≤ y₁·d.z − z₀·d.y
//! ```
//!
//! and so on around. Only moments with `d · m = 0` belong to lines. With `w = (1/d.x, 1/d.y, 1/d.z)`,
//! and each moment divided by the two other components of `d`, all of this is linear:
//!
//! ```text
//! y₀·w.y − z₁·w.z ≤ X ≤ y₁·w.y − z₀·w.z      (and around)      X + Y + Z = 0
//! ```
//!
//! So for given `w` the lower bounds of X, Y and Z must not exceed the upper ones, nor their sum 0,
//! and the upper bounds must not sum to less than 0. Each of these, with whichever boxes give the
//! bounds, is a half-plane in the triangle of all directions, `w ≥ 0`, `w.x + w.y + w.z = 1`. The test
//! tries a direction; when a condition fails there, its half-plane cuts the directions that remain,
//! and the middle of these is tried next. Each cut through the middle takes off a good part, so that
//! a few decide; what is undecided after [`TRIES_MAX`] counts as met.
//!
//! All level directions share one corner of the triangle, and so do those along each other pair of
//! axes. When only a corner remains, the test is made among those, where it is one about rectangles
//! and lines in a plane ([`is_stabbed_flat`]).
//!
//! This is the linear-time relative of Hohmeyer and Teller's test for stabbing isothetic boxes.

use glam::DVec3;

use super::DAabb;

/// After so many directions what is left is too thin to matter, and counts as met.
const TRIES_MAX: usize = 24;
/// More corners than cuts can make.
const CORNERS_MAX: usize = TRIES_MAX + 4;
/// Directions this near a corner of the triangle are told apart no further: there conditions fail by
/// little only, soon by no more than rounding, and the test among level lines is the sharper one.
/// Over 100 m such a line may rise by a millimetre.
const LITTLE: f64 = 1e-5;
/// What a condition may fail by, as moments over squared slopes: rounding.
const ROUNDING: f64 = 1e-9;

/// For each axis, whether a line goes towards greater coordinates; none when it may do either.
pub type DirectionSigns = [Option<bool>; 3];

/// Whether some line with the given signs meets all boxes. Boxes touch when they share a boundary.
/// `towards` is a likely direction. `room` is used for reflected boxes.
pub fn is_stabbed(
    boxes: &[DAabb],
    signs: DirectionSigns,
    towards: DVec3,
    room: &mut Vec<DAabb>,
) -> bool {
    let choices = |axis: usize| match signs[axis] {
        Some(rises) => [Some(rises), None],
        // The likely one first.
        None => [Some(towards[axis] >= 0.0), Some(towards[axis] < 0.0)],
    };
    choices(0).into_iter().flatten().any(|x| {
        choices(1).into_iter().flatten().any(|y| {
            choices(2).into_iter().flatten().any(|z| {
                let flip = [x, y, z].map(|rises| if rises { 1.0 } else { -1.0 });
                let flip = DVec3::from(flip);
                room.clear();
                room.extend(boxes.iter().map(|b| reflected(b, flip)));
                is_stabbed_rising(room, towards * flip)
            })
        })
    })
}

fn reflected(extent: &DAabb, flip: DVec3) -> DAabb {
    let (a, b) = (extent.min * flip, extent.max * flip);
    DAabb { min: a.min(b), max: a.max(b) }
}

/// Likewise, of lines that rise along all axes.
fn is_stabbed_rising(boxes: &[DAabb], towards: DVec3) -> bool {
    let shortest = towards.abs().max_element().max(1e-9) * 1e-3;
    let weights = towards.max(DVec3::splat(shortest)).recip();
    let mut at = weights / weights.element_sum();
    let mut left = DirectionPolygon::all();
    for _ in 0..TRIES_MAX {
        let Some(failed) = failure(boxes, at) else { return true };
        match left.cut(failed) {
            CutResult::Middle(middle) => at = middle,
            CutResult::Nothing => return false,
            CutResult::Corner { axis, rises } => return is_stabbed_flat(boxes, axis, rises),
            CutResult::TooMany => return true,
        }
    }
    true
}

/// Whether a line that hardly rises along one axis, but along the two others, meets all boxes: for
/// each metre along these, by no more than `rises`.
fn is_stabbed_flat(boxes: &[DAabb], axis: usize, rises: [f64; 2]) -> bool {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let (mut lowest, mut highest) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for extent in boxes {
        (lowest, highest) = (lowest.max(extent.min), highest.min(extent.max));
        (min, max) = (min.min(extent.min), max.max(extent.max));
    }
    let way = max - min;
    let rise = (rises[0] * way[u]).min(rises[1] * way[v]);
    if lowest[axis] > highest[axis] + rise + ROUNDING {
        return false;
    }
    // The directions that remain are those with weights t and 1 - t.
    let (mut from, mut to) = (0.0, 1.0);
    for _ in 0..TRIES_MAX {
        let t = (from + to) * 0.5;
        let mut low = (f64::NEG_INFINITY, 0.0, 0.0);
        let mut high = (f64::INFINITY, 0.0, 0.0);
        for DAabb { min, max } in boxes {
            let below = min[u] * t - max[v] * (1.0 - t);
            let above = max[u] * t - min[v] * (1.0 - t);
            if below > low.0 {
                low = (below, min[u], -max[v]);
            }
            if above < high.0 {
                high = (above, max[u], -min[v]);
            }
        }
        if low.0 <= high.0 + ROUNDING {
            return true;
        }
        // What fails is a · t + b · (1 - t) ≤ 0.
        let (a, b) = (low.1 - high.1, low.2 - high.2);
        if a == b {
            return false;
        }
        let zero = (ROUNDING - b) / (a - b);
        if a > b {
            to = to.min(zero);
        } else {
            from = from.max(zero);
        }
        if from > to {
            return false;
        }
    }
    true
}

/// The condition that fails most at a direction, as coefficients of `w`: it wants their product
/// with `w` not to be positive.
fn failure(boxes: &[DAabb], w: DVec3) -> Option<DVec3> {
    let (mut low, mut high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    for extent in boxes {
        let (from, to) = moments(extent, w);
        low = low.max(from);
        high = high.min(to);
    }
    let mut worst = (ROUNDING, None);
    for axis in 0..3 {
        let by = low[axis] - high[axis];
        if by > worst.0 {
            worst = (by, Some(Condition::Order(axis)));
        }
    }
    if low.element_sum() > worst.0 {
        worst = (low.element_sum(), Some(Condition::Low));
    }
    if -high.element_sum() > worst.0 {
        worst = (-high.element_sum(), Some(Condition::High));
    }
    // Which boxes gave the bounds matters only now: most directions do not fail.
    let from = |axis: usize| {
        let gives = |extent: &&DAabb| moments(extent, w).0[axis] >= low[axis];
        let DAabb { min, max } = boxes.iter().find(gives).unwrap_or(&boxes[0]);
        row(axis, min, max)
    };
    let to = |axis: usize| {
        let gives = |extent: &&DAabb| moments(extent, w).1[axis] <= high[axis];
        let DAabb { min, max } = boxes.iter().find(gives).unwrap_or(&boxes[0]);
        row(axis, max, min)
    };
    Some(match worst.1? {
        Condition::Order(axis) => from(axis) - to(axis),
        Condition::Low => from(0) + from(1) + from(2),
        Condition::High => -to(0) - to(1) - to(2),
    })
}

/// What can fail.
enum Condition {
    /// The lower bound of a moment exceeds the upper one.
    Order(usize),
    /// The lower bounds sum to more than 0.
    Low,
    /// The upper bounds sum to less than 0.
    High,
}

/// The bounds that a box puts on the moments.
#[inline]
fn moments(extent: &DAabb, w: DVec3) -> (DVec3, DVec3) {
    let (a, b) = (extent.min * w, extent.max * w);
    (DVec3::new(a.y - b.z, a.z - b.x, a.x - b.y), DVec3::new(b.y - a.z, b.z - a.x, b.x - a.y))
}

/// The coefficients of `w` in a bound of the moment about an axis.
fn row(axis: usize, plus: &DVec3, minus: &DVec3) -> DVec3 {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut row = DVec3::ZERO;
    row[u] = plus[u];
    row[v] = -minus[v];
    row
}

/// A convex polygon of directions that remain.
struct DirectionPolygon {
    corners: [DVec3; CORNERS_MAX],
    count: usize,
}

enum CutResult {
    Middle(DVec3),
    /// All are nearly level along an axis: for each metre along the two others they rise by so much.
    Corner {
        axis: usize,
        rises: [f64; 2],
    },
    /// More corners than there is room for: only by rounding.
    TooMany,
    Nothing,
}

impl DirectionPolygon {
    fn all() -> Self {
        let mut corners = [DVec3::ZERO; CORNERS_MAX];
        corners[..3].copy_from_slice(&DVec3::AXES);
        Self { corners, count: 3 }
    }

    /// Keeps the directions at which a condition does not fail.
    fn cut(&mut self, condition: DVec3) -> CutResult {
        let old = self.corners;
        let old = &old[..self.count];
        self.count = 0;
        let (mut min, mut max, mut sum) = (DVec3::INFINITY, DVec3::NEG_INFINITY, DVec3::ZERO);
        let mut keep = |corner: DVec3, into: &mut Self| {
            if into.count < CORNERS_MAX {
                into.corners[into.count] = corner;
            }
            into.count += 1;
            (min, max, sum) = (min.min(corner), max.max(corner), sum + corner);
        };
        let mut next = condition.dot(old[0]) - ROUNDING;
        for (i, &here) in old.iter().enumerate() {
            let there = old[if i + 1 == old.len() { 0 } else { i + 1 }];
            let height = next;
            next = condition.dot(there) - ROUNDING;
            if height <= 0.0 {
                keep(here, self);
            }
            if (height < 0.0 && next > 0.0) || (height > 0.0 && next < 0.0) {
                keep(here.lerp(there, height / (height - next)), self);
            }
        }
        if self.count == 0 {
            CutResult::Nothing
        } else if self.count > CORNERS_MAX {
            CutResult::TooMany
        } else {
            let is_little = (max - min).max_element() < LITTLE;
            match (0..3).find(|&axis| is_little && max[axis] > 1.0 - LITTLE) {
                Some(axis) => {
                    let rises = [1, 2].map(|on| max[(axis + on) % 3] / min[axis]);
                    CutResult::Corner { axis, rises }
                }
                None => CutResult::Middle(sum / self.count as f64),
            }
        }
    }
}
