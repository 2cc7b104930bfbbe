//! Which way a node is drawn: the rule by which orthogonal mode takes the cheaper one.
//!
//! A node is drawn with everything below it by form patterns, or as a whole layer of voxels, or its
//! octants are projected one by one. All ways show the same picture. Which one is cheapest follows
//! from how large a voxel is at the node's depth:
//!
//! * A form pattern is made once for a node, and saves the projection of what lies below. It pays
//!   where much lies below: where voxels span few pixels.
//! * A layer saves the outline of each voxel, and costs two quotients for each pixel. It pays
//!   unless voxels are so large that one outline writes many blocks of pixels at once.

use super::Mode;

/// Form patterns pay where a voxel spans at most this many pixels.
const FORMS_PX: f32 = 2.0;
/// A layer pays where its voxels span at most this many pixels.
const LAYERS_PX: f32 = 16.0;

/// From which depths on each way is taken, in metres.
#[derive(Clone, Copy)]
pub(super) struct Ways {
    /// Nodes at this depth and beyond are drawn by form patterns, if perspective allows it.
    pub(super) forms_from: f32,
    /// Nodes at this depth and beyond are drawn as layers, if they are layers.
    pub(super) layers_from: f32,
}

impl Ways {
    /// The ways of a mode. At a depth of `pixel_wide` metres a voxel spans one pixel.
    pub(super) fn new(mode: Mode, pixel_wide: f32) -> Self {
        match mode {
            Mode::Perspective => Self { forms_from: f32::INFINITY, layers_from: f32::INFINITY },
            Mode::Forms => Self { forms_from: 0.0, layers_from: 0.0 },
            Mode::Orthogonal => {
                Self { forms_from: pixel_wide / FORMS_PX, layers_from: pixel_wide / LAYERS_PX }
            }
        }
    }
}
