//! The renderer's modes compared with each other, view by view.

use serde::Serialize;
use sightline_renderer::{Camera, Frame, Mode, Renderer};
use sightline_world::octree::Octree;

use super::{DrawMethod, FrameCounts, PictureDifference, Spread};

/// How pictures in a mode differ from those in perspective mode, at one size.
#[derive(Clone, Debug, Serialize)]
pub struct ModeComparison {
    /// The mode: see [`DrawMethod::name`].
    pub mode: &'static str,
    /// Columns of pixels.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
    /// See [`PictureDifference::differing`].
    pub differing: Spread,
    /// See [`PictureDifference::unlike`].
    pub unlike: Spread,
    /// See [`PictureDifference::shifted`].
    pub shifted: Spread,
    /// The greatest shift of a pixel: see [`PictureDifference::shift_max`].
    pub shift_max: usize,
    /// Projections from space to the picture in the mode, as a share of those in perspective mode.
    pub projections: Spread,
    /// All views, one by one.
    pub views: Vec<ViewComparison>,
}

/// One view in both modes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ViewComparison {
    /// How the two pictures differ.
    pub difference: PictureDifference,
    /// The work of perspective mode.
    pub perspective: FrameCounts,
    /// The work of the mode that is compared with it.
    pub compared: FrameCounts,
}

impl ModeComparison {
    /// Compares a mode with perspective mode in all views. Calls `progress` with the share done,
    /// from 0 to 1.
    pub fn of(
        mode: Mode,
        octree: &Octree,
        cameras: &[Camera],
        size: (usize, usize),
        progress: &mut dyn FnMut(f32),
    ) -> Self {
        let (width, height) = size;
        let mut renderer = Renderer::default();
        let mut frames = [Frame::new(width, height), Frame::new(width, height)];
        let tolerance = octree.voxel() * 3f32.sqrt();
        let mut views = Vec::with_capacity(cameras.len());
        for (i, camera) in cameras.iter().enumerate() {
            let [perspective, compared] = [0, 1].map(|which| {
                renderer.mode = [Mode::Perspective, mode][which];
                renderer.draw(octree, camera, &mut frames[which]);
                FrameCounts::mean(&[renderer.counters()])
            });
            let difference = PictureDifference::of(&frames[0], &frames[1], tolerance);
            views.push(ViewComparison { difference, perspective, compared });
            progress((i + 1) as f32 / cameras.len() as f32);
        }
        let spread = |figure: &dyn Fn(&ViewComparison) -> f64| {
            Spread::of(&views.iter().map(figure).collect::<Vec<_>>())
        };
        let projections = |view: &ViewComparison| {
            view.compared.projections / view.perspective.projections.max(1.0)
        };
        Self {
            mode: DrawMethod::Octree(mode).name(),
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
