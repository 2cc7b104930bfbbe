//! The supply of a server: it compiles the building that is served, and compiles it again when its
//! files change.
//!
//! A quick compilation comes first, so that visitors can come in. The fine one follows beside the
//! running server, at a lower priority, and takes its place. Fine worlds are kept in a
//! [`BuildingCache`]: a second start needs no compilation.

mod watch;

use std::{
    collections::BTreeSet,
    fs, io,
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use rayon::ThreadPool;
use sightline_compiler::{CompileError, CompileOptions, Quality, Stage, compile};
use sightline_world::ReadError;
use thiserror::Error;

use crate::{
    background,
    building_cache::{BuildingCache, BuildingError, CacheKey},
    building_files::BuildingSource,
    net::{ServedWorld, ServerEnded, WorldChanger},
};
use watch::Watched;

/// What a server serves.
#[derive(Clone, Debug)]
pub enum Supplied {
    /// A world file.
    World(PathBuf),
    /// A building that has to be compiled.
    Building {
        /// What it is compiled from.
        source: BuildingSource,
        /// How. The quality is chosen by the supply.
        options: CompileOptions,
        /// Where compiled buildings are kept.
        cache: BuildingCache,
    },
}

/// What happens meanwhile, for people.
#[derive(Debug)]
pub enum SupplyNews<'a> {
    /// A share of a stage of a compilation is done, from 0 to 1.
    Progress(Quality, Stage, f32),
    /// Something about the building that was probably not meant.
    Warning(&'a str),
    /// A world is served from now on.
    Serves {
        /// Where it came from.
        how: Preparation,
        /// How long it took to prepare.
        took: Duration,
    },
    /// A compiled building cannot be kept for the next start.
    NotKept(&'a io::Error),
    /// A file has changed.
    Changed,
    /// There is no world of what the files have become. The one before is served on.
    Failed(&'a SupplyError),
}

/// How a world was prepared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preparation {
    /// It is a world file.
    Read,
    /// An earlier run compiled it.
    Kept(Quality),
    /// It was compiled now.
    Compiled(Quality),
}

/// Why there is no world.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SupplyError {
    /// The world file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The world file is none.
    #[error("{path}: {source}")]
    World {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: ReadError,
    },
    /// The building cannot be compiled.
    #[error(transparent)]
    Building(#[from] BuildingError),
    /// The system gives no threads to compile on.
    #[error("cannot compile beside the running server: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Why there is no world now.
enum Interrupted {
    /// There will be none.
    Failed(SupplyError),
    /// A file has changed meanwhile.
    Changed,
    /// The server ends.
    Ended,
}

/// Supplies one server.
pub struct Supply<'a> {
    /// What it serves.
    pub supplied: Supplied,
    /// Whether files are watched after the fine world is served.
    pub watches: bool,
    /// The server.
    pub changer: WorldChanger,
    /// The supply ends soon after this becomes true.
    pub ends: &'a AtomicBool,
    /// Hears what happens. It must not wait.
    pub tell: &'a (dyn Fn(SupplyNews<'_>) + Sync),
}

impl Supply<'_> {
    /// Supplies the server until it ends; without watching, until the fine world is served.
    ///
    /// # Errors
    /// When there is no first world.
    pub fn run(&self) -> Result<(), SupplyError> {
        let background = background::threads(0)?;
        let mut served = None;
        loop {
            let watched = self.watches.then(|| Watched::now(&self.files()));
            let round = Round { supply: self, watched: watched.as_ref(), background: &background };
            match round.run(&mut served) {
                Ok(()) | Err(Interrupted::Changed) => {}
                Err(Interrupted::Failed(error)) if served.is_none() => return Err(error),
                Err(Interrupted::Failed(error)) => (self.tell)(SupplyNews::Failed(&error)),
                Err(Interrupted::Ended) => return Ok(()),
            }
            let Some(watched) = watched else { return Ok(()) };
            if !watched.wait(&|| self.ends.load(Relaxed)) {
                return Ok(());
            }
            (self.tell)(SupplyNews::Changed);
        }
    }

    fn files(&self) -> BTreeSet<PathBuf> {
        match &self.supplied {
            Supplied::World(path) => BTreeSet::from([path.clone()]),
            Supplied::Building { source, .. } => source.files(),
        }
    }
}

/// What was served last.
#[derive(PartialEq, Eq)]
enum Served {
    File,
    Building(Option<CacheKey>),
}

/// The supply of what the files are at one moment.
struct Round<'a> {
    supply: &'a Supply<'a>,
    watched: Option<&'a Watched>,
    background: &'a ThreadPool,
}

