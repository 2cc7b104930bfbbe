//! The world file (`.slw`): a header, then one zstd frame of sections.
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..4 | magic, `SLW` and a line feed, so that a text-mode transfer shows |
//! | 4..8 | version, little-endian, as is all else |
//! | 8..40 | content id: BLAKE3 of all that follows |
//! | 40..48 | length of the sections, unpacked |
//! | 48.. | zstd frame |
//!
//! A section is a tag of four letters, a length, and that many bytes. The reader survives any
//! bytes: the content id is checked before anything is unpacked, and since whoever made a hostile
//! file can also hash it, every count is checked against what is left before memory is taken, and
//! every index before it is stored.

mod cells;
mod movers;

use std::{fs, io, io::Read, path::Path};

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::{Mesh, Spawn, World, origin};
use crate::{
    geometry::Aabb,
    motion::Body,
    octree::{Octree, OctreeError},
    rooms::Rooms,
    tolerance::UNIT_F64,
};

const MAGIC: [u8; 4] = *b"SLW\n";
const VERSION: u32 = 6;
const HEADER_BYTES: usize = 48;
/// Unpacked, no world is larger: 2 GiB.
const UNPACKED_BYTES_MAX: u64 = 1 << 31;
/// What rooms may take; at most thirty times that once read.
const ROOMS_BYTES_MAX: usize = 1 << 25;
const TITLE_CHARS_MAX: usize = 200;
const ZSTD_LEVEL: i32 = 6;

/// Names a world by what is in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ContentId(pub [u8; 32]);

impl std::fmt::Display for ContentId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", blake3::Hash::from_bytes(self.0).to_hex())
    }
}

/// Why some bytes are not a world.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Which.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// It begins with something else.
    #[error("this is not a Sightline world (.slw)")]
    NotAWorld,
    /// Another version of Sightline made it.
    #[error("world file version {found}, but this program reads version {VERSION}; compile again")]
    Version {
        /// What the file says.
        found: u32,
    },
    /// Bytes were lost or changed since it was written.
    #[error("the world file is damaged: its content does not match its content id")]
    Damaged,
    /// It was made to harm, or by a faulty program.
    #[error("the world file is malformed: {0}")]
    Malformed(&'static str),
    /// Likewise, in the voxels.
    #[error("the world file is malformed: {0}")]
    Octree(#[from] OctreeError),
}

impl World {
    /// The bytes of the world file. Equal worlds give equal bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut sections = Vec::new();
        section(&mut sections, b"META", &meta_bytes(self));
        section(&mut sections, b"OCTR", &self.octree.to_bytes());
        section(&mut sections, b"CELL", &cells::cells_bytes(&self.cells));
        section(&mut sections, b"PVSS", &cells::pvs_bytes(&self.cells));
        section(&mut sections, b"MESH", &mesh_bytes(&self.mesh));
        section(&mut sections, b"MOVR", &movers::to_bytes(&self.movers));
        section(&mut sections, b"ROOM", &rooms_bytes(&self.rooms));
        section(&mut sections, b"ORIG", &origin::to_bytes(self.origin.as_ref()));
        let packed = zstd::bulk::compress(&sections, ZSTD_LEVEL)
            .expect("zstd into memory fails only when memory runs out");
        let mut hashed = (sections.len() as u64).to_le_bytes().to_vec();
        hashed.extend_from_slice(&packed);
        let mut file = Vec::with_capacity(HEADER_BYTES + packed.len());
        file.extend_from_slice(&MAGIC);
        file.extend_from_slice(&VERSION.to_le_bytes());
        file.extend_from_slice(blake3::hash(&hashed).as_bytes());
        file.extend_from_slice(&hashed);
        file
    }

    /// Reads the bytes of a world file.
    ///
    /// # Errors
    /// When they are not a whole, valid world.
    pub fn from_bytes(file: &[u8]) -> Result<Self, ReadError> {
        content_id(file)?;
        let (length, packed) = file[HEADER_BYTES - 8..].split_at(8);
        let length = u64::from_le_bytes(length.try_into().expect("split at eight"));
        let sections = unpack(packed, length)?;
        let mut input = SectionReader(&sections);
        let world = read_sections(&mut input)?;
        if !input.0.is_empty() {
            return Err(ReadError::Malformed("bytes after the last section"));
        }
        Ok(world)
    }

    /// Reads a world file.
    ///
    /// # Errors
    /// When it cannot be read or is not a whole, valid world.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let io = |source| ReadError::Io { path: path.display().to_string(), source };
        Self::from_bytes(&fs::read(path).map_err(io)?)
    }

    /// Writes a world file: whole, or not at all.
    ///
    /// # Errors
    /// When the file system refuses.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write_whole(path, &self.to_bytes())
    }
}

