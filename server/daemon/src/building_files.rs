//! What a building is compiled from: its model, and the files that go with it.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use sightline_compiler::{
    import::{
        self, LeftOut, ReadError,
        glb::{self, GlbError, Placing},
    },
    model::Model,
    rooms::text::{self, FileError},
};
use sightline_world::Spawn;
use thiserror::Error;

/// What a building is compiled from.
#[derive(Clone, Debug)]
pub enum BuildingSource {
    /// Files on disk.
    Files(BuildingFiles),
    /// A GLB in memory.
    Glb {
        /// Its bytes.
        bytes: Vec<u8>,
        /// The title of a building that has none.
        title: String,
    },
}

/// A model on disk, and how it becomes a building.
#[derive(Clone, Debug)]
pub struct BuildingFiles {
    /// The model: a .glb, .gltf or .bsp.
    pub model: PathBuf,
    /// Archives with the textures of a Quake III map.
    pub pk3: Vec<PathBuf>,
    /// A file with rooms; when `None`, the one beside the model, if there is one.
    pub rooms: Option<PathBuf>,
    /// How the model is placed in the world.
    pub placing: Placing,
    /// The nodes of the model that are left out.
    pub left_out: LeftOut,
    /// Where visitors begin. When there are any, those of the model do not count.
    pub spawns: Vec<Spawn>,
    /// Whether light that the model brings is taken away, so that it is lit anew.
    pub relight: bool,
}

/// Why a building cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The model's files cannot be read.
    #[error(transparent)]
    Model(#[from] ReadError),
    /// The model in memory cannot be read.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// The file with rooms cannot be read, or has errors.
    #[error(transparent)]
    Rooms(#[from] FileError),
}

impl BuildingFiles {
    /// A model as it is, with the rooms beside it.
    pub fn of(model: &Path) -> Self {
        let model = model.to_owned();
        let (placing, left_out) = (Placing::default(), LeftOut::default());
        Self {
            model,
            pk3: Vec::new(),
            rooms: None,
            placing,
            left_out,
            spawns: Vec::new(),
            relight: false,
        }
    }

    /// Reads the model, with its rooms and spawn points.
    ///
    /// # Errors
    /// When a file cannot be read or has errors.
    pub fn read(&self) -> Result<Model, SourceError> {
        let mut model = import::read_placed(&self.model, &self.pk3, &self.placing, &self.left_out)?;
        if self.relight {
            model.remove_light();
        }
        let rooms = self.rooms_file();
        if self.rooms.is_some() || rooms.is_file() {
            model.rooms.extend(text::read_file(&rooms)?);
        }
        if !self.spawns.is_empty() {
            model.spawns = self.spawns.clone();
            model.rooms.iter_mut().for_each(|room| room.spawn = None);
        }
        Ok(model)
    }

    fn rooms_file(&self) -> PathBuf {
        self.rooms.clone().unwrap_or_else(|| self.model.with_extension("rooms.toml"))
    }

    /// Every file that the building depends on, whether or not it is there.
    fn all(&self) -> BTreeSet<PathBuf> {
        let mut all: BTreeSet<PathBuf> = import::referred_files(&self.model).into_iter().collect();
        all.extend([self.model.clone(), self.rooms_file()]);
        all.extend(self.pk3.iter().cloned());
        all
    }
}

impl BuildingSource {
    /// Reads the model.
    ///
    /// # Errors
    /// When a file cannot be read or has errors.
    pub fn read(&self) -> Result<Model, SourceError> {
        match self {
            Self::Files(files) => files.read(),
            Self::Glb { bytes, title } => Ok(glb::read_slice(bytes, None, title)?),
        }
    }

    /// Every file that the building depends on, whether or not it is there.
    pub fn files(&self) -> BTreeSet<PathBuf> {
        match self {
            Self::Files(files) => files.all(),
            Self::Glb { .. } => BTreeSet::new(),
        }
    }

    /// The hashes of all that the building depends on: the content of its files, and how they are
    /// read.
    ///
    /// # Errors
    /// When a file that is there cannot be read.
    pub(crate) fn content(&self) -> io::Result<Vec<blake3::Hash>> {
        let files = match self {
            Self::Files(files) => files,
            Self::Glb { bytes, title } => {
                return Ok(vec![blake3::hash(bytes), blake3::hash(title.as_bytes())]);
            }
        };
        let BuildingFiles { placing, left_out, spawns, relight, pk3, .. } = files;
        let name = files.model.file_stem();
        let all = files.all();
        // Of two archives with one file the last one counts.
        let order: Vec<_> = pk3.iter().map(|path| all.iter().position(|of| of == path)).collect();
        let how = format!("{name:?} {placing:?} {left_out:?} {spawns:?} {relight} {order:?}");
        let mut hashes = vec![blake3::hash(how.as_bytes())];
        for path in &all {
            hashes.push(match fs::read(path) {
                Ok(bytes) => blake3::hash(&bytes),
                Err(error) if error.kind() == io::ErrorKind::NotFound => blake3::hash(b"absent"),
                Err(error) => return Err(error),
            });
        }
        Ok(hashes)
    }
}
