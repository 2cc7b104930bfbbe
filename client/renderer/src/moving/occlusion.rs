//! Whether any part of a box may be visible in a picture.

use sightline_world::geometry::Aabb;

use super::moving_set::ROUNDING;
use crate::{
    Camera, Frame,
    margins::NEAR,
    pyramid::{Pyramid, Rectangle, Span},
    view::View,
};

/// Tests boxes against the depths of one picture.
pub(super) struct OcclusionTest<'a> {
    view: View,
    frame: &'a Frame,
    pyramid: &'a mut Pyramid,
    /// The number of tests so far.
    pub(super) tested: usize,
}

impl<'a> OcclusionTest<'a> {
    pub(super) fn new(camera: &Camera, frame: &'a Frame, pyramid: &'a mut Pyramid) -> Self {
        pyramid.begin(frame);
        let view = View::new(camera, frame.width(), frame.height());
        Self { view, frame, pyramid, tested: 0 }
    }

    /// Whether any part of a box may be visible.
    pub(super) fn shows(&mut self, bounds: &Aabb) -> bool {
        self.tested += 1;
        let depths = bounds.corners().map(|corner| self.view.project(corner).z);
        let nearest = depths.into_iter().fold(f32::INFINITY, f32::min) * (1.0 - ROUNDING);
        let (columns, rows) = self.view.bounds(bounds.centre(), bounds.size() * 0.5);
        // One pixel more on each side, for rounding.
        let span = |[low, high]: [f32; 2], side: usize| -> Option<Span> {
            let first = (low - 1.0).floor().max(0.0) as usize;
            let after = ((high + 2.0).ceil().max(0.0) as usize).min(side);
            (low <= high && first < after).then_some([first, after])
        };
        let columns = span(columns, self.frame.width());
        let spans = columns.zip(span(rows, self.frame.height()));
        let Some((columns, rows)) = spans else { return false };
        nearest < NEAR
            || !self.pyramid.hides(&self.frame.depth, Rectangle { columns, rows }, nearest)
    }
}
