//! The world file (`.slw`): a header, then one zstd frame of sections.
//!
//! | bytes | content |
//! | --- | --- |
//! | 0..4 | magic: `SLW` and a line feed, so that a text-mode transfer is noticed |
//! | 4..8 | version, little-endian like every number |
//! | 8..40 | content id: BLAKE3 of all bytes that follow |
//! | 40..48 | unpacked length of the sections, in bytes |
//! | 48.. | the zstd frame |
//!
//! A section is a tag of four letters, the number of its bytes, and these bytes. The reader
//! survives any bytes. It checks the content id before it unpacks anything. Since an attacker can
//! compute the content id of a hostile file, it also checks every count against the bytes that are
//! left before it takes memory, and every index before it stores it.

mod cells;
mod light;
mod mesh;
mod meta;
mod movers;
mod origin;
mod pieces;
mod reader;
#[cfg(test)]
mod tests;
mod whole;
mod writer;

use std::{fs, io, io::Read, path::Path};

use meta::Meta;
use pieces::HEAD_VERSION;
pub use pieces::{PieceId, Viewpoints, WorldHead, WorldPieces};
use reader::SectionReader;
pub use whole::write_whole;
use writer::section;

use crate::{
    octree::{Octree, OctreeError},
    packing::{self, Unpacker},
    world::World,
};

const MAGIC: [u8; 4] = *b"SLW\n";
const VERSION: u32 = 7;
const HEADER_BYTES: usize = 48;
/// The greatest unpacked length of a world: 2 GiB.
const UNPACKED_BYTES_MAX: u64 = 1 << 31;
/// The sections of a world take this many times the bytes of its file at most. Those of buildings
/// take less than ten times.
const UNPACKED_PER_BYTE: u64 = 64;
/// The sections of a small world may take this, however small its file: 1 MiB.
const UNPACKED_BYTES_SMALL: u64 = 1 << 20;
/// The greatest number of characters of a title or of a mover's name.
const TITLE_CHARS_MAX: usize = 200;
/// Higher levels take much longer and gain little.
const ZSTD_LEVEL: i32 = 6;

/// The content id of a world: the BLAKE3 hash of its file after the header's first 40 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ContentId(pub [u8; 32]);

impl std::fmt::Display for ContentId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", blake3::Hash::from_bytes(self.0).to_hex())
    }
}