impl Round<'_> {
    fn run(&self, served: &mut Option<Served>) -> Result<(), Interrupted> {
        match &self.supply.supplied {
            Supplied::World(path) => {
                let start = Instant::now();
                let world = read(path).map_err(Interrupted::Failed)?;
                self.serve(world, served, Served::File, Preparation::Read, start)
            }
            Supplied::Building { source, options, cache } => {
                self.run_building(source, options, cache, served)
            }
        }
    }

    fn run_building(
        &self,
        source: &BuildingSource,
        options: &CompileOptions,
        cache: &BuildingCache,
        served: &mut Option<Served>,
    ) -> Result<(), Interrupted> {
        let [quick, fine] =
            [Quality::Quick, Quality::Fine].map(|quality| CompileOptions { quality, ..*options });
        // Without a key the building is compiled, and not kept. What is wrong with its files is
        // told when they are read.
        let [quick_key, fine_key] = [&quick, &fine].map(|it| CacheKey::new(source, it).ok());
        let is_served = |key| served.as_ref() == Some(&Served::Building(key));
        if fine_key.is_some() && is_served(fine_key) {
            return Ok(());
        }
        let kept = |key: Option<CacheKey>| key.and_then(|key| cache.load(key));
        let start = Instant::now();
        if let Some(world) = kept(fine_key) {
            let how = Preparation::Kept(Quality::Fine);
            return self.serve(world, served, Served::Building(fine_key), how, start);
        }
        let model = source.read().map_err(failed)?;
        model.warnings.iter().for_each(|warning| self.tell(SupplyNews::Warning(warning)));
        if let Some(world) = kept(quick_key) {
            let how = Preparation::Kept(Quality::Quick);
            self.serve(world, served, Served::Building(quick_key), how, start)?;
        }
        for (options, key) in [(quick, quick_key), (fine, fine_key)] {
            if key.is_some() && served.as_ref() == Some(&Served::Building(key)) {
                continue;
            }
            let start = Instant::now();
            let world = self.compile(served.is_some(), &model, &options)?;
            let how = Preparation::Compiled(options.quality);
            self.serve(world.clone(), served, Served::Building(key), how, start)?;
            if let Some(Err(error)) = key.map(|key| cache.store(key, &world)) {
                self.tell(SupplyNews::NotKept(&error));
            }
        }
        // The fine world takes the place of the quick one on disk too.
        quick_key.into_iter().for_each(|key| cache.remove(key));
        Ok(())
    }

    /// Compiles the building, beside the running server if it has a world.
    fn compile(
        &self,
        is_beside: bool,
        model: &sightline_compiler::model::Model,
        options: &CompileOptions,
    ) -> Result<ServedWorld, Interrupted> {
        let quality = options.quality;
        let progress = |stage, share| {
            self.tell(SupplyNews::Progress(quality, stage, share));
            match self.interruption() {
                None => ControlFlow::Continue(()),
                Some(_) => ControlFlow::Break(()),
            }
        };
        let work = || compile(model, options, &progress);
        let outcome = if is_beside { self.background.install(work) } else { work() };
        match outcome {
            Ok((world, report)) => {
                if quality == Quality::Fine {
                    let warnings = report.warnings.iter();
                    warnings.for_each(|warning| self.tell(SupplyNews::Warning(warning)));
                    let rooms = report.room_warnings.iter().map(ToString::to_string);
                    rooms.for_each(|warning| self.tell(SupplyNews::Warning(&warning)));
                }
                Ok(ServedWorld::from_world(Arc::new(world)))
            }
            Err(CompileError::Cancelled) => Err(self.interruption().unwrap_or(Interrupted::Ended)),
            Err(error) => Err(failed(error)),
        }
    }

    fn interruption(&self) -> Option<Interrupted> {
        if self.supply.ends.load(Relaxed) {
            return Some(Interrupted::Ended);
        }
        self.watched.filter(|watched| watched.has_changed()).map(|_| Interrupted::Changed)
    }

    fn serve(
        &self,
        world: ServedWorld,
        served: &mut Option<Served>,
        what: Served,
        how: Preparation,
        start: Instant,
    ) -> Result<(), Interrupted> {
        let changer = &self.supply.changer;
        let change = || changer.change(world);
        let changed = if served.is_some() { self.background.install(change) } else { change() };
        changed.map_err(|ServerEnded| Interrupted::Ended)?;
        *served = Some(what);
        self.tell(SupplyNews::Serves { how, took: start.elapsed() });
        Ok(())
    }

    fn tell(&self, news: SupplyNews<'_>) {
        (self.supply.tell)(news);
    }
}

fn failed(error: impl Into<BuildingError>) -> Interrupted {
    Interrupted::Failed(SupplyError::Building(error.into()))
}

fn read(path: &Path) -> Result<ServedWorld, SupplyError> {
    let bytes =
        fs::read(path).map_err(|source| SupplyError::Io { path: path.to_owned(), source })?;
    let named = |source| SupplyError::World { path: path.to_owned(), source };
    ServedWorld::from_bytes(bytes).map_err(named)
}
