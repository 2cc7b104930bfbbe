//! Sight tests between regions: whether a line from one region to another may be free.

use sightline_visibility::box_visibility::{BoxScratch, BoxVisibility, Occluders, SightLine};
use sightline_world::geometry::Aabb;

use super::{CoverBoxes, RegionFootprint};

/// The memory of sight tests.
#[derive(Clone, Debug, Default)]
pub(crate) struct SightTester {
    scratch: BoxScratch,
}

/// What a sight test between two regions found.
pub(crate) enum BoxTest {
    /// This line may be free.
    Free(SightLine),
    /// Every line is blocked.
    Hidden,
    /// The budget did not suffice.
    Undecided,
}

impl SightTester {
    /// Whether no gates lead from one region to another.
    pub(crate) fn are_apart(
        &mut self,
        occluders: &Occluders,
        one: &RegionFootprint,
        other: &RegionFootprint,
    ) -> bool {
        occluders.are_apart(&mut self.scratch, one.in_spaces(), other.in_spaces())
    }

    /// Tests all lines from some boxes to others, as far as the budget goes.
    pub(crate) fn test(
        &mut self,
        occluders: &Occluders,
        eyes: &CoverBoxes,
        bodies: &CoverBoxes,
        budget: &mut u32,
    ) -> BoxTest {
        let mut found = BoxTest::Hidden;
        for from in eyes.boxes() {
            for to in bodies.boxes() {
                match occluders.between(&mut self.scratch, from, to, budget) {
                    BoxVisibility::Visible(line) => return BoxTest::Free(line),
                    BoxVisibility::Hidden => {}
                    // A line between two other boxes may still be free for sure.
                    BoxVisibility::Unknown => found = BoxTest::Undecided,
                }
            }
        }
        found
    }

    /// Tests all lines from some boxes to others, for at most `most` units of the budget.
    pub(crate) fn test_up_to(
        &mut self,
        occluders: &Occluders,
        eyes: &CoverBoxes,
        bodies: &CoverBoxes,
        most: u32,
        budget: &mut u32,
    ) -> BoxTest {
        let given = most.min(*budget);
        let mut left = given;
        let found = self.test(occluders, eyes, bodies, &mut left);
        debug_assert!(left <= given, "a test spends budget");
        *budget -= given - left;
        found
    }

    /// Whether a line is free, as far as gates and occluders tell.
    pub(crate) fn is_free(
        &mut self,
        occluders: &Occluders,
        line: &SightLine,
        budget: &mut u32,
    ) -> bool {
        let [from, to] = [line.from, line.to].map(|end| Aabb::new(end, end));
        let outcome = occluders.between(&mut self.scratch, &from, &to, budget);
        matches!(outcome, BoxVisibility::Visible(_))
    }
}
