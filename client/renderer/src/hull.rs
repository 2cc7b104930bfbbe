//! The exact outline of a box in perspective: the pixels whose lines of sight meet it.
//!
//! As in [`lines`](super::lines), a line of sight meets a box when it does so as seen along each
//! axis. Seen along an axis the box is a rectangle, and the lines of sight that meet it lie between
//! those to two of its corners. Where the eye is inside of the rectangle all lines of sight meet
//! it. So there are at most six bounds, and each is linear in the pixel. Nothing is clipped, and
//! part of the box may lie behind the eye.

use glam::Vec3A;

use super::{mask::Area, mask::BLOCK, view::BandView};

/// A bound that changes less from column to column holds for a whole row or for none of it.
const LEVEL: f32 = 1.0e-15;

/// The outline of a box: the pixels between some bounds.
pub(super) struct Hull {
    /// Bounds on the left: pixels lie at no lower column.
    lefts: Bounds,
    /// Bounds on the right: pixels lie at no higher column.
    rights: Bounds,
}

/// Lines in the picture, on which x · `across` + y · `down` + `start` is zero.
struct Bounds {
    count: usize,
    /// -1 / `across` of each line.
    inverse: [f32; 6],
    down: [f32; 6],
    start: [f32; 6],
}

impl Bounds {
    const NONE: Self = Self { count: 0, inverse: [0.0; 6], down: [0.0; 6], start: [0.0; 6] };

    /// The column at which a row crosses a line.
    #[inline(always)]
    fn column(&self, i: usize, y: f32) -> f32 {
        (self.down[i] * y + self.start[i]) * self.inverse[i]
    }
}

impl Hull {
    /// The outline of a box, given by its least and greatest corner relative to the eye. The eye is
    /// outside of the box.
    #[inline(always)]
    pub(super) fn new(view: &BandView, low: Vec3A, high: Vec3A) -> Self {
        debug_assert!(!low.cmpgt(high).any(), "{low} above {high}");
        let mut hull = Self { lefts: Bounds::NONE, rights: Bounds::NONE };
        for [a, b] in [[0, 1], [1, 2], [2, 0]] {
            let Some([first, last]) = tangents([low[a], high[a]], [low[b], high[b]]) else {
                continue;
            };
            for (corner, sign) in [(first, 1.0), (last, -1.0)] {
                // The cross product of the corner and the line of sight is linear in the pixel.
                let product = |ray: Vec3A| (corner[0] * ray[b] - corner[1] * ray[a]) * sign;
                let (across, down) = (product(view.ray_step[0]), product(view.ray_step[1]));
                hull.bound(across, down, product(view.first_ray));
            }
        }
        hull
    }

    /// Keeps the pixels for which `across` · x + `down` · y + `start` is not negative.
    #[inline(always)]
    fn bound(&mut self, across: f32, down: f32, start: f32) {
        let (to, across) = if across > LEVEL {
            (&mut self.lefts, across)
        } else {
            (&mut self.rights, across.min(-LEVEL))
        };
        to.inverse[to.count] = -1.0 / across;
        (to.down[to.count], to.start[to.count]) = (down, start);
        to.count += 1;
    }

    /// The pixels of an area that are inside of the outline, in a row of blocks.
    #[inline(always)]
    pub(super) fn rows(&self, area: &Area, row: usize) -> Ends {
        let first = (row * BLOCK) as f32;
        let mut left = [area.left as f32; BLOCK];
        let mut right = [area.right as f32 - 1.0; BLOCK];
        for i in 0..self.lefts.count {
            for (y, left) in left.iter_mut().enumerate() {
                let column = self.lefts.column(i, first + y as f32);
                *left = if column > *left { column } else { *left };
            }
        }
        for i in 0..self.rights.count {
            for (y, right) in right.iter_mut().enumerate() {
                let column = self.rights.column(i, first + y as f32);
                *right = if column < *right { column } else { *right };
            }
        }
        let top = area.top as i32 - (row * BLOCK) as i32;
        let bottom = area.bottom as i32 - (row * BLOCK) as i32;
        let mut ends = Ends { left: [0; BLOCK], end: [0; BLOCK] };
        for y in 0..BLOCK {
            // Columns far outside are held to the area, where none of the row is left.
            let far = area.right as f32;
            let from = if left[y] < far { left[y] } else { far };
            let to = if right[y] > -1.0 { right[y] } else { -1.0 };
            let inside = y as i32 >= top && (y as i32) < bottom;
            ends.left[y] = from.ceil() as i32;
            ends.end[y] = if inside { to.floor() as i32 + 1 } else { 0 };
        }
        ends
    }
}

