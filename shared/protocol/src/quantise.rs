//! Conversions between domain types and wire types. Every wire value converts to finite numbers.

use std::{
    f32::consts::{FRAC_PI_2, PI, TAU},
    time::Duration,
};

use glam::Vec3;
use serde::{Deserialize, Serialize};
use sightline_world::{
    geometry::{Aabb, Axes},
    motion::{COURSE_MAX, FREE_FALL, Pose, Report, Tbv, Tolerance},
    tolerance::WIRE_UNITS_PER_METRE,
};

/// Positions on the wire are in 512ths of a metre, about 2 mm.
pub const UNITS_PER_METRE: f32 = WIRE_UNITS_PER_METRE;
/// Velocities on the wire are in 128ths of a metre per second.
pub const SPEED_UNITS: f32 = 128.0;
/// The unit of turns of axes on the wire, in radians: 2⁻³² of a full turn.
const TURN_UNIT: f64 = std::f64::consts::TAU / 4_294_967_296.0;
/// Rates of turn on the wire are in 1,024ths of a full turn per second.
const TURN_RATE_UNITS: f32 = 1_024.0;
/// How far a unit of velocity leads in a second, in units of positions.
const UNITS_OF_WAY: i64 = (UNITS_PER_METRE / SPEED_UNITS) as i64;
/// How far a unit of turn rates leads in a second, in units of yaw.
const UNITS_OF_YAW: i64 = 65_536 / TURN_RATE_UNITS as i64;
/// How much faster a falling body is after a second, in units of velocity.
const FALL_UNITS: i64 = (FREE_FALL * SPEED_UNITS) as i64;
/// Times of reports on the wire are in 64ths of a tick.
const TICK_PARTS: u32 = 64;
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
    /// How fast the yaw grows, in 1,024ths of a full turn per second.
    pub yaw_rate: i16,
    /// Whether the body falls freely.
    pub falls: bool,
}

impl WirePose {
    /// Where an avatar with this pose is after a time, if it keeps its velocity, or falls. All
    /// arithmetic is in integers, so that both ends agree.
    #[must_use]
    pub fn straight_on(&self, elapsed: Duration) -> Self {
        let elapsed_us = elapsed.min(COURSE_MAX).as_micros() as i64;
        let moved = |rate: i16, units: i64| i64::from(rate) * units * elapsed_us / 1_000_000;
        let limit = i64::from(COORDINATE_MAX);
        let mut units = self.position.0;
        for (unit, speed) in units.iter_mut().zip(self.velocity) {
            let at = i64::from(*unit) + moved(speed, UNITS_OF_WAY);
            *unit = at.clamp(-limit, limit) as i32;
        }
        let mut velocity = self.velocity;
        if self.falls {
            let faster = FALL_UNITS * elapsed_us / 1_000_000;
            let deeper = faster * UNITS_OF_WAY / 2 * elapsed_us / 1_000_000;
            units[1] = (i64::from(units[1]) - deeper).clamp(-limit, limit) as i32;
            let [_, climb, _] = &mut velocity;
            *climb = (i64::from(*climb) - faster).max(i16::MIN.into()) as i16;
        }
        let yaw = self.yaw.wrapping_add(moved(self.yaw_rate, UNITS_OF_YAW) as u16);
        Self { position: WirePosition(units), yaw, velocity, ..*self }
    }
}

impl From<&Pose> for WirePose {
    fn from(pose: &Pose) -> Self {
        let turn = (pose.yaw / TAU).rem_euclid(1.0) * 65_536.0;
        Self {
            position: pose.eye.into(),
            yaw: turn.round() as u32 as u16,
            pitch: ((pose.pitch / FRAC_PI_2).clamp(-1.0, 1.0) * 32_767.0).round() as i16,
            velocity: pose.velocity.to_array().map(|v| (v * SPEED_UNITS).round() as i16),
            yaw_rate: (pose.yaw_rate / TAU * TURN_RATE_UNITS).round() as i16,
            falls: pose.falls,
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
            yaw_rate: f32::from(wire.yaw_rate) / TURN_RATE_UNITS * TAU,
            falls: wire.falls,
        }
    }
}

/// A quantised report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WireReport {
    /// When it was made on the client's clock, in 64ths of a tick.
    pub made: u32,
    /// How many orders the client had received.
    pub orders: u32,
    /// The pose.
    pub pose: WirePose,
}

impl WireReport {
    /// A time of the client's clock as [`WireReport::made`] has it, at a server with this time from
    /// tick to tick.
    pub fn made_at(time: Duration, tick: Duration) -> u32 {
        let parts = time.as_nanos() * u128::from(TICK_PARTS) / tick.as_nanos().max(1);
        u32::try_from(parts).unwrap_or(u32::MAX)
    }

    /// A report to a server with this time between ticks.
    pub fn new(report: &Report, tick: Duration) -> Self {
        let made = Self::made_at(report.made, tick);
        Self { made, orders: report.orders, pose: (&report.pose).into() }
    }

