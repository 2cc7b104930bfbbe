//! What the command-line programs share.
//!
//! * [`trace`]: recorded walks, as CSV.
//! * [`progress`]: a bar on a terminal, plain lines elsewhere.
//! * [`output`]: text on stdout, lines on stderr, figures as JSON.
//! * [`flags`]: parsers for the values of flags, and for addresses.
//! * [`exit`]: exit codes.
//! * [`log`]: the log on stderr.
//! * [`percentile`]: percentiles by nearest rank.

pub mod exit;
pub mod flags;
pub mod log;
pub mod output;
pub mod percentile;
pub mod progress;
pub mod trace;
