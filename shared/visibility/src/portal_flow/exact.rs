//! The exact test: whether some line meets all of several axial boxes.
//!
//! A line meets a box if its three projections along the axes meet the projected rectangles. Take a
//! line that rises along all three axes; other signs are reflections. Its direction is `d`, and its
//! moment is `m = point × d`. Its projection along x meets the rectangle [y₀, y₁] × [z₀, z₁] if
//!
//! ```text
//! y₀·d.z − z₁·d.y ≤ m.x ≤ y₁·d.z − z₀·d.y
//! ```
//!
//! and the same holds for the other axes in turn. Only moments with `d · m = 0` belong to lines.
//! Let `w = (1/d.x, 1/d.y, 1/d.z)`, and divide each moment by the two other components of `d`. Then
//! all conditions are linear:
//!
//! ```text
//! y₀·w.y − z₁·w.z ≤ X ≤ y₁·w.y − z₀·w.z      (and in turn)      X + Y + Z = 0
//! ```
//!
//! So for a given `w` there are three kinds of conditions. No lower bound of X, Y or Z exceeds the
//! upper bound. The lower bounds do not sum to more than 0. The upper bounds do not sum to less
//! than
//! 0. Each condition, with the boxes that give its bounds, is a half-plane in the triangle of all
//! directions: `w ≥ 0`, `w.x + w.y + w.z = 1`.
//!
//! The test tries one direction. If a condition fails there, its half-plane cuts the polygon of
//! remaining directions, and the middle of the rest is tried next. Each cut through the middle
//! takes off a good part, so a few tries decide. What is undecided after [`TRIES_MAX`] counts as
//! met.
//!
//! All level directions share one corner of the triangle, and so do the directions along each other
//! pair of axes. When only a corner remains, those directions are tested in a plane, with
//! rectangles for boxes ([`level_line_meets_all`]).
//!
//! This takes time linear in the number of boxes. The original test is by Hohmeyer and Teller 1992,
//! "Stabbing isothetic boxes and rectangles in O(n lg n) time".

use glam::DVec3;

use super::daabb::DAabb;

/// The most directions that are tried. What is left then is too thin to matter and counts as met.
const TRIES_MAX: usize = 24;
/// The most corners of the polygon of directions: three, and one for each cut.
const CORNERS_MAX: usize = TRIES_MAX + 4;
/// Directions closer than this to a corner of the triangle count as level. Near the corner,
/// conditions fail by no more than rounding, and the test among level lines is sharper. Over 100 m
/// such a line may rise by a millimetre.
const LEVEL_WEIGHT: f64 = 1e-5;
/// The rounding of a condition, as a moment over squared slopes. One that fails by less holds.
const ROUNDING: f64 = 1e-9;

/// For each axis, whether a line moves towards greater coordinates. None if it may move either way.
pub type DirectionSigns = [Option<bool>; 3];

/// Whether some line with the given signs meets all boxes. A line meets a box if it touches its
/// boundary. `towards` is a likely direction. `spare` is scratch memory.
pub fn line_meets_all(
    boxes: &[DAabb],
    signs: DirectionSigns,
    towards: DVec3,
    spare: &mut Vec<DAabb>,
) -> bool {
    debug_assert!(!boxes.is_empty(), "there is something to meet");
    let choices = |axis: usize| match signs[axis] {
        Some(rises) => [Some(rises), None],
        // The likely direction comes first.
        None => [Some(towards[axis] >= 0.0), Some(towards[axis] < 0.0)],
    };
    choices(0).into_iter().flatten().any(|x| {
        choices(1).into_iter().flatten().any(|y| {
            choices(2).into_iter().flatten().any(|z| {
                let flip = [x, y, z].map(|rises| if rises { 1.0 } else { -1.0 });
                let flip = DVec3::from(flip);
                spare.clear();
                spare.extend(boxes.iter().map(|b| reflected(b, flip)));
                rising_line_meets_all(spare, towards * flip)
            })
        })
    })
}

fn reflected(region: &DAabb, flip: DVec3) -> DAabb {
    let (a, b) = (region.min * flip, region.max * flip);
    DAabb { min: a.min(b), max: a.max(b) }
}

/// Whether some line that rises along all axes meets all boxes.
fn rising_line_meets_all(boxes: &[DAabb], towards: DVec3) -> bool {
    let shortest = towards.abs().max_element().max(1e-9) * 1e-3;
    let weights = towards.max(DVec3::splat(shortest)).recip();
    let mut at = weights / weights.element_sum();
    let mut left = DirectionPolygon::all();
    for _ in 0..TRIES_MAX {
        let Some(failed) = failure(boxes, at) else { return true };
        match left.cut(failed) {
            CutResult::Middle(middle) => at = middle,
            CutResult::Nothing => return false,
            CutResult::Corner { axis, rises } => return level_line_meets_all(boxes, axis, rises),
            CutResult::TooMany => return true,
        }
    }
    true
}

