//! The sections that serde writes: the meta section (title, body, speed limit, spawn points) and
//! the rooms.

use serde::{Deserialize, Serialize};

use super::{ReadError, TITLE_CHARS_MAX, reader::SectionReader};
use crate::{
    motion::{Body, Spawn},
    rooms::Rooms,
    world::World,
};

/// The longest section of rooms, in bytes. Read rooms take at most thirty times as much memory.
const ROOMS_BYTES_MAX: usize = 1 << 25;

/// The most spawn points.
const SPAWNS_MAX: usize = 1 << 16;

/// What the meta section holds.
#[derive(Serialize, Deserialize)]
pub(super) struct Meta {
    pub(super) title: String,
    pub(super) body: Body,
    pub(super) speed_max: f32,
    pub(super) spawns: Vec<Spawn>,
}

pub(super) fn meta_bytes(world: &World) -> Vec<u8> {
    let meta = Meta {
        title: world.title.chars().take(TITLE_CHARS_MAX).collect(),
        body: world.body,
        speed_max: world.speed_max,
        spawns: world.spawns.clone(),
    };
    postcard::to_stdvec(&meta).expect("plain data always encodes")
}

pub(super) fn read_meta(input: &mut SectionReader) -> Result<Meta, ReadError> {
    let (meta, rest): (Meta, _) = postcard::take_from_bytes(input.rest())
        .map_err(|_| ReadError::Malformed("the meta section"))?;
    let Body { half_width, above_eye, below_eye } = meta.body;
    let body_sane = [half_width, above_eye, below_eye].iter().all(|m| (0.0..=100.0).contains(m));
    let speed_sane = meta.speed_max > 0.0 && meta.speed_max <= 1_000.0;
    let title_sane = meta.title.chars().count() <= TITLE_CHARS_MAX;
    if !(rest.is_empty() && body_sane && speed_sane && title_sane) {
        return Err(ReadError::Malformed("the meta section"));
    }
    if meta.spawns.len() > SPAWNS_MAX {
        return Err(ReadError::Malformed("too many spawn points"));
    }
    if meta.spawns.is_empty() {
        return Err(ReadError::Malformed("no spawn point"));
    }
    if !meta.spawns.iter().all(|s| s.eye.is_finite() && s.yaw.is_finite()) {
        return Err(ReadError::Malformed("a spawn point"));
    }
    Ok(meta)
}

pub(super) fn rooms_bytes(rooms: &Rooms) -> Vec<u8> {
    postcard::to_stdvec(rooms).expect("plain data always encodes")
}

/// Reads rooms that refer to existing cells and movers. Deserialization checks everything else.
pub(super) fn read_rooms(
    input: &SectionReader,
    cells: usize,
    movers: usize,
) -> Result<Rooms, ReadError> {
    if input.len() > ROOMS_BYTES_MAX {
        return Err(ReadError::Malformed("too many rooms"));
    }
    let (rooms, rest): (Rooms, _) =
        postcard::take_from_bytes(input.rest()).map_err(|_| ReadError::Malformed("the rooms"))?;
    if rest.is_empty() && rooms.fits(cells, movers) {
        Ok(rooms)
    } else {
        Err(ReadError::Malformed("the rooms"))
    }
}
