//! Drawing a whole frame: the picture is cut into bands of rows, which threads share.

use std::sync::Arc;

use pulp::WithSimd;
use sightline_visibility::rooms::BuildingSight;
use sightline_world::octree::{MATERIALS_MAX, Octree};

use super::{
    Camera, Frame, SIDE_MAX,
    band::{BAND_ROWS, Band},
    colour,
    mask::BLOCK,
    node_visibility::NodeVisibility,
    parallel,
    shade::{self, FrameRows},
    traversal::{Counters, Mode, NodeClasses, Traversal, TraversalStacks},
    view::View,
};

/// Draws frames, and keeps its buffers from one frame to the next.
#[derive(Default)]
pub struct Renderer {
    /// How nodes are projected.
    pub mode: Mode,
    /// Smooth edges: each pixel is the mean of 2 × 2, which takes more than twice as long. A frame
    /// with a side longer than half of [`SIDE_MAX`] is drawn without.
    pub antialias: bool,
    /// Which nodes are hidden or unoccluded from a viewpoint box, used while the eye is in the box.
    /// The picture is the same. It must be made for the octree that is drawn.
    pub node_visibility: Option<Arc<NodeVisibility>>,
    /// What rooms show of the building that is drawn, to the camera's eye. What they do not show is
    /// not drawn. Node visibility is not used meanwhile: what hides something may itself not be
    /// shown.
    pub building_sight: Option<BuildingSight>,
    /// Forgoes instructions that only newer processors have. The picture is the same.
    pub(super) portable: bool,
    /// The picture of twice the size that antialiasing draws first.
    fine: Frame,
    counters: Counters,
    /// The colour of each of [`Octree::materials`], and black for all other indices.
    colours: Vec<u32>,
    bands: Vec<BandState>,
}

/// What drawing a band needs beside the frame, kept from one frame to the next.
#[derive(Default)]
struct BandState {
    band: Band,
    stacks: TraversalStacks,
    counters: Counters,
}

impl Renderer {
    /// Draws what the camera sees of an octree. With the feature `threads` all threads of the
    /// current rayon pool share the work; the picture does not depend on their number.
    ///
    /// # Panics
    /// When a buffer of the frame does not have the frame's size.
    pub fn draw(&mut self, octree: &Octree, camera: &Camera, frame: &mut Frame) {
        frame.check();
        if self.antialias && frame.width.max(frame.height) <= SIDE_MAX / 2 {
            let mut fine = std::mem::take(&mut self.fine);
            fine.resize(frame.width * 2, frame.height * 2);
            self.draw_plain(octree, camera, &mut fine);
            frame.downsample(&mut fine);
            self.fine = fine;
        } else {
            self.draw_plain(octree, camera, frame);
        }
    }

    fn draw_plain(&mut self, octree: &Octree, camera: &Camera, frame: &mut Frame) {
        let (width, height) = (frame.width, frame.height);
        self.counters = Counters::default();
        if width == 0 || height == 0 {
            return;
        }
        self.colours.clear();
        self.colours.extend(octree.materials.iter().map(colour::of_material));
        self.colours.resize(MATERIALS_MAX, 0);
        let (colours, mode, view) = (&self.colours, self.mode, View::new(camera, width, height));
        let glass_from = octree.first_glass();
        let sight = self.building_sight.as_ref();
        debug_assert!(sight.is_none_or(|sight| sight.eye() == camera.eye), "made for another eye");
        let classes = self.node_visibility.as_deref().filter(|_| sight.is_none());
        let classes = classes.and_then(|of| of.classes(octree, camera.eye, view.focal()));
        let classes = classes.unwrap_or(NodeClasses::UNKNOWN);
        let (processor, portable) = (pulp::Arch::new(), self.portable);
        self.bands.resize_with(height.div_ceil(BAND_ROWS), Default::default);
        let rows = frame.colour.chunks_mut(BAND_ROWS * width);
        let rows = rows.zip(frame.depth.chunks_mut(BAND_ROWS * width));
        let rows = rows.zip(frame.material_ids.chunks_mut(BAND_ROWS * width));
        let blocks = BAND_ROWS / BLOCK * width.div_ceil(BLOCK);
        let rows = rows.zip(frame.farthest.chunks_mut(blocks));
        frame.panes.finer = false;
        frame.panes.bands.resize_with(self.bands.len(), Default::default);
        let rows = rows.zip(&mut frame.panes.bands);
        let bands: Vec<_> = self.bands.iter_mut().zip(rows).collect();
        assert_eq!(bands.len(), height.div_ceil(BAND_ROWS), "every row is in a band");
        parallel::for_each(
            bands,
            |i, (state, ((((colour, depth), material_ids), farthest), panes))| {
                let view = view.band(i * BAND_ROWS, octree, mode);
                let BandState { band, stacks, counters } = state;
                *counters = Counters::default();
                band.clear(width, BAND_ROWS.min(height - i * BAND_ROWS));
                let rows = FrameRows { colour, depth, material_ids, farthest, panes };
                let traversal = Traversal {
                    octree,
                    view: &view,
                    classes,
                    sight,
                    glass_from,
                    band,
                    stacks,
                    counters,
                };
                let work = BandWork { traversal, colours, rows };
                if portable {
                    work.with_simd(pulp::Scalar);
                } else {
                    processor.dispatch(work);
                }
                counters.pixels = band.pixels;
            },
        );
        self.bands.iter().for_each(|state| self.counters.add(&state.counters));
        debug_assert!(self.counters.pixels <= (width * height) as u64, "pixels are written once");
    }

    /// The counters of the last picture.
    pub fn counters(&self) -> Counters {
        self.counters
    }
}

/// The work on one band. It is a type and not a closure, because only functions without closures
/// are compiled as a whole for each kind of processor.
struct BandWork<'a> {
    traversal: Traversal<'a>,
    colours: &'a [u32],
    rows: FrameRows<'a>,
}

impl WithSimd for BandWork<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        self.traversal.run();
        shade::band(self.traversal.band, self.traversal.view, self.colours, &mut self.rows);
    }
}
