//! Conversions between domain types and wire types. Every wire value converts to finite numbers.

use std::{
    f32::consts::{FRAC_PI_2, TAU},
    time::Duration,
};

use glam::Vec3;
use serde::{Deserialize, Serialize};
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::{Pose, Tbv},
    tolerance::WIRE_UNITS_PER_METRE,
};

/// Positions on the wire are in 512ths of a metre, about 2 mm.
pub const UNITS_PER_METRE: f32 = WIRE_UNITS_PER_METRE;
/// Velocities on the wire are in 128ths of a metre per second.
pub const SPEED_UNITS: f32 = 128.0;
/// The unit of turns of axes on the wire, in radians: 2⁻³² of a full turn.
const TURN_UNIT: f64 = std::f64::consts::TAU / 4_294_967_296.0;
/// The greatest coordinate on the wire: 100 km.
pub const COORDINATE_MAX: i32 = 100_000 * 512;

/// A position in 512ths of a metre. No coordinate exceeds [`COORDINATE_MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "[i32; 3]", into = "[i32; 3]")]
pub struct WirePosition([i32; 3]);

impl WirePosition {
    /// The position with these coordinates. `None` when one exceeds [`COORDINATE_MAX`].
    pub fn new(units: [i32; 3]) -> Option<Self> {
        units.iter().all(|u| u.unsigned_abs() <= COORDINATE_MAX as u32).then_some(Self(units))
    }

    /// The coordinates, in 512ths of a metre.
    pub fn units(&self) -> [i32; 3] {
        self.0
    }
}

impl TryFrom<[i32; 3]> for WirePosition {
    type Error = &'static str;

    fn try_from(units: [i32; 3]) -> Result<Self, Self::Error> {
        Self::new(units).ok_or("a position beyond the limits of the world")
    }
}

impl From<WirePosition> for [i32; 3] {
    fn from(position: WirePosition) -> Self {
        position.0
    }
}

/// Rounds to the nearest unit and clamps to the limits.
impl From<Vec3> for WirePosition {
    fn from(place: Vec3) -> Self {
        let limit = f64::from(COORDINATE_MAX);
        let units = |v: f32| (f64::from(v) * f64::from(UNITS_PER_METRE)).round();
        Self(place.to_array().map(|v| units(v).clamp(-limit, limit) as i32))
    }
}

impl From<WirePosition> for Vec3 {
    fn from(position: WirePosition) -> Self {
        Self::from_array(position.0.map(|u| (f64::from(u) / f64::from(UNITS_PER_METRE)) as f32))
    }
}

/// A quantised pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WirePose {
    /// The position of the eye.
    pub position: WirePosition,
    /// The yaw, in 65,536ths of a full turn.
    pub yaw: u16,
    /// The pitch, in 32,767ths of a right angle.
    pub pitch: i16,
    /// The velocity, in 128ths of a metre per second.
    pub velocity: [i16; 3],
}

impl From<&Pose> for WirePose {
    fn from(pose: &Pose) -> Self {
        let turn = (pose.yaw / TAU).rem_euclid(1.0) * 65_536.0;
        Self {
            position: pose.eye.into(),
            yaw: turn.round() as u32 as u16,
            pitch: ((pose.pitch / FRAC_PI_2).clamp(-1.0, 1.0) * 32_767.0).round() as i16,
            velocity: pose.velocity.to_array().map(|v| (v * SPEED_UNITS).round() as i16),
        }
    }
}

impl From<WirePose> for Pose {
    fn from(wire: WirePose) -> Self {
        Self {
            eye: wire.position.into(),
            yaw: f32::from(wire.yaw) / 65_536.0 * TAU,
            pitch: f32::from(wire.pitch.max(-32_767)) / 32_767.0 * FRAC_PI_2,
            velocity: Vec3::from_array(wire.velocity.map(|v| f32::from(v) / SPEED_UNITS)),
        }
    }
}

/// A quantised TBV. It is never larger than the server's, and never lasts longer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireTbv {
    /// The corner with the least coordinates, along the building's axes.
    pub min: WirePosition,
    /// The corner with the greatest coordinates. Where one is less than in `min`, the region is
    /// empty.
    pub max: WirePosition,
    /// The turn from the world's axes to the building's, in 2⁻³² of a full turn.
    pub turn: i32,
    /// The validity from the moment of sending, in milliseconds.
    pub validity_ms: u32,
    /// The notice that the client must give before its body can leave, in milliseconds. Zero when
    /// the body cannot leave.
    pub notice_ms: u16,
}

impl WireTbv {
    /// What remains of a TBV at `now`, on the server's clock.
    pub fn new(tbv: &Tbv, now: Duration) -> Self {
        // A coordinate moves by up to half a unit when rounded to integers, by a rounding of `f32`
        // when converted back, and by the rounding of the turn.
        let Aabb { min, max } = tbv.within;
        let farthest_m = min.abs().max(max.abs()).max_element();
        let inwards = (0.6 + farthest_m * UNITS_PER_METRE * (0.5f32).powi(22)) / UNITS_PER_METRE;
        debug_assert!(inwards > 0.0, "the region on the wire must be inside of {tbv:?}");
        let left = tbv.expiry.saturating_sub(now).as_millis();
        Self {
            min: (min + inwards).into(),
            max: (max - inwards).into(),
            turn: (tbv.axes.turn() / TURN_UNIT).round() as i32,
            validity_ms: u32::try_from(left).unwrap_or(u32::MAX),
            notice_ms: tbv.notice.as_micros().div_ceil(1_000).try_into().unwrap_or(u16::MAX),
        }
    }

