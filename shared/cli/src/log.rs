//! The log of a program, on stderr.

use std::io::{self, IsTerminal};

use tracing_subscriber::{filter::Targets, fmt, layer::SubscriberExt, util::SubscriberInitExt};

/// Starts to write log lines to stderr: those that the variable `RUST_LOG` selects, or else those
/// of `default_filter`, such as `info` or `warn,winit=error`. Call it once.
///
/// A filter is a list of `LEVEL` for all modules and `MODULE=LEVEL`, separated by commas. Filters by
/// spans and fields, which need regular expressions, are not understood.
///
/// # Panics
/// When `default_filter` is not well formed, or a log is written already.
pub fn show_log(default_filter: &str) {
    let filter = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let filter = filter.unwrap_or_else(|| default_filter.parse().expect("well formed"));
    let lines = fmt::layer().with_ansi(io::stderr().is_terminal()).with_writer(io::stderr);
    tracing_subscriber::registry().with(lines).with(filter).init();
}
