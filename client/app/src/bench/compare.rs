//! The renderer's modes against each other, view by view.

use serde::Serialize;
use sightline_world::octree::Octree;

use super::{Counts, Difference, Spread};
use sightline_renderer::{Camera, Frame, Mode, Renderer};

/// How pictures in orthogonal mode differ from those in perspective mode, with one size.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Columns of pixels.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
    /// See [`Difference::differing`].
    pub differing: Spread,
    /// See [`Difference::unlike`].
    pub unlike: Spread,
    /// See [`Difference::shifted`].
    pub shifted: Spread,
    /// The greatest shift of a pixel: see [`Difference::shift_max`].
    pub shift_max: usize,
    /// Projections from space to the picture, as a part of those in perspective mode.
    pub projections: Spread,
    /// Each view.
    pub views: Vec<View>,
}

/// One view, in both modes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct View {
    /// Of the pictures.
    pub difference: Difference,
    /// What perspective mode took.
    pub perspective: Counts,
    /// What orthogonal mode took.
    pub orthogonal: Counts,
}

impl Comparison {
    /// Of all views. `hear` is told the share done, from 0 to 1.
    pub fn of(
        octree: &Octree,
        cameras: &[Camera],
        (width, height): (usize, usize),
        hear: &mut dyn FnMut(f32),
    ) -> Self {
        let mut renderer = Renderer::default();
        let mut frames = [Frame::new(width, height), Frame::new(width, height)];
        let tolerance = octree.voxel() * 3f32.sqrt();
        let mut views = Vec::with_capacity(cameras.len());
        for (i, camera) in cameras.iter().enumerate() {
            let [perspective, orthogonal] = [0, 1].map(|which| {
                renderer.mode = [Mode::Perspective, Mode::Orthogonal][which];
                renderer.draw(octree, camera, &mut frames[which]);
                Counts::mean(&[renderer.counters()])
            });
            let difference = Difference::of(&frames[0], &frames[1], tolerance);
            views.push(View { difference, perspective, orthogonal });
            hear((i + 1) as f32 / cameras.len() as f32);
        }
        let spread = |figure: &dyn Fn(&View) -> f64| {
            Spread::of(&views.iter().map(figure).collect::<Vec<_>>())
        };
        let projections =
            |view: &View| view.orthogonal.projections / view.perspective.projections.max(1.0);
        Self {
            width,
            height,
            differing: spread(&|view| view.difference.differing),
            unlike: spread(&|view| view.difference.unlike),
            shifted: spread(&|view| view.difference.shifted),
            shift_max: views.iter().map(|view| view.difference.shift_max).max().unwrap_or(0),
            projections: spread(&projections),
            views,
        }
    }
}