    /// The report at a server with this time between ticks.
    pub fn report(&self, tick: Duration) -> Report {
        let nanos = tick.as_nanos() * u128::from(self.made) / u128::from(TICK_PARTS);
        let made = Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX));
        Report { made, orders: self.orders, pose: self.pose.into() }
    }
}

/// A quantised tolerance. It is never larger than the server's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireTolerance {
    /// In millimetres.
    pub millimetres: u16,
    /// In 255ths of half a turn.
    pub angle: u8,
    /// The time ahead, in milliseconds.
    pub ahead_ms: u16,
}

impl From<&Tolerance> for WireTolerance {
    fn from(tolerance: &Tolerance) -> Self {
        Self {
            millimetres: (tolerance.metres * 1_000.0).floor() as u16,
            angle: (tolerance.radians / PI * 255.0).floor() as u8,
            ahead_ms: tolerance.ahead.as_micros().div_ceil(1_000).try_into().unwrap_or(u16::MAX),
        }
    }
}

impl From<WireTolerance> for Tolerance {
    fn from(wire: WireTolerance) -> Self {
        Self {
            metres: f32::from(wire.millimetres) / 1_000.0,
            radians: f32::from(wire.angle) / 255.0 * PI,
            ahead: Duration::from_millis(u64::from(wire.ahead_ms)),
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
        (proptest::array::uniform3(unit), any::<u16>(), -32_767i16.., any::<([i16; 4], bool)>())
            .prop_map(|(units, yaw, pitch, ([x, y, z, yaw_rate], falls))| WirePose {
                position: WirePosition::new(units).unwrap(),
                yaw,
                pitch,
                velocity: [x, y, z],
                yaw_rate,
                falls,
            })
    }

    /// Checks that a pose leads to nearly the same one on the wire and off it.
    fn check_straight_on(pose: &Pose, elapsed: Duration) {
        let wire = WirePose::from(pose);
        let [pose, wire] =
            [Pose::from(wire).straight_on(elapsed), wire.straight_on(elapsed).into()];
        let error_m = 0.01 + 0.01 * elapsed.as_secs_f32().powi(2);
        assert!(pose.eye.distance(wire.eye) < error_m, "{} {}", pose.eye, wire.eye);
        assert!(pose.velocity.distance(wire.velocity) < 0.06);
        assert!(pose.forward().distance(wire.forward()) < 5e-4);
    }

    #[test]
    fn bodies_fall_as_fast_on_the_wire() {
        for (velocity, elapsed_ms) in
            [(Vec3::ZERO, 2_243), (Vec3::new(-14.776858, -24.608826, -6.4499025), 643)]
        {
            let pose = Pose { velocity, falls: true, ..Pose::default() };
            check_straight_on(&pose, Duration::from_millis(elapsed_ms));
        }
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
            yaw_rate in -100f32..100.0,
            falls: bool,
        ) {
            let (eye, velocity) = (eye.into(), velocity.into());
            let pose = Pose { eye, yaw, pitch, velocity, yaw_rate, falls };
            let back = Pose::from(WirePose::from(&pose));
            prop_assert!(back.eye.distance(pose.eye) < 0.002);
            prop_assert!(back.forward().distance(pose.forward()) < 2e-4);
            prop_assert!(back.velocity.distance(pose.velocity) < 0.01);
            prop_assert!((back.yaw_rate - pose.yaw_rate).abs() < 0.004);
        }

        #[test]
        fn straight_on_is_the_same_on_the_wire(
            eye in proptest::array::uniform3(-900f32..900.0),
            velocity in proptest::array::uniform3(-30f32..30.0),
            yaw_rate in -9f32..9.0,
            elapsed_ms in 0u64..5_000,
            falls: bool,
        ) {
            let (eye, velocity) = (eye.into(), velocity.into());
            let pose = Pose { eye, velocity, yaw_rate, falls, ..Pose::default() };
            check_straight_on(&pose, Duration::from_millis(elapsed_ms));
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
                yaw_rate: f32::from_bits(speed),
                falls: false,
            };
            prop_assert!(Pose::from(WirePose::from(&pose)).is_finite());
        }

        #[test]
        fn a_clients_tolerance_is_at_most_the_servers(
            metres in 0f32..10.0,
            radians in 0f32..4.0,
            ahead_us in 0u64..2_000_000,
        ) {
            let server = Tolerance { metres, radians, ahead: Duration::from_micros(ahead_us) };
            let client = Tolerance::from(WireTolerance::from(&server));
            prop_assert!(client.metres <= metres + 1e-6 && client.metres > metres - 0.0011);
            prop_assert!(client.radians <= radians && client.ahead >= server.ahead);
        }

        #[test]
        fn reports_made_at_ticks_are_so_on_the_wire(tick in 0u32..1_000_000, tick_us in 1_000u32..100_000) {
            let interval = Duration::from_micros(tick_us.into());
            let report = Report { made: interval * tick, orders: 7, pose: Pose::default() };
            let wire = WireReport::new(&report, interval);
            prop_assert_eq!(wire.report(interval), report);
            let next = Report { made: report.made + interval / 64 + Duration::from_nanos(1), ..report };
            prop_assert!(WireReport::new(&next, interval).made > wire.made);
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
