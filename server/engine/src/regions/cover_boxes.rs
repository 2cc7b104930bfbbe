//! A region as a few boxes, so that lines between two regions can be looked at.

use sightline_world::geometry::Aabb;

/// More boxes than this are never kept: lines are looked at from each of them.
const PARTS_MAX: usize = 4;
/// Two boxes become one when so much of it is in either of them.
const FILLED: f32 = 0.9;

/// Boxes in own axes that cover a region.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct CoverBoxes(Vec<Aabb>);

impl CoverBoxes {
    /// Covers boxes that each lie in a place of their own.
    pub(crate) fn covering(boxes: impl Iterator<Item = Aabb>) -> Self {
        let mut parts = Self(Vec::with_capacity(PARTS_MAX + 1));
        for part in boxes.filter(|part| !part.is_empty()) {
            parts.0.push(part);
            while let Some((a, b, filled)) = parts.closest()
                && (filled >= FILLED || parts.0.len() > PARTS_MAX)
            {
                let other = parts.0.swap_remove(b);
                parts.0[a] = parts.0[a].union(&other);
            }
        }
        parts
    }

    /// What of them is in a box.
    pub(crate) fn within(&self, region: &Aabb) -> Self {
        let shared = self.0.iter().map(|part| part.intersection(region));
        Self(shared.filter(|part| !part.is_empty()).collect())
    }

    /// The boxes.
    pub(crate) fn boxes(&self) -> &[Aabb] {
        &self.0
    }

    /// The two whose union has the least that is in neither of them, and how much of it is.
    fn closest(&self) -> Option<(usize, usize, f32)> {
        let pairs = (0..self.0.len()).flat_map(|a| (a + 1..self.0.len()).map(move |b| (a, b)));
        pairs
            .map(|(a, b)| (a, b, filled(&self.0[a], &self.0[b])))
            .max_by(|(.., one), (.., other)| one.total_cmp(other))
    }
}

/// How much of the union of two boxes is in either of them.
fn filled(a: &Aabb, b: &Aabb) -> f32 {
    // A region may be flat: a centimetre is nothing to look past.
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
    fn tiles_of_a_box_become_that_box_and_rooms_apart_stay_apart() {
        let tile =
            |x: f32, z: f32| Aabb::new(Vec3::new(x, 0.0, z), Vec3::new(x + 1.0, 2.0, z + 1.0));
        let whole = CoverBoxes::covering([tile(0.0, 0.0), tile(1.0, 0.0)].into_iter());
        assert_eq!(whole.boxes(), [Aabb::new(Vec3::ZERO, Vec3::new(2.0, 2.0, 1.0))]);
        let apart = CoverBoxes::covering([tile(0.0, 0.0), tile(5.0, 0.0)].into_iter());
        assert_eq!(apart.boxes().len(), 2);
    }

    proptest! {
        #[test]
        fn all_is_covered_by_a_few(
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
            prop_assert!(parts.boxes().len() <= PARTS_MAX);
            for part in &boxes {
                prop_assert!(parts.boxes().iter().any(|cover| cover.contains_box(part)));
            }
        }
    }
}
