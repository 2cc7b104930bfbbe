//! A world and the bytes of its file, ready to be served.

use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use sightline_world::{ContentId, ReadError, World, content_id};

use super::served_pieces::ServedPieces;

/// A world and the bytes of its file, ready to be served. Copies share the memory.
#[derive(Clone, Debug)]
pub struct ServedWorld {
    world: Arc<World>,
    bytes: Bytes,
    id: ContentId,
    /// Its pieces, once it is cut.
    pieces: Arc<OnceLock<Arc<ServedPieces>>>,
}

impl ServedWorld {
    /// Reads the bytes of a world file.
    ///
    /// # Errors
    /// When they are no world file, of another version, or damaged.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, ReadError> {
        let id = content_id(&bytes)?;
        let world = Arc::new(World::from_bytes(&bytes)?);
        Ok(Self { world, bytes: bytes.into(), id, pieces: Arc::default() })
    }

    /// Writes a world's file into memory.
    pub fn from_world(world: Arc<World>) -> Self {
        let bytes = world.to_bytes();
        let id = content_id(&bytes).expect("a world's own bytes are a world file");
        Self { world, bytes: bytes.into(), id, pieces: Arc::default() }
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// The bytes of the world file, as clients download them.
    pub fn bytes(&self) -> &Bytes {
        &self.bytes
    }

    /// The bytes of all pieces in which it can be had; `None` until it is cut.
    pub fn pieces_bytes(&self) -> Option<usize> {
        self.pieces().map(|pieces| pieces.bytes())
    }

    /// The content id by which clients cache the file.
    pub(crate) fn id(&self) -> &ContentId {
        &self.id
    }

    /// The pieces; `None` until the world is cut.
    pub(crate) fn pieces(&self) -> Option<&Arc<ServedPieces>> {
        self.pieces.get()
    }

    /// The same world, which is to be cut anew.
    pub(super) fn uncut(self) -> Self {
        Self { pieces: Arc::default(), ..self }
    }

    /// Takes in the pieces. The first ones stay.
    pub(super) fn set_pieces(&self, pieces: Arc<ServedPieces>) {
        let _ = self.pieces.set(pieces);
    }
}
