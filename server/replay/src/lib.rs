//! The engine over a recorded trace, in virtual time and without sockets.
//!
//! [`run`] takes a [`World`], a [`Trace`] and [`ReplayOptions`], and returns a [`ReplayReport`].
//! Each avatar of the trace has a simulated client with a real replica. Its messages are the bytes
//! of the wire and travel over a simulated network ([`NetworkConditions`]). The engine decides what
//! each client is told, exactly as it does for `serve`, and the report says what that costs each
//! client. [`Comparison`] puts the reports of several policies side by side, and
//! [`ConfigurationTable`] those of one server, several and none.
//!
//! An audit compares what the clients hold with what rays against the building's triangles find
//! visible. It counts misses and over-send ([`OracleReport`]). [`run_watched`] shows each tick
//! ([`TickView`]) to a caller that checks more than that.
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//!
//! use sightline_cli::trace::Trace;
//! use sightline_engine::Policy;
//! use sightline_replay::{ReplayOptions, run};
//!
//! // Two people in one room of 8 m. The first walks past the second at 1 m/s.
//! let world = Arc::new(sightline_fixtures::voxel_floor::world(&[]));
//! let mut csv = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
//! for k in 0..50 {
//!     csv += &format!("{},1,{:.1},1.8,4,0,0,1,0,0\n", k * 100, 1.0 + 0.1 * k as f32);
//!     csv += &format!("{},2,5,1.8,5,0,0,0,0,0\n", k * 100);
//! }
//! let trace = Trace::read(csv.as_bytes())?;
//!
//! let options = ReplayOptions::new(Policy::Tbv, Duration::from_millis(100));
//! let mut dump = Vec::new();
//! let report = run(&world, &trace, &options, Some(&mut dump), &mut |_share| {})?;
//!
//! // Both see each other all the time, so each is told of the other once.
//! assert_eq!((report.avatars, report.enters, report.corrections), (2, 2, 0));
//! assert_eq!(report.oracle.unwrap().misses, 0);
//! assert!(String::from_utf8(dump)?.contains(",1,2,enter\n"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Simulated clients
//!
//! A simulated client holds the replica of a real one, which decides when it reports: while it is
//! live, when its avatar departs from its course; while it is quiet, only when it is asked or about
//! to leave its TBV. Where the trace moves an avatar as no body can, or farther than the server
//! would believe, the client announces a jump, as the host of a game does for a respawn or a
//! rocket's push.
//!
//! # The dump
//!
//! Times in the dump are the trace's own, at the server: when it sent a message, or received a
//! report. A `t_ms` is rounded down to a whole millisecond.

mod audit;
mod comparison;
mod configurations;
mod dump;
mod network;
mod options;
mod packets;
mod report;
mod run;
mod simulated_clients;
mod stations;
mod statistics;
mod tick_view;

use std::{io, sync::Arc, time::Duration};

use sightline_cli::trace::Trace;
use sightline_world::World;

pub use comparison::Comparison;
pub use configurations::{Configuration, ConfigurationReport, ConfigurationTable};
pub use network::NetworkConditions;
pub use options::{
    Assignment, BusFaults, ClientFaults, OracleStride, ReplayOptions, StationOptions, Trouble,
};
pub use report::{ClientReport, MissedAvatar, OracleReport, ReplayReport, StalePosition};
pub use stations::StationReport;
pub use tick_view::TickView;

use dump::Dump;
use run::Run;

/// Runs a trace. Writes every event to `dump` as CSV, and tells `progress` the share that is done,
/// from 0 to 1. The dump, and all figures but those of CPU time, depend on the arguments alone.
///
/// # Errors
/// When the dump cannot be written.
///
/// # Panics
/// When the options' tick is zero, or a share of their network is no share.
pub fn run<'a>(
    world: &Arc<World>,
    trace: &'a Trace,
    options: &ReplayOptions,
    dump: Option<&'a mut dyn io::Write>,
    progress: &mut dyn FnMut(f32),
) -> io::Result<ReplayReport> {
    let mut watch = |tick: &TickView<'_>| progress(tick.done);
    run_watched(world, trace, options, dump, &mut watch)
}

/// Runs a trace as [`run`] does, and shows every tick to `watch`.
///
/// # Errors
/// When the dump cannot be written.
///
/// # Panics
/// When the options' tick is zero, or a share of their network is no share.
pub fn run_watched<'a>(
    world: &Arc<World>,
    trace: &'a Trace,
    options: &ReplayOptions,
    dump: Option<&'a mut dyn io::Write>,
    watch: &mut dyn FnMut(&TickView<'_>),
) -> io::Result<ReplayReport> {
    let (first, last) = trace.span();
    let last = options.length.map_or(last, |length| last.min(first + length));
    let mut run = Run::new(world, trace, options, Dump::new(dump)?);
    let ticks = tick_times(first, last, options.config.tick);
    let count = ticks.len() as f32;
    for (k, now) in ticks.enumerate() {
        let outputs = run.decide(now)?;
        // An answer that arrives at once must not change what the engine decided by.
        watch(&run.view(now, (k + 1) as f32 / count, &outputs));
        run.tell(now, &outputs)?;
    }
    run.finish(trace, options, last.saturating_sub(first))
}

/// The times of the ticks from one time to another: whole multiples of the tick interval.
fn tick_times(
    first: Duration,
    last: Duration,
    tick: Duration,
) -> impl ExactSizeIterator<Item = Duration> {
    assert!(!tick.is_zero(), "ticks take time");
    let number = |ticks: u128| u32::try_from(ticks).unwrap_or(u32::MAX - 1);
    let start = number(first.as_nanos().div_ceil(tick.as_nanos()));
    let end = number(last.as_nanos() / tick.as_nanos()) + 1;
    (start as usize..end as usize).map(move |k| tick * k as u32)
}

#[cfg(test)]
mod tests;
