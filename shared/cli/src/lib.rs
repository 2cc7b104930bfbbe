//! What the command-line programs share.
//!
//! * [`trace`]: recorded walks, as CSV. A [`trace::Trace`] is all avatars, a [`trace::Track`] one.
//! * [`progress`]: a [`progress::Progress`] shows how far a long task is, with a bar on a terminal
//!   and plain lines elsewhere.
//! * [`output`]: text on stdout, lines on stderr, figures as JSON.
//! * [`files`]: worlds to read, and files to write, that are named on the command line.
//! * [`flags`]: parsers for the values of flags, and for addresses.
//! * [`identity`]: the certificate and key of a server or a visitor.
//! * [`exit`]: exit codes, and the line that a failed program prints.
//! * [`log`]: the log on stderr.
//! * [`percentile`]: percentiles by nearest rank.
//! * [`pose_error`]: how far off avatars are shown.
//!
//! A command reads its flags, shows progress, prints a table and returns a result, from which
//! [`exit::code`] makes the exit code:
//!
//! ```
//! use std::{path::PathBuf, process::ExitCode};
//!
//! use sightline_cli::{exit, output, percentile::percentile, progress::Progress, trace::Trace};
//!
//! /// Prints how fast each avatar of a trace moves.
//! fn speeds(csv: &str, json: Option<PathBuf>) -> anyhow::Result<()> {
//!     let trace = Trace::read(csv.as_bytes())?;
//!     let (tracks, progress) = (trace.tracks(), Progress::new());
//!     let mut medians = Vec::new();
//!     for (done, track) in tracks.iter().enumerate() {
//!         progress.show("speeds", done as f32 / tracks.len() as f32);
//!         let speeds = track.samples.iter().map(|(_, pose)| pose.velocity.length());
//!         let mut speeds: Vec<f32> = speeds.collect();
//!         speeds.sort_by(f32::total_cmp);
//!         medians.push((track.id, percentile(&speeds, 50)));
//!     }
//!     progress.finish();
//!     output::print(&format!("{medians:?}\n"))?;
//!     output::write_json(json.as_deref(), &medians)
//! }
//!
//! let csv = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n0,7,0,1.6,0,0,0,1,0,0\n";
//! assert_eq!(exit::code("speeds", speeds(csv, None)), ExitCode::SUCCESS);
//! assert_eq!(exit::code("speeds", speeds("no trace", None)), ExitCode::FAILURE);
//! ```

pub mod exit;
pub mod files;
pub mod flags;
pub mod identity;
pub mod log;
pub mod output;
pub mod percentile;
pub mod pose_error;
pub mod progress;
pub mod trace;
