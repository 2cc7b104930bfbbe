//! The opaque triangles of one plane, in buckets.

use std::collections::HashMap;

use super::rectangle::{PlaneRect, PlaneTriangle};
use crate::split_plane::SplitPlane;

/// The opaque part of one plane: axial, or vertical at any angle.
#[derive(Debug)]
pub(crate) struct OccluderPlane {
    /// The plane.
    pub cut: SplitPlane,
    /// The opaque triangles, which may overlap. Corners run anticlockwise.
    pub triangles: Vec<PlaneTriangle>,
    /// For each triangle, [`OccluderTriangle::is_last`].
    pub is_last: Vec<bool>,
    buckets: HashMap<(i64, i64), Vec<u32>>,
}

/// The width of a bucket, in metres.
const BUCKET: f64 = 4.0;

impl OccluderPlane {
    pub(super) fn new(
        cut: SplitPlane,
        opaque: impl Iterator<Item = (PlaneTriangle, bool)>,
    ) -> Self {
        let (triangles, is_last): (Vec<_>, Vec<_>) = opaque.unzip();
        let mut buckets: HashMap<_, Vec<u32>> = HashMap::new();
        for (index, triangle) in triangles.iter().enumerate() {
            for bucket in buckets_of(&PlaneRect::around(triangle)) {
                buckets.entry(bucket).or_default().push(index as u32);
            }
        }
        assert_eq!(triangles.len(), is_last.len(), "a flag for each triangle");
        Self { cut, triangles, is_last, buckets }
    }

    /// The triangles whose bounding rectangles overlap a rectangle, each once, in order.
    pub(crate) fn overlapping(&self, rect: &PlaneRect) -> Vec<&PlaneTriangle> {
        let mut found: Vec<u32> = buckets_of(rect)
            .filter_map(|bucket| self.buckets.get(&bucket))
            .flatten()
            .copied()
            .filter(|&i| {
                let around = PlaneRect::around(&self.triangles[i as usize]);
                !around.intersection(rect).is_flat()
            })
            .collect();
        found.sort_unstable();
        found.dedup();
        found.into_iter().map(|i| &self.triangles[i as usize]).collect()
    }
}

fn buckets_of(rect: &PlaneRect) -> impl Iterator<Item = (i64, i64)> + use<> {
    let low = (rect.min / BUCKET).floor().as_i64vec2();
    let high = (rect.max / BUCKET).floor().as_i64vec2();
    (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| (x, y)))
}
