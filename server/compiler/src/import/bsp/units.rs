//! From Quake's units and axes to metres, y up.

use glam::{DVec3, Vec3};

/// Metres in a Quake unit.
pub(super) const UNIT: f64 = 0.0254;

/// From Quake's units and axes to metres, y up. Equal coordinates stay equal, bit for bit.
pub(super) fn placed(point: DVec3) -> Vec3 {
    // Adding to zero makes no negative zero.
    (DVec3::ZERO + DVec3::new(point.x, point.z, -point.y) * UNIT).as_vec3()
}