/// The columns of eight rows of pixels: the first, and the one after the last.
pub(super) struct Ends {
    left: [i32; BLOCK],
    end: [i32; BLOCK],
}

impl Ends {
    /// The pixels in the block at a column of blocks, as a mask.
    #[inline(always)]
    pub(super) fn word(&self, column: usize) -> u64 {
        let x = (column * BLOCK) as i32;
        let mut rows = [0; BLOCK];
        for (y, row) in rows.iter_mut().enumerate() {
            let (left, end) = ((self.left[y] - x).clamp(0, 8), (self.end[y] - x).clamp(0, 8));
            *row = ((1 << end) - 1) & !((1 << left) - 1);
        }
        u64::from_le_bytes(rows.map(|row: i32| row as u8))
    }
}

/// The two corners between which a rectangle is seen from the origin, anticlockwise; none when the
/// origin is inside. The rectangle is given by its ends along two axes.
#[inline(always)]
fn tangents([a0, a1]: [f32; 2], [b0, b1]: [f32; 2]) -> Option<[[f32; 2]; 2]> {
    let side = |low: f32, high: f32| i32::from(low > 0.0) - i32::from(high < 0.0);
    let (a, b) = (side(a0, a1), side(b0, b1));
    let near_a = if a > 0 { a0 } else { a1 };
    let near_b = if b > 0 { b0 } else { b1 };
    let pick = |side: i32, positive: f32, negative: f32, zero: f32| match side {
        1 => positive,
        -1 => negative,
        _ => zero,
    };
    let first = [pick(b, a1, a0, near_a), pick(a, b0, b1, near_b)];
    let last = [pick(b, a0, a1, near_a), pick(a, b1, b0, near_b)];
    (a != 0 || b != 0).then_some([first, last])
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use sightline_world::octree::Octree;

    use super::*;
    use crate::{Camera, Mode, mask::Area, view::View};

    const SIDE: usize = 64;

    fn meets(ray: Vec3A, low: Vec3A, high: Vec3A) -> bool {
        let (a, b) = (low / ray, high / ray);
        let (enters, leaves) = (a.min(b).max_element(), a.max(b).min_element());
        enters <= leaves && leaves > 0.0
    }

    proptest! {
        #[test]
        fn an_outline_holds_what_rays_meet(
            low in prop::array::uniform3(-4.0f32..3.0),
            size in prop::array::uniform3(0.01f32..4.0),
            yaw in 0u8..8,
            turn in prop::sample::select(vec![0.0, 0.1, -1.0e-7]),
            pitch in prop::sample::select(vec![0.0, -0.4, 0.9]),
        ) {
            let (low, size) = (Vec3A::from(low), Vec3A::from(size));
            let high = low + size;
            prop_assume!(low.max(-high).max_element() > 0.01);
            let yaw = f32::from(yaw) * std::f32::consts::FRAC_PI_4 + turn;
            let camera = Camera { eye: Vec3::ZERO, yaw, pitch, fov_y: 1.2 };
            let octree = Octree::empty(Vec3::ZERO, 1.0, 3);
            let view = View::new(&camera, SIDE, SIDE).band(0, &octree, Mode::Perspective);
            let hull = Hull::new(&view, low, high);
            let area = Area { left: 0, right: SIDE, top: 0, bottom: SIDE };
            let mut differ = 0;
            for row in 0..SIDE / BLOCK {
                let rows = hull.rows(&area, row);
                for column in 0..SIDE / BLOCK {
                    let word = rows.word(column);
                    for i in 0..64 {
                        let ray = view.ray(column * BLOCK + i % BLOCK, row * BLOCK + i / BLOCK);
                        differ += u32::from((word >> i & 1 == 1) != meets(ray, low, high));
                    }
                }
            }
            // Pixels on an edge may differ.
            prop_assert!(differ <= 4, "{differ} pixels");
        }
    }
}