/// Why a world cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The path of the file.
        path: String,
        /// The system's reason.
        source: io::Error,
    },
    /// The bytes do not begin with the magic number.
    #[error("this is not a Sightline world (.slw)")]
    NotAWorld,
    /// The file has the version of another Sightline.
    #[error("world file version {found}, but this program reads version {VERSION}; compile again")]
    Version {
        /// The version in the file.
        found: u32,
    },
    /// The head has the version of another Sightline.
    #[error(
        "the head of a world has version {found}, but this program reads version {HEAD_VERSION}"
    )]
    HeadVersion {
        /// The version in the head.
        found: u32,
    },
    /// The content does not match the content id: bytes were lost or changed.
    #[error("the world file is damaged: its content does not match its content id")]
    Damaged,
    /// A section is invalid, although the content id matches: the file is hostile, or a faulty
    /// program wrote it.
    #[error("the world file is malformed: {0}")]
    Malformed(&'static str),
    /// The system gives no memory for it.
    #[error("there is no memory for the {bytes} bytes that a part of the world takes")]
    Memory {
        /// What was asked for, in bytes.
        bytes: usize,
    },
    /// The section of the octree is invalid, although the content id matches.
    #[error("the world file is malformed: {0}")]
    Octree(#[from] OctreeError),
}

/// Whether a file that begins with these bytes is a world, of any version.
pub fn is_world_file(begins: &[u8]) -> bool {
    begins.starts_with(&MAGIC)
}

impl World {
    /// The bytes of the world file. Equal worlds give equal bytes on all native platforms.
    pub fn to_bytes(&self) -> Vec<u8> {
        debug_assert_eq!(self.cells.pvs.len(), self.cells.cells.len(), "a row for each cell");
        debug_assert!(!self.spawns.is_empty(), "no reader takes a world without a spawn point");
        let mut sections = Vec::new();
        section(&mut sections, b"META", &meta::meta_bytes(self));
        section(&mut sections, b"OCTR", &self.octree.to_bytes());
        section(&mut sections, b"CELL", &cells::cells_bytes(&self.cells));
        section(&mut sections, b"PVSS", &cells::pvs_bytes(&self.cells));
        section(&mut sections, b"MESH", &mesh::to_bytes(&self.mesh));
        section(&mut sections, b"MOVR", &movers::to_bytes(&self.movers));
        section(&mut sections, b"ROOM", &meta::rooms_bytes(&self.rooms));
        section(&mut sections, b"LGHT", &light::to_bytes(self.light.as_ref()));
        section(&mut sections, b"ORIG", &origin::to_bytes(self.origin.as_ref()));
        debug_assert!(sections.len() as u64 <= UNPACKED_BYTES_MAX, "no reader would take it");
        let packed = packing::pack(&sections, ZSTD_LEVEL);
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
    /// When they are not one whole, valid world.
    pub fn from_bytes(file: &[u8]) -> Result<Self, ReadError> {
        content_id(file)?;
        let (length, packed) = file[HEADER_BYTES - 8..].split_at(8);
        let length = u64::from_le_bytes(length.try_into().expect("split at eight"));
        let sections = unpack(packed, length)?;
        let mut input = SectionReader::new(&sections);
        let world = read_sections(&mut input)?;
        if !input.is_empty() {
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

    /// Writes a world file whole or not at all.
    ///
    /// # Errors
    /// When the file system refuses.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write_whole(path, &self.to_bytes())
    }
}

/// The content id of the bytes of a world file. It checks that the content matches.
///
/// # Errors
/// When the bytes are not a world file, have another version, or are damaged.
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
    if length > UNPACKED_BYTES_SMALL + UNPACKED_PER_BYTE * packed.len() as u64 {
        return Err(ReadError::Malformed("it unpacks to more than a file of its size may"));
    }
    let bad = |_| ReadError::Malformed("the zstd frame");
    // One byte more shows that there is more.
    let mut sections = list(length as usize + 1)?;
    Unpacker::new(packed).map_err(bad)?.take(length + 1).read_to_end(&mut sections).map_err(bad)?;
    if sections.len() as u64 != length {
        return Err(ReadError::Malformed("the unpacked length"));
    }
    Ok(sections)
}

/// An empty list with memory for a number of items.
fn list<T>(count: usize) -> Result<Vec<T>, ReadError> {
    let mut list = Vec::new();
    let bytes = count.saturating_mul(size_of::<T>());
    list.try_reserve_exact(count).map_err(|_| ReadError::Memory { bytes })?;
    Ok(list)
}

fn read_sections(input: &mut SectionReader) -> Result<World, ReadError> {
    let meta = meta::read_meta(&mut input.section(b"META")?)?;
    let octree = Octree::from_bytes(input.section(b"OCTR")?.rest())?;
    let mut cells = cells::read_cells(&mut input.section(b"CELL")?)?;
    cells.pvs = cells::read_pvs(&mut input.section(b"PVSS")?, cells.cells.len())?;
    let mesh = mesh::read(&mut input.section(b"MESH")?)?;
    let movers = movers::read(&mut input.section(b"MOVR")?)?;
    let rooms = meta::read_rooms(&input.section(b"ROOM")?, cells.cells.len(), movers.len())?;
    let light = light::read(&mut input.section(b"LGHT")?)?;
    let origin = origin::read(&mut input.section(b"ORIG")?)?;
    let Meta { title, body, speed_max, spawns } = meta;
    Ok(World { title, octree, cells, mesh, movers, rooms, light, spawns, body, speed_max, origin })
}
