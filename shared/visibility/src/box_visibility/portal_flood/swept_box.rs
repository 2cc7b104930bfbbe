//! The boxes between two boxes, and the gates they meet on the way.

use glam::{BVec3A, Vec3A};
use sightline_world::tolerance::SUM_F32_M;

use super::{
    exit::{AXIAL_DIRECTIONS, ExitDirection},
    simd_box::SimdBox,
};

/// What single precision may lose in a share of a line's length.
const ROUNDING_T: f32 = 1e-6;
/// A gate at a lesser share of the length than this does not narrow the far end.
const NEAR_T: f32 = 1e-3;
/// A plane that moves by less than this, in metres, counts as moving by this much.
const MOVE_MIN_M: f32 = 1e-9;

/// A box that moves from one place and size to another as `t` goes from 0 to 1.
pub(super) struct SweptBox {
    from: SimdBox,
    to: SimdBox,
    /// One over the distance that the lower faces move by; never infinite.
    low_inverse: Vec3A,
    /// One over the distance that the upper faces move by; never infinite.
    high_inverse: Vec3A,
    low_rises: BVec3A,
    high_rises: BVec3A,
    /// A bit for each axial direction: whether some line takes it.
    axial_directions: u32,
}

impl SweptBox {
    pub(super) fn new(from: &SimdBox, to: &SimdBox) -> Self {
        let least = Vec3A::splat(MOVE_MIN_M);
        let sane = |by: Vec3A| Vec3A::select(by.abs().cmplt(least), least, by);
        let by = [sane(to.low - from.low), sane(to.high - from.high)];
        let margin = Vec3A::splat(SUM_F32_M);
        let down = (to.low - from.high).cmple(margin).bitmask();
        let up = (to.high - from.low).cmpge(-margin).bitmask();
        // Moves the bits of the three axes two places apart from each other.
        let apart = |bits: u32| bits & 1 | (bits & 2) << 1 | (bits & 4) << 2;
        Self {
            from: *from,
            to: *to,
            low_inverse: by[0].recip(),
            high_inverse: by[1].recip(),
            low_rises: by[0].cmpgt(Vec3A::ZERO),
            high_rises: by[1].cmpgt(Vec3A::ZERO),
            axial_directions: apart(down) | apart(up) << 1,
        }
    }

    /// The least and the greatest `t`, not before `entry_t`, at which the box meets a gate.
    pub(super) fn meets(&self, gate: &SimdBox, entry_t: f32) -> Option<[f32; 2]> {
        let below = (gate.high - self.from.low) * self.low_inverse;
        let above = (gate.low - self.from.high) * self.high_inverse;
        // The lower faces must not be above the gate, nor the upper ones below it.
        let (all, none) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let first = Vec3A::select(self.low_rises, none, below)
            .max(Vec3A::select(self.high_rises, above, none))
            .max_element()
            .max(entry_t);
        let last = Vec3A::select(self.low_rises, below, all)
            .min(Vec3A::select(self.high_rises, all, above))
            .min_element()
            .min(1.0);
        (first <= last + ROUNDING_T).then_some([first - ROUNDING_T, last + ROUNDING_T])
    }

    /// Whether some line leaves in this direction.
    pub(super) fn takes(&self, direction: ExitDirection, normals: &[Vec3A]) -> bool {
        if direction < AXIAL_DIRECTIONS {
            return self.axial_directions >> direction & 1 == 1;
        }
        let normal = normals[(direction - AXIAL_DIRECTIONS) as usize];
        let most = Vec3A::select(normal.cmpgt(Vec3A::ZERO), self.to.high, self.to.low);
        let least = Vec3A::select(normal.cmpgt(Vec3A::ZERO), self.from.low, self.from.high);
        normal.dot(most - least) >= -SUM_F32_M
    }

