//! What the demo shows.

use std::{path::PathBuf, time::Duration};

/// What the demo shows, and where it keeps its files.
#[derive(Clone, Debug)]
pub struct DemoOptions {
    /// The number of simulated visitors.
    pub visitors: usize,
    /// How long they walk.
    pub duration: Duration,
    /// The number of rooms in the building.
    pub rooms: usize,
    /// The seed of the building and of the visitors' goals.
    pub seed: u64,
    /// A world file to walk in instead of the demo building.
    pub world: Option<PathBuf>,
    /// The folder where compiled demo buildings are kept for the next run.
    pub cache: PathBuf,
    /// The folder for the pictures when there is no window.
    pub pictures: PathBuf,
    /// Whether to open a window where there is a display.
    pub window: bool,
}
