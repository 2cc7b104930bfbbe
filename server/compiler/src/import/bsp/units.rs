//! From Quake's units and axes to metres, y up.

use glam::{DVec3, Vec3};

/// The length of a Quake unit, in metres.
pub(super) const UNIT: f64 = 0.0254;

/// A point in metres, y up, from Quake's units and axes. Equal coordinates stay equal, bit for bit.
pub(super) fn placed(point: DVec3) -> Vec3 {
    // Adding zero avoids negative zeros.
    (DVec3::ZERO + DVec3::new(point.x, point.z, -point.y) * UNIT).as_vec3()
}
