//! Tells the operator and waiting clients what the supply does.

use std::{
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use sightline_cli::{log::LogFormat, progress::Progress};
use sightline_compiler::{Quality, Stage};
use sightline_server::{
    net::WorldChanger,
    supply::{Preparation, SupplyNews},
};

/// How often waiting clients are told of progress.
const TOLD_INTERVAL: Duration = Duration::from_secs(1);
/// How often progress beside a running server is logged.
const LOGGED_INTERVAL: Duration = Duration::from_secs(10);

/// Shows progress until there is a world, and logs what happens beside the running server.
pub struct Newsreader {
    changer: WorldChanger,
    /// `None` where every line is a JSON object of the log.
    progress: Option<Progress>,
    has_world: AtomicBool,
    told: Mutex<Option<Instant>>,
}

impl Newsreader {
    pub fn new(changer: WorldChanger, log: LogFormat) -> Self {
        let (has_world, told) = (AtomicBool::new(false), Mutex::default());
        let progress = (log == LogFormat::Text).then(Progress::new);
        Self { changer, progress, has_world, told }
    }

    /// Clears the progress.
    pub fn finish(&self) {
        self.progress.iter().for_each(Progress::finish);
    }

    pub fn hear(&self, news: &SupplyNews<'_>) {
        match news {
            SupplyNews::Progress(quality, stage, share) => self.progress(*quality, *stage, *share),
            SupplyNews::Warning(warning) => tracing::warn!("{warning}"),
            SupplyNews::Serves { how, took } => {
                self.has_world.store(true, Relaxed);
                self.finish();
                let seconds = format!("{:.1}", took.as_secs_f64());
                tracing::info!(seconds, "visitors can walk: {}", described(*how));
            }
            SupplyNews::NotKept(error) => {
                tracing::warn!("the building cannot be kept for the next start: {error}");
            }
            SupplyNews::Changed => tracing::info!("a file has changed: compiling again"),
            SupplyNews::Failed(error) => {
                tracing::error!("{error}; the building before is served on");
            }
        }
    }

    fn progress(&self, quality: Quality, stage: Stage, share: f32) {
        let percent = (share * 100.0) as u32;
        if !self.has_world.load(Relaxed) {
            if let Some(progress) = &self.progress {
                progress.show(stage.name(), share);
            }
            if self.is_due(TOLD_INTERVAL) {
                if self.progress.is_none() {
                    tracing::info!(percent, "compiling: {}", stage.name());
                }
                self.changer.tell_loading(&format!("compiling: {} {percent} %", stage.name()));
            }
        } else if self.is_due(LOGGED_INTERVAL) {
            let which = if quality == Quality::Quick { "quick" } else { "fine" };
            tracing::info!("the {which} building: {} {percent} %", stage.name());
        }
    }

    fn is_due(&self, interval: Duration) -> bool {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = told.is_none_or(|at| at.elapsed() >= interval);
        if is_due {
            *told = Some(Instant::now());
        }
        is_due
    }
}

fn described(how: Preparation) -> &'static str {
    match how {
        Preparation::Read => "the world is read",
        Preparation::Kept(Quality::Fine) => "the fine building was kept from an earlier start",
        Preparation::Kept(Quality::Quick) => {
            "a quick building was kept from an earlier start; the fine one follows"
        }
        Preparation::Compiled(Quality::Quick) => "a quick building; the fine one follows",
        Preparation::Compiled(Quality::Fine) => "the fine building",
    }
}
