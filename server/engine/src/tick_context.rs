//! What algorithms read and never change.

use std::time::Duration;

use crate::{building::Building, config::Config, stations::Stations, timing::Horizons};

/// The building, the configuration and the time, for one call of the engine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TickContext<'a> {
    pub(crate) building: &'a Building,
    pub(crate) config: &'a Config,
    pub(crate) horizons: &'a Horizons,
    pub(crate) stations: &'a Stations,
    pub(crate) now: Duration,
    /// The number of the last tick.
    pub(crate) tick: u32,
    /// How many ticks there have been. After a late tick that is less than its number.
    pub(crate) rounds: u32,
}
