//! When a node is drawn in orthogonal mode: by the ratio of its nearest and farthest distance
//! (Dell 2012, box 101).

use super::margins::NEAR;

/// A node looks alike all over when its front and back are seen at most this many pixels apart.
/// Perspective inside of it is then left out.
const FINE_PX: f32 = 0.125;

/// Depths inside of a coarse node differ from its centre's by at most this share …
const DEEPER_MAX: f32 = 0.25;
/// … and half of the node spans at most this many pixels. The error of a place is the eighth power
/// of the one times the other, which is below a fiftieth of a pixel.
const HALF_MAX_PX: f32 = 1_200.0;

/// The least ratio of nearest to farthest distance of a node that looks alike all over, for a focal
/// length in pixels (Dell 2012, box 101). Bisection finds where a cube of edge 2 must stand so that
/// its corners (1, 1, -1) and (1, 1, 1) are seen [`FINE_PX`] apart.
pub(super) fn ratio_min(focal: f32) -> f32 {
    let apart = |z: f32| focal / (z - 1.0) - focal / (z + 1.0);
    let (mut near, mut far) = (1.0 + NEAR, 1.0e5);
    for _ in 0..40 {
        let middle = 0.5 * (near + far);
        if apart(middle) > FINE_PX {
            near = middle;
        } else {
            far = middle;
        }
    }
    (far - 1.0) / (far + 1.0)
}

/// The least ratio of nearest to farthest distance with which a node may be drawn in orthogonal
/// mode, for a focal length in pixels.
pub(super) fn coarse_ratio_min(focal: f32) -> f32 {
    let deeper = DEEPER_MAX.min(HALF_MAX_PX / focal);
    (1.0 - deeper) / (1.0 + deeper)
}