/// Writes a file under another name first, so that a crash leaves the old one or the new one. A link
/// is followed; what is there and no file, such as a device, is left alone.
///
/// # Errors
/// When the file system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(io::Error::other("it is there, and it is no file"));
    }
    let mut partial = path.as_os_str().to_owned();
    partial.push(format!(".{}.partial", std::process::id()));
    let partial = Path::new(&partial);
    fs::write(partial, bytes).and_then(|()| fs::rename(partial, path)).inspect_err(|_| {
        // The first error is the one to tell.
        let _ = fs::remove_file(partial);
    })
}

/// The content id of a world file, once header and content agree.
///
/// # Errors
/// When it is no world file, of another version, or damaged.
pub fn content_id(file: &[u8]) -> Result<ContentId, ReadError> {
    if file.len() < 4 || file[..4] != MAGIC {
        return Err(ReadError::NotAWorld);
    }
    if file.len() < HEADER_BYTES {
        return Err(ReadError::Damaged);
    }
    let found = u32::from_le_bytes(file[4..8].try_into().expect("four bytes"));
    if found != VERSION {
        return Err(ReadError::Version { found });
    }
    let id: [u8; 32] = file[8..40].try_into().expect("thirty-two bytes");
    if blake3::hash(&file[40..]) != blake3::Hash::from_bytes(id) {
        return Err(ReadError::Damaged);
    }
    Ok(ContentId(id))
}

fn unpack(packed: &[u8], length: u64) -> Result<Vec<u8>, ReadError> {
    if length > UNPACKED_BYTES_MAX {
        return Err(ReadError::Malformed("larger than any world may be"));
    }
    let bad = |_| ReadError::Malformed("the zstd frame");
    let mut sections = Vec::new();
    zstd::stream::Decoder::with_buffer(packed)
        .map_err(bad)?
        .take(length + 1)
        .read_to_end(&mut sections)
        .map_err(bad)?;
    if sections.len() as u64 != length {
        return Err(ReadError::Malformed("the unpacked length"));
    }
    Ok(sections)
}

fn read_sections(input: &mut SectionReader) -> Result<World, ReadError> {
    let meta = read_meta(&mut input.section(b"META")?)?;
    let octree = Octree::from_bytes(input.section(b"OCTR")?.0)?;
    let mut cells = cells::read_cells(&mut input.section(b"CELL")?)?;
    cells.pvs = cells::read_pvs(&mut input.section(b"PVSS")?, cells.cells.len())?;
    let mesh = read_mesh(&mut input.section(b"MESH")?)?;
    let movers = movers::read(&mut input.section(b"MOVR")?)?;
    let rooms = read_rooms(&input.section(b"ROOM")?, cells.cells.len(), movers.len())?;
    let origin = origin::read(&mut input.section(b"ORIG")?)?;
    let Meta { title, body, speed_max, spawns } = meta;
    Ok(World { title, octree, cells, mesh, movers, rooms, spawns, body, speed_max, origin })
}

#[derive(Serialize, Deserialize)]
struct Meta {
    title: String,
    body: Body,
    speed_max: f32,
    spawns: Vec<Spawn>,
}

fn meta_bytes(world: &World) -> Vec<u8> {
    let meta = Meta {
        title: world.title.chars().take(TITLE_CHARS_MAX).collect(),
        body: world.body,
        speed_max: world.speed_max,
        spawns: world.spawns.clone(),
    };
    postcard::to_stdvec(&meta).expect("plain data always encodes")
}

fn read_meta(input: &mut SectionReader) -> Result<Meta, ReadError> {
    let (meta, rest): (Meta, _) =
        postcard::take_from_bytes(input.0).map_err(|_| ReadError::Malformed("the title page"))?;
    let Body { half_width, above_eye, below_eye } = meta.body;
    let body_sane = [half_width, above_eye, below_eye].iter().all(|m| (0.0..=100.0).contains(m));
    let speed_sane = meta.speed_max > 0.0 && meta.speed_max <= 1_000.0;
    let title_sane = meta.title.chars().count() <= TITLE_CHARS_MAX;
    if !(rest.is_empty() && body_sane && speed_sane && title_sane) {
        return Err(ReadError::Malformed("the title page"));
    }
    if meta.spawns.is_empty() {
        return Err(ReadError::Malformed("no spawn point"));
    }
    if !meta.spawns.iter().all(|s| s.eye.is_finite() && s.yaw.is_finite()) {
        return Err(ReadError::Malformed("a spawn point"));
    }
    Ok(meta)
}

fn rooms_bytes(rooms: &Rooms) -> Vec<u8> {
    postcard::to_stdvec(rooms).expect("plain data always encodes")
}

/// Rooms are checked as they are made; here whether the cells and movers that they name are there.
fn read_rooms(input: &SectionReader, cells: usize, movers: usize) -> Result<Rooms, ReadError> {
    if input.len() > ROOMS_BYTES_MAX {
        return Err(ReadError::Malformed("too many rooms"));
    }
    let (rooms, rest): (Rooms, _) =
        postcard::take_from_bytes(input.0).map_err(|_| ReadError::Malformed("the rooms"))?;
    if rest.is_empty() && rooms.fits(cells, movers) {
        Ok(rooms)
    } else {
        Err(ReadError::Malformed("the rooms"))
    }
}