    /// The two boxes, narrowed to the ends of lines that pass a gate between two shares of their
    /// length. None if there are no such lines.
    pub(super) fn narrowed(&self, gate: &SimdBox, [first, last]: [f32; 2]) -> Option<[SimdBox; 2]> {
        debug_assert!(first <= last, "shares come in order");
        let from = narrowed_end(&self.from, &self.to, gate, [1.0 - last, 1.0 - first])?;
        Some([from, narrowed_end(&self.to, &self.from, gate, [first, last])?])
    }
}

/// The ends, within the box `far`, of lines that begin in the box `near` and pass a gate between
/// two shares of their length. None if there are no such lines.
fn narrowed_end(
    far: &SimdBox,
    near: &SimdBox,
    gate: &SimdBox,
    [first, last]: [f32; 2],
) -> Option<SimdBox> {
    if first < NEAR_T {
        return Some(*far);
    }
    let (most, least) = (first.recip(), last.min(1.0).recip());
    let (low, high) = (gate.low - near.high, gate.high - near.low);
    let margin = Vec3A::splat(SUM_F32_M * most);
    let low = near.high + (low * most).min(low * least) - margin;
    let high = near.low + (high * most).max(high * least) + margin;
    let narrowed = SimdBox { low: far.low.max(low), high: far.high.min(high) };
    narrowed.low.cmple(narrowed.high).all().then_some(narrowed)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use sightline_world::{geometry::Aabb, tolerance::GATE_WIDENING_M};

    use super::*;

    proptest! {
        #[test]
        fn lines_through_a_gate_end_in_the_narrowed_boxes(
            corners in prop::array::uniform6(prop::array::uniform3(-40i8..40)),
            ends in prop::array::uniform2(prop::array::uniform3(0.0..=1.0f32)),
            share in 0.0..=1.0f32,
        ) {
            let [a, b, c, d, e, f] = corners.map(|at| Vec3::from(at.map(f32::from)));
            let [start, end] = [(a, b), (c, d)].map(|(a, b)| Aabb::new(a.min(b), a.max(b)));
            let [from, to] = [(start, ends[0]), (end, ends[1])]
                .map(|(region, at)| region.min + region.size() * Vec3::from(at));
            // A gate around a point of the line.
            let through = from.lerp(to, share);
            let gate = Aabb::new(through.min(through + e * 0.1), through.max(through + f * 0.1));
            let swept = SweptBox::new(&SimdBox::new(&start), &SimdBox::new(&end));
            let gate = SimdBox::new(&gate.grown(GATE_WIDENING_M));
            let ts = swept.meets(&gate, 0.0);
            prop_assert!(ts.is_some_and(|[least, most]| least <= share && share <= most));
            let narrowed = ts.and_then(|ts| swept.narrowed(&gate, ts));
            let holds = |span: &SimdBox, point: Vec3| {
                span.holds(&SimdBox { low: point.into(), high: point.into() })
            };
            prop_assert!(narrowed.is_some_and(|[a, b]| holds(&a, from) && holds(&b, to)));
        }

        #[test]
        fn a_gate_is_met_wherever_the_moving_box_meets_it(
            corners in prop::array::uniform6(prop::array::uniform3(-4i8..4)),
            from in 0.0..1.0f32,
        ) {
            let [a, b, c, d, e, f] = corners.map(|at| Vec3::from(at.map(f32::from)));
            let [start, end, gate] =
                [(a, b), (c, d), (e, f)].map(|(a, b)| Aabb::new(a.min(b), a.max(b)));
            let swept = SweptBox::new(&SimdBox::new(&start), &SimdBox::new(&end));
            let met = swept.meets(&SimdBox::new(&gate.grown(1e-4)), from);
            for share in (0..=200).map(|i| i as f32 / 200.0).filter(|share| *share >= from) {
                let moving = Aabb::new(
                    start.min.lerp(end.min, share),
                    start.max.lerp(end.max, share),
                );
                if moving.intersects(&gate) {
                    let is_among =
                        |[least, most]: [f32; 2]| least <= share + 1e-4 && share <= most + 1e-4;
                    prop_assert!(met.is_some_and(is_among));
                }
            }
        }
    }
}
