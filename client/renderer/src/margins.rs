//! The near plane, and the margins of drawing in pixels.

/// The distance of the near plane, in metres. Nothing nearer is projected: a node that reaches
/// before the plane is halved, or tested pixel by pixel.
pub(super) const NEAR: f32 = 0.01;

/// A voxel is drawn larger by this many pixels on each side, so that no line of sight slips between
/// two voxels that share a face.
pub(super) const SEAM_PX: f32 = 1.0e-3;

/// Bounding boxes are grown by this many pixels on each side. It exceeds [`SEAM_PX`] and what
/// rounding moves a projected point by.
pub(super) const SPARE_PX: f32 = 1.0 / 64.0;

const _: () = assert!(SPARE_PX > 10.0 * SEAM_PX);
