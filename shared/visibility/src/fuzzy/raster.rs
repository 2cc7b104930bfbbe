//! The elements that a convex polygon meets, row by row.

use glam::DVec2;

/// The most that rounding may move a point by, in elements.
pub(super) const ROUNDING: f64 = 1e-6;

/// Visits every row of elements that a closed convex polygon meets or comes near to. `visit` gets
/// the row, and the first and the last element of it that the polygon meets.
pub(super) fn rows(
    polygon: &[DVec2],
    size: usize,
    nearness: f64,
    mut visit: impl FnMut(usize, usize, usize),
) {
    let Some(&start) = polygon.last() else { return };
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for point in polygon {
        (low, high) = (low.min(point.y), high.max(point.y));
    }
    let Some([first, last]) = elements(low, high, size, nearness) else { return };
    for row in first..=last {
        let (top, bottom) = (row as f64 - nearness, (row + 1) as f64 + nearness);
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut from = start;
        for &to in polygon {
            if let Some([one, other]) = within(from, to, top, bottom) {
                (left, right) = (left.min(one.min(other)), right.max(one.max(other)));
            }
            from = to;
        }
        if let Some([first, last]) = elements(left, right, size, nearness) {
            visit(row, first, last);
        }
    }
}

/// The places along x at which a line enters and leaves a band of y. None if it misses the band.
fn within(from: DVec2, to: DVec2, top: f64, bottom: f64) -> Option<[f64; 2]> {
    let (low, high) = (from.y.min(to.y), from.y.max(to.y));
    if high < top || low > bottom {
        return None;
    }
    let rise = to.y - from.y;
    if rise == 0.0 {
        return Some([from.x, to.x]);
    }
    let at = |y: f64| from.x + (to.x - from.x) * ((y - from.y) / rise).clamp(0.0, 1.0);
    Some([at(top), at(bottom)])
}

/// The first and the last element that an interval meets or comes near to.
pub(super) fn elements(low: f64, high: f64, size: usize, nearness: f64) -> Option<[usize; 2]> {
    let (low, high) = (low - nearness, high + nearness);
    // This is false for NaN, too. A cast truncates, which is the floor of a number that is not
    // negative.
    let meets = low < size as f64 && high >= 0.0;
    meets.then(|| [low.max(0.0) as usize, (high as usize).min(size - 1)])
}
