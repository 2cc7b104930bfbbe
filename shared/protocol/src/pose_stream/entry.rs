//! Poses coded as differences from a baseline.

use crate::{
    DecodeError,
    quantise::{WirePose, WirePosition},
    varint,
};

/// Set when the x or z coordinate differs. Whatever no flag announces is as in the baseline.
pub const LEVEL_POSITION: u8 = 1;
const HEIGHT: u8 = 1 << 1;
const YAW: u8 = 1 << 2;
const PITCH: u8 = 1 << 3;
const LEVEL_VELOCITY: u8 = 1 << 4;
const CLIMB: u8 = 1 << 5;
/// Set when the distance to the baseline follows the id.
pub const BASELINE: u8 = 1 << 6;
/// Set when the rate of turn differs, or whether the body falls.
const RATES: u8 = 1 << 7;

/// The flags for the differences between a pose and its baseline.
pub fn flags(base: &WirePose, pose: &WirePose) -> u8 {
    let ([bx, by, bz], [x, y, z]) = (base.position.units(), pose.position.units());
    let ([bu, bv, bw], [u, v, w]) = (base.velocity, pose.velocity);
    let when = |differs: bool, flag: u8| if differs { flag } else { 0 };
    when((bx, bz) != (x, z), LEVEL_POSITION)
        | when(by != y, HEIGHT)
        | when(base.yaw != pose.yaw, YAW)
        | when(base.pitch != pose.pitch, PITCH)
        | when((bu, bw) != (u, w), LEVEL_VELOCITY)
        | when(bv != v, CLIMB)
        | when(rates(base) != rates(pose), RATES)
}

/// Appends the flags and then the differences.
pub fn write_difference(out: &mut Vec<u8>, base: &WirePose, pose: &WirePose) {
    let flags = flags(base, pose);
    out.push(flags);
    write_fields(out, flags, base, pose);
}

/// Appends the differences that flags announce.
pub fn write_fields(out: &mut Vec<u8>, flags: u8, base: &WirePose, pose: &WirePose) {
    let (from, to) = (base.position.units(), pose.position.units());
    for axis in position_axes(flags) {
        varint::write_signed(out, to[axis] - from[axis]);
    }
    if flags & YAW != 0 {
        varint::write_signed(out, pose.yaw.wrapping_sub(base.yaw).cast_signed().into());
    }
    if flags & PITCH != 0 {
        varint::write_signed(out, pose.pitch.wrapping_sub(base.pitch).into());
    }
    for axis in velocity_axes(flags) {
        varint::write_signed(out, pose.velocity[axis].wrapping_sub(base.velocity[axis]).into());
    }
    if flags & RATES != 0 {
        varint::write_signed(out, rates(pose) - rates(base));
    }
}

/// Takes the differences that flags announce off the front of some bytes.
pub fn read_difference(
    bytes: &mut &[u8],
    flags: u8,
    base: &WirePose,
) -> Result<WirePose, DecodeError> {
    if flags & BASELINE != 0 {
        return Err(DecodeError::Malformed);
    }
    let mut pose = *base;
    let mut position = base.position.units();
    for axis in position_axes(flags) {
        let difference = varint::read_signed(bytes)?;
        position[axis] = position[axis].checked_add(difference).ok_or(DecodeError::Malformed)?;
    }
    pose.position = WirePosition::new(position).ok_or(DecodeError::Malformed)?;
    if flags & YAW != 0 {
        pose.yaw = base.yaw.wrapping_add_signed(varint::read_signed_16(bytes)?);
    }
    if flags & PITCH != 0 {
        pose.pitch = base.pitch.wrapping_add(varint::read_signed_16(bytes)?);
    }
    for axis in velocity_axes(flags) {
        pose.velocity[axis] = base.velocity[axis].wrapping_add(varint::read_signed_16(bytes)?);
    }
    if flags & RATES != 0 {
        let rates = rates(base).checked_add(varint::read_signed(bytes)?);
        let rates = rates.ok_or(DecodeError::Malformed)?;
        pose.yaw_rate = i16::try_from(rates >> 1).map_err(|_| DecodeError::Malformed)?;
        pose.falls = rates & 1 == 1;
    }
    Ok(pose)
}

/// The rate of turn, and in the lowest bit whether the body falls.
fn rates(pose: &WirePose) -> i32 {
    i32::from(pose.yaw_rate) << 1 | i32::from(pose.falls)
}

fn position_axes(flags: u8) -> impl Iterator<Item = usize> {
    axes(flags & LEVEL_POSITION != 0, flags & HEIGHT != 0)
}

fn velocity_axes(flags: u8) -> impl Iterator<Item = usize> {
    axes(flags & LEVEL_VELOCITY != 0, flags & CLIMB != 0)
}

fn axes(level: bool, vertical: bool) -> impl Iterator<Item = usize> {
    (0..3).filter(move |&axis| if axis == 1 { vertical } else { level })
}
