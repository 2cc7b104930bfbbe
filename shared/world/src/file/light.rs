//! The section of the baked light: exposure, and the probes part by part, so that it packs well.

use glam::UVec3;

use super::{
    ReadError, list,
    reader::SectionReader,
    writer::{put_count, put_f32, put_u32, put_vec3},
};
use crate::light::{BakedLight, Probe, ProbeGrid};

const BAD: ReadError = ReadError::Malformed("the baked light");
/// The bytes of a probe.
const PROBE_BYTES: usize = 10;
/// Exposure and the brightest light lie between this and its inverse.
const SCALE_MIN: f32 = 1.0e-12;
/// The most points along an axis.
const SIDE_MAX: u32 = 1 << 20;
/// The least distance between probes, in metres.
const SPACING_MIN: f32 = 0.01;

/// A byte tells whether there is baked light, which follows. The places of probes are given as
/// steps from one to the next, and each byte of a probe as the difference from that of the one
/// before.
pub(super) fn to_bytes(light: Option<&BakedLight>) -> Vec<u8> {
    let Some(light) = light else { return vec![0] };
    let BakedLight { exposure, brightest, sky, grid } = light;
    assert_eq!(grid.places.len(), grid.probes.len(), "a probe for each place");
    let mut out = vec![1];
    put_f32(&mut out, *exposure);
    put_f32(&mut out, *brightest);
    out.push(u8::from(sky.is_some()));
    out.extend(sky.iter().flat_map(bytes_of));
    put_vec3(&mut out, grid.origin);
    put_f32(&mut out, grid.spacing);
    grid.size.to_array().into_iter().for_each(|count| put_u32(&mut out, count));
    put_count(&mut out, grid.places.len());
    let mut before = 0;
    for &place in &grid.places {
        put_u32(&mut out, place - before);
        before = place;
    }
    for part in 0..PROBE_BYTES {
        let mut before = 0u8;
        for probe in &grid.probes {
            let byte = bytes_of(probe)[part];
            out.push(byte.wrapping_sub(before));
            before = byte;
        }
    }
    out
}

pub(super) fn read(input: &mut SectionReader<'_>) -> Result<Option<BakedLight>, ReadError> {
    let light = match input.u8()? {
        0 => None,
        1 => Some(read_light(input)?),
        _ => return Err(BAD),
    };
    if input.is_empty() { Ok(light) } else { Err(BAD) }
}

fn read_light(input: &mut SectionReader<'_>) -> Result<BakedLight, ReadError> {
    let (exposure, brightest) = (scale(input)?, scale(input)?);
    let sky = match input.u8()? {
        0 => None,
        1 => Some(probe_of(input.take(PROBE_BYTES)?.try_into().map_err(|_| BAD)?)?),
        _ => return Err(BAD),
    };
    let (origin, spacing) = (input.vec3()?, input.f32()?);
    let size = UVec3::new(input.u32()?, input.u32()?, input.u32()?);
    let points: u64 = size.to_array().into_iter().map(u64::from).product();
    if size.max_element() > SIDE_MAX || points > u64::from(u32::MAX) || spacing < SPACING_MIN {
        return Err(BAD);
    }
    let count = input.count(4 + PROBE_BYTES)?;
    let mut places = list(count)?;
    let mut next: u64 = 0;
    for at in 0..count {
        let step = input.u32()?;
        next += u64::from(step);
        if next >= points || at > 0 && step == 0 {
            return Err(BAD);
        }
        places.push(next as u32);
    }
    let mut bytes = list::<[u8; PROBE_BYTES]>(count)?;
    bytes.resize(count, [0; PROBE_BYTES]);
    for part in 0..PROBE_BYTES {
        let mut before = 0u8;
        for (of, step) in bytes.iter_mut().zip(input.take(count)?) {
            before = before.wrapping_add(*step);
            of[part] = before;
        }
    }
    let mut probes = list(count)?;
    for of in bytes {
        probes.push(probe_of(of)?);
    }
    let grid = ProbeGrid { origin, spacing, size, places, probes };
    Ok(BakedLight { exposure, brightest, sky, grid })
}

fn scale(input: &mut SectionReader<'_>) -> Result<f32, ReadError> {
    let scale = input.f32()?;
    if (SCALE_MIN..=SCALE_MIN.recip()).contains(&scale) { Ok(scale) } else { Err(BAD) }
}

fn bytes_of(probe: &Probe) -> [u8; PROBE_BYTES] {
    let ([a, b, c, d, e, f], [red, green, blue]) = (probe.levels, probe.tint);
    [a, b, c, d, e, f, red, green, blue, probe.links]
}

fn probe_of(bytes: [u8; PROBE_BYTES]) -> Result<Probe, ReadError> {
    let [a, b, c, d, e, f, red, green, blue, links] = bytes;
    let probe = Probe { levels: [a, b, c, d, e, f], tint: [red, green, blue], links };
    if links < 8 { Ok(probe) } else { Err(BAD) }
}