    /// The TBV on the clock of a client that receives it at `now`.
    pub fn at(&self, now: Duration) -> Tbv {
        Tbv {
            within: Aabb::new(self.min.into(), self.max.into()),
            axes: Axes::turned(f64::from(self.turn) * TURN_UNIT),
            expiry: now + Duration::from_millis(u64::from(self.validity_ms)),
            notice: Duration::from_millis(u64::from(self.notice_ms)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wire_pose() -> impl Strategy<Value = WirePose> {
        let unit = -COORDINATE_MAX / 4..=COORDINATE_MAX / 4;
        (proptest::array::uniform3(unit), any::<u16>(), -32_767i16.., any::<[i16; 3]>()).prop_map(
            |(units, yaw, pitch, velocity)| WirePose {
                position: WirePosition::new(units).unwrap(),
                yaw,
                pitch,
                velocity,
            },
        )
    }

    proptest! {
        #[test]
        fn quantised_poses_quantise_to_themselves(wire in wire_pose()) {
            let mut wire = wire;
            // Beyond 2^24 units an `f32` has too few bits. Buildings are smaller.
            wire.position = WirePosition(wire.position.0.map(|u| u % (1 << 24)));
            prop_assert_eq!(WirePose::from(&Pose::from(wire)), wire);
        }

        #[test]
        fn quantising_moves_any_pose_by_little(
            eye in proptest::array::uniform3(-2_000f32..2_000.0),
            yaw in -20f32..20.0,
            pitch in -1.5f32..1.5,
            velocity in proptest::array::uniform3(-100f32..100.0),
        ) {
            let pose = Pose { eye: eye.into(), yaw, pitch, velocity: velocity.into() };
            let back = Pose::from(WirePose::from(&pose));
            prop_assert!(back.eye.distance(pose.eye) < 0.002);
            prop_assert!(back.forward().distance(pose.forward()) < 2e-4);
            prop_assert!(back.velocity.distance(pose.velocity) < 0.01);
        }

        #[test]
        fn any_bits_give_finite_numbers(
            x: u32, y: u32, z: u32, yaw: u32, pitch: u32, speed: u32,
        ) {
            let pose = Pose {
                eye: Vec3::new(f32::from_bits(x), f32::from_bits(y), f32::from_bits(z)),
                yaw: f32::from_bits(yaw),
                pitch: f32::from_bits(pitch),
                velocity: Vec3::splat(f32::from_bits(speed)),
            };
            prop_assert!(Pose::from(WirePose::from(&pose)).is_finite());
        }

        #[test]
        fn a_clients_tbv_lies_within_the_servers(
            centre in proptest::array::uniform3(-90_000f32..90_000.0),
            scale in prop_oneof![Just(1.0f32), Just(0.01), Just(0.0001)],
            size in proptest::array::uniform3(0f32..200.0),
            turn in prop_oneof![Just(0.0), -1.6..1.6f64],
            place in proptest::array::uniform3(0f32..=1.0),
            left_us in 0u64..10_000_000,
        ) {
            let now = Duration::from_secs(77);
            let expiry = now + Duration::from_micros(left_us);
            let (centre, half) = (Vec3::from(centre) * scale, Vec3::from(size) * 0.5);
            let within = Aabb::new(centre - half, centre + half);
            let notice = Duration::from_micros(left_us / 10);
            let server = Tbv { within, axes: Axes::turned(turn), expiry, notice };
            let client = WireTbv::new(&server, now).at(now);
            prop_assert!(client.expiry <= server.expiry && client.notice >= server.notice);
            let Aabb { min, max } = client.within;
            let place = client.axes.world(min + (max - min) * Vec3::from(place));
            if client.contains(place) {
                // Far away, single precision bounds how well either end can tell.
                let lost_m = place.abs().max_element() * (0.5f32).powi(22);
                prop_assert!(server.grown(lost_m).contains(place), "{:?}", place);
            }
            // The client's TBV is smaller by no more than rounding takes.
            let lost = (max - min) - (within.max - within.min);
            let bound_m = 0.01 + within.max.abs().max(within.min.abs()).max_element() * 1e-6;
            prop_assert!(lost.abs().max_element() < bound_m, "{lost}");
        }
    }

    #[test]
    fn positions_beyond_the_limits_are_refused() {
        let encode = |units: [i32; 3]| postcard::to_stdvec(&units).unwrap();
        let decode = |bytes: &[u8]| postcard::from_bytes::<WirePosition>(bytes);
        assert!(decode(&encode([0, COORDINATE_MAX, -COORDINATE_MAX])).is_ok());
        assert!(decode(&encode([0, COORDINATE_MAX + 1, 0])).is_err());
        assert!(decode(&encode([i32::MIN, 0, 0])).is_err());
    }
}
