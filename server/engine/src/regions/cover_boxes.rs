//! A region as a few boxes, so that sight tests between two regions are few.

use arrayvec::ArrayVec;
use sightline_world::geometry::Aabb;

/// The most boxes of a region: each pair of boxes costs a sight test.
const BOXES_MAX: usize = 4;
/// Two boxes are merged when so much of their union is in either of them.
const FILLED: f32 = 0.9;

/// At most four boxes in own axes that cover a region.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct CoverBoxes(ArrayVec<Aabb, { BOXES_MAX + 1 }>);

impl CoverBoxes {
    /// Covers boxes, merging those whose union has least empty space.
    pub(crate) fn covering(boxes: impl Iterator<Item = Aabb>) -> Self {
        let mut cover = Self::default();
        for region in boxes.filter(|region| !region.is_empty()) {
            cover.0.push(region);
            while let Some(closest) = cover.closest()
                && (closest.filled >= FILLED || cover.0.len() > BOXES_MAX)
            {
                let other = cover.0.swap_remove(closest.second);
                cover.0[closest.first] = cover.0[closest.first].union(&other);
            }
        }
        debug_assert!(cover.0.len() <= BOXES_MAX, "every pair of boxes costs a sight test");
        cover
    }

    /// The parts of the boxes that are in another box.
    pub(crate) fn clipped(&self, region: &Aabb) -> Self {
        let shared = self.0.iter().map(|part| part.intersection(region));
        Self(shared.filter(|part| !part.is_empty()).collect())
    }

    /// The box around all of them.
    pub(crate) fn bounds(&self) -> Aabb {
        self.0.iter().fold(Aabb::EMPTY, |all, part| all.union(part))
    }

    /// The boxes, none of which is empty.
    pub(crate) fn boxes(&self) -> &[Aabb] {
        &self.0
    }

    /// The two boxes whose union has the least empty space.
    fn closest(&self) -> Option<Closest> {
        let pairs = (0..self.0.len()).flat_map(|a| (a + 1..self.0.len()).map(move |b| (a, b)));
        pairs
            .map(|(first, second)| Closest {
                first,
                second,
                filled: filled(&self.0[first], &self.0[second]),
            })
            .max_by(|one, other| one.filled.total_cmp(&other.filled))
    }
}

/// Two of the boxes; `first` is less than `second`.
struct Closest {
    first: usize,
    second: usize,
    /// How much of their union is in either of them, from 0 to 1.
    filled: f32,
}

/// How much of the union of two boxes is in either of them, from 0 to 1.
fn filled(a: &Aabb, b: &Aabb) -> f32 {
    // A region may be flat. A centimetre of thickness makes no difference to sight.
    let volume = |part: &Aabb| part.size().max(glam::Vec3::splat(0.01)).element_product();
    let shared = a.intersection(b);
    let twice = if shared.is_empty() { 0.0 } else { volume(&shared) };
    (volume(a) + volume(b) - twice) / volume(&a.union(b))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn adjacent_tiles_merge_into_one_box_and_distant_ones_do_not() {
        let tile =
            |x: f32, z: f32| Aabb::new(Vec3::new(x, 0.0, z), Vec3::new(x + 1.0, 2.0, z + 1.0));
        let whole = CoverBoxes::covering([tile(0.0, 0.0), tile(1.0, 0.0)].into_iter());
        assert_eq!(whole.boxes(), [Aabb::new(Vec3::ZERO, Vec3::new(2.0, 2.0, 1.0))]);
        let apart = CoverBoxes::covering([tile(0.0, 0.0), tile(5.0, 0.0)].into_iter());
        assert_eq!(apart.boxes().len(), 2);
    }

    proptest! {
        #[test]
        fn a_few_boxes_cover_all(
            boxes in proptest::collection::vec(
                ((-9.0..9.0f32, -9.0..9.0f32, -9.0..9.0f32), (0.0..4.0f32, 0.0..4.0f32, 0.0..4.0f32)),
                0..20,
            ),
        ) {
            let boxes: Vec<Aabb> = boxes
                .into_iter()
                .map(|(at, size)| Aabb::new(at.into(), Vec3::from(at) + Vec3::from(size)))
                .collect();
            let parts = CoverBoxes::covering(boxes.iter().copied());
            prop_assert!(parts.boxes().len() <= BOXES_MAX);
            for part in &boxes {
                prop_assert!(parts.boxes().iter().any(|cover| cover.contains_box(part)));
            }
        }
    }
}
