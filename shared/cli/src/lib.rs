//! What the command-line programs share.
//!
//! * [`trace`]: recorded walks, as CSV.
//! * [`progress`]: a bar on a terminal, plain lines elsewhere.

pub mod progress;
pub mod trace;
