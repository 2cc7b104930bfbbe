//! The section of the movers: the name, mesh, colours and trajectory of each.

use glam::{DAffine3, DMat3, DVec3, Quat};

use super::{
    ReadError, TITLE_CHARS_MAX, list, mesh,
    reader::SectionReader,
    writer::{put_count, put_f32, put_f64, put_vec3},
};
use crate::{
    motion::trajectory::{JOINTS_MAX, Joint, KeyframeTrack, Playback, Trajectory},
    mover::{MOVER_TRIANGLES_MAX, MOVERS_MAX, Mover},
};

/// The least number of bytes of a mover: three counts, the playback, the length, and the number of
/// joints.
const MOVER_BYTES_MIN: usize = 18;

pub(super) fn to_bytes(movers: &[Mover]) -> Vec<u8> {
    let mut out = Vec::new();
    put_count(&mut out, movers.len());
    for mover in movers {
        let name: String = mover.name.chars().take(TITLE_CHARS_MAX).collect();
        put_count(&mut out, name.len());
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(&mesh::to_bytes(mover.mesh()));
        out.extend_from_slice(mover.colours().as_flattened());
        put_trajectory(&mut out, &mover.trajectory);
    }
    out
}

pub(super) fn read(input: &mut SectionReader) -> Result<Vec<Mover>, ReadError> {
    let count = input.count(MOVER_BYTES_MIN)?;
    if count > MOVERS_MAX {
        return Err(ReadError::Malformed("too many movers"));
    }
    let mut movers = list(count)?;
    let mut triangles = 0;
    for _ in 0..count {
        let mover = read_mover(input)?;
        triangles += mover.mesh().triangles.len();
        if triangles > MOVER_TRIANGLES_MAX {
            return Err(ReadError::Malformed("too many triangles of movers"));
        }
        movers.push(mover);
    }
    if input.is_empty() { Ok(movers) } else { Err(ReadError::Malformed("the movers")) }
}

fn read_mover(input: &mut SectionReader) -> Result<Mover, ReadError> {
    let length = input.count(1)?;
    let name =
        std::str::from_utf8(input.take(length)?).map_err(|_| ReadError::Malformed("a name"))?;
    if name.chars().count() > TITLE_CHARS_MAX {
        return Err(ReadError::Malformed("a name"));
    }
    let mesh = mesh::read(input)?;
    let colours = input.take(3 * mesh.triangles.len())?.as_chunks::<3>().0.to_vec();
    let trajectory = read_trajectory(input)?;
    Mover::new(name.to_owned(), mesh, colours, trajectory).ok_or(ReadError::Malformed("a mover"))
}

fn put_trajectory(out: &mut Vec<u8>, trajectory: &Trajectory) {
    out.push(match trajectory.playback() {
        Playback::Loop => 0,
        Playback::Once => 1,
        Playback::Triggered => 2,
    });
    put_f32(out, trajectory.length_s());
    out.push(trajectory.joints().len() as u8);
    for joint in trajectory.joints() {
        joint.frame.to_cols_array().into_iter().for_each(|value| put_f64(out, value));
        put_track(out, &joint.translation, put_vec3);
        put_track(out, &joint.rotation, |out, value| {
            value.to_array().into_iter().for_each(|part| put_f32(out, part));
        });
        put_track(out, &joint.scale, put_vec3);
    }
}

fn read_trajectory(input: &mut SectionReader) -> Result<Trajectory, ReadError> {
    let playback = match input.u8()? {
        0 => Playback::Loop,
        1 => Playback::Once,
        2 => Playback::Triggered,
        _ => return Err(ReadError::Malformed("the playback of a mover")),
    };
    let length_s = input.f32()?;
    let count = usize::from(input.u8()?);
    if count > JOINTS_MAX {
        return Err(ReadError::Malformed("the joints of a mover"));
    }
    let joints = (0..count).map(|_| read_joint(input)).collect::<Result<_, _>>()?;
    let bad = |_| ReadError::Malformed("the trajectory of a mover");
    Trajectory::new(joints, length_s, playback).map_err(bad)
}

fn read_joint(input: &mut SectionReader) -> Result<Joint, ReadError> {
    let mut column =
        || -> Result<DVec3, ReadError> { Ok(DVec3::new(input.f64()?, input.f64()?, input.f64()?)) };
    let matrix3 = DMat3::from_cols(column()?, column()?, column()?);
    let frame = DAffine3 { matrix3, translation: column()? };
    Ok(Joint {
        frame,
        translation: read_track(input, 16, |input| input.vec3())?,
        rotation: read_track(input, 20, |input| {
            Ok(Quat::from_xyzw(input.f32()?, input.f32()?, input.f32()?, input.f32()?))
        })?,
        scale: read_track(input, 16, |input| input.vec3())?,
    })
}

fn put_track<V: Copy>(out: &mut Vec<u8>, track: &KeyframeTrack<V>, put: impl Fn(&mut Vec<u8>, V)) {
    out.push(track.steps.into());
    put_count(out, track.keys.len());
    for &(at_s, value) in &track.keys {
        put_f32(out, at_s);
        put(out, value);
    }
}

fn read_track<V>(
    input: &mut SectionReader,
    key_bytes: usize,
    read: impl Fn(&mut SectionReader) -> Result<V, ReadError>,
) -> Result<KeyframeTrack<V>, ReadError> {
    let steps = match input.u8()? {
        0 => false,
        1 => true,
        _ => return Err(ReadError::Malformed("the keys of a mover")),
    };
    let count = input.count(key_bytes)?;
    let keys: Result<_, ReadError> = (0..count).map(|_| Ok((input.f32()?, read(input)?))).collect();
    Ok(KeyframeTrack { keys: keys?, steps })
}