/// Whether a line that hardly rises along one axis meets all boxes. For each metre along the two
/// other axes it rises by no more than the two `rises`.
fn level_line_meets_all(boxes: &[DAabb], axis: usize, rises: [f64; 2]) -> bool {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let (mut lowest, mut highest) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for region in boxes {
        (lowest, highest) = (lowest.max(region.min), highest.min(region.max));
        (min, max) = (min.min(region.min), max.max(region.max));
    }
    let way = max - min;
    let rise = (rises[0] * way[u]).min(rises[1] * way[v]);
    if lowest[axis] > highest[axis] + rise + ROUNDING {
        return false;
    }
    // The remaining directions have weights t and 1 - t.
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
        // The condition that fails is a · t + b · (1 - t) ≤ 0.
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

/// The condition that fails most at a direction, if one fails. It is given by the coefficients of
/// `w`: it holds where their product with `w` is not positive.
fn failure(boxes: &[DAabb], w: DVec3) -> Option<DVec3> {
    let (mut low, mut high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    for region in boxes {
        let (from, to) = moments(region, w);
        low = low.max(from);
        high = high.min(to);
    }
    debug_assert!(w.min_element() >= 0.0, "lines rise along all axes");
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
    // Only now it matters which boxes gave the bounds: most directions do not fail.
    let from = |axis: usize| {
        let gives = |region: &&DAabb| moments(region, w).0[axis] >= low[axis];
        let DAabb { min, max } = boxes.iter().find(gives).unwrap_or(&boxes[0]);
        row(axis, min, max)
    };
    let to = |axis: usize| {
        let gives = |region: &&DAabb| moments(region, w).1[axis] <= high[axis];
        let DAabb { min, max } = boxes.iter().find(gives).unwrap_or(&boxes[0]);
        row(axis, max, min)
    };
    Some(match worst.1? {
        Condition::Order(axis) => from(axis) - to(axis),
        Condition::Low => from(0) + from(1) + from(2),
        Condition::High => -to(0) - to(1) - to(2),
    })
}

/// A condition that can fail.
enum Condition {
    /// The lower bound of a moment exceeds the upper one.
    Order(usize),
    /// The lower bounds sum to more than 0.
    Low,
    /// The upper bounds sum to less than 0.
    High,
}

/// The lower and upper bounds that a box puts on the moments of lines that meet it.
#[inline]
fn moments(region: &DAabb, w: DVec3) -> (DVec3, DVec3) {
    let (a, b) = (region.min * w, region.max * w);
    (DVec3::new(a.y - b.z, a.z - b.x, a.x - b.y), DVec3::new(b.y - a.z, b.z - a.x, b.x - a.y))
}

/// The coefficients of `w` in a bound of the moment about an axis, from two corners of a box.
fn row(axis: usize, plus: &DVec3, minus: &DVec3) -> DVec3 {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut row = DVec3::ZERO;
    row[u] = plus[u];
    row[v] = -minus[v];
    row
}

/// The convex polygon of remaining directions.
struct DirectionPolygon {
    corners: [DVec3; CORNERS_MAX],
    count: usize,
}

/// What a cut leaves of the polygon of directions.
enum CutResult {
    /// Its middle, to be tried next.
    Middle(DVec3),
    /// All directions are nearly level: they rise along `axis` by at most `rises` for each metre
    /// along the two other axes.
    Corner { axis: usize, rises: [f64; 2] },
    /// The polygon has more corners than there is room for, which only rounding can cause.
    TooMany,
    /// No direction.
    Nothing,
}

impl DirectionPolygon {
    fn all() -> Self {
        let mut corners = [DVec3::ZERO; CORNERS_MAX];
        corners[..3].copy_from_slice(&DVec3::AXES);
        Self { corners, count: 3 }
    }

    /// Keeps the directions at which a condition holds.
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
            let is_level = (max - min).max_element() < LEVEL_WEIGHT;
            match (0..3).find(|&axis| is_level && max[axis] > 1.0 - LEVEL_WEIGHT) {
                Some(axis) => {
                    let rises = [1, 2].map(|on| max[(axis + on) % 3] / min[axis]);
                    CutResult::Corner { axis, rises }
                }
                None => CutResult::Middle(sum / self.count as f64),
            }
        }
    }
}