fn mesh_bytes(mesh: &Mesh) -> Vec<u8> {
    let mut out = Vec::new();
    put_u32(&mut out, mesh.positions.len() as u32);
    mesh.positions.iter().for_each(|&p| put_vec3(&mut out, p));
    put_u32(&mut out, mesh.triangles.len() as u32);
    mesh.triangles.iter().flatten().for_each(|&i| put_u32(&mut out, i));
    out
}

fn read_mesh(input: &mut SectionReader) -> Result<Mesh, ReadError> {
    let count = input.count(12)?;
    let positions = (0..count).map(|_| input.vec3()).collect::<Result<Vec<_>, _>>()?;
    let count = input.count(12)?;
    let mut triangles = Vec::with_capacity(count);
    for _ in 0..count {
        let triangle = [input.u32()?, input.u32()?, input.u32()?];
        if triangle.iter().any(|&i| i as usize >= positions.len()) {
            return Err(ReadError::Malformed("a triangle"));
        }
        triangles.push(triangle);
    }
    Ok(Mesh { positions, triangles })
}

fn section(out: &mut Vec<u8>, tag: &[u8; 4], bytes: &[u8]) {
    out.extend_from_slice(tag);
    out.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
    out.extend_from_slice(bytes);
}

pub(crate) fn put_u32(out: &mut Vec<u8>, value: u32) {
    out.extend_from_slice(&value.to_le_bytes());
}

fn put_f32(out: &mut Vec<u8>, value: f32) {
    out.extend_from_slice(&value.to_le_bytes());
}

fn put_f64(out: &mut Vec<u8>, value: f64) {
    out.extend_from_slice(&value.to_le_bytes());
}

pub(crate) fn put_vec3(out: &mut Vec<u8>, value: Vec3) {
    value.to_array().into_iter().for_each(|c| put_f32(out, c));
}

pub(crate) fn put_aabb(out: &mut Vec<u8>, value: &Aabb) {
    put_vec3(out, value.min);
    put_vec3(out, value.max);
}

/// What is left to read.
pub(super) struct SectionReader<'a>(&'a [u8]);

impl<'a> SectionReader<'a> {
    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], ReadError> {
        let (head, rest) =
            self.0.split_at_checked(length).ok_or(ReadError::Malformed("it ends too soon"))?;
        self.0 = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        Ok(self.take(N)?.try_into().expect("as many as taken"))
    }

    fn section(&mut self, tag: &[u8; 4]) -> Result<Self, ReadError> {
        if &self.array::<4>()? != tag {
            return Err(ReadError::Malformed("a section is missing"));
        }
        let length = u64::from_le_bytes(self.array()?);
        let length = usize::try_from(length).map_err(|_| ReadError::Malformed("a length"))?;
        self.take(length).map(Self)
    }

    /// A number of records, each of which takes `record_bytes` of what is left.
    pub(super) fn count(&mut self, record_bytes: usize) -> Result<usize, ReadError> {
        let count = self.u32()? as usize;
        if count > self.0.len() / record_bytes {
            return Err(ReadError::Malformed("a count"));
        }
        Ok(count)
    }

    pub(super) fn u8(&mut self) -> Result<u8, ReadError> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, ReadError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn f64(&mut self) -> Result<f64, ReadError> {
        let value = f64::from_le_bytes(self.array()?);
        if value.abs() <= 1e8 { Ok(value) } else { Err(ReadError::Malformed("a number")) }
    }

    /// How many bytes are left.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn f32(&mut self) -> Result<f32, ReadError> {
        let value = f32::from_le_bytes(self.array()?);
        // A hundred thousand kilometres is farther than any building, and safe to square.
        if value.abs() <= 1e8 { Ok(value) } else { Err(ReadError::Malformed("a number")) }
    }

    /// A vector of unit length.
    fn direction(&mut self) -> Result<DVec3, ReadError> {
        let value = DVec3::new(self.f64()?, self.f64()?, self.f64()?);
        let is_unit = (value.length_squared() - 1.0).abs() < UNIT_F64;
        if is_unit { Ok(value) } else { Err(ReadError::Malformed("a direction")) }
    }

    pub(super) fn vec3(&mut self) -> Result<Vec3, ReadError> {
        Ok(Vec3::new(self.f32()?, self.f32()?, self.f32()?))
    }

    pub(super) fn aabb(&mut self) -> Result<Aabb, ReadError> {
        let value = Aabb::new(self.vec3()?, self.vec3()?);
        if value.is_empty() { Err(ReadError::Malformed("a box")) } else { Ok(value) }
    }
}

#[cfg(test)]
mod tests;
