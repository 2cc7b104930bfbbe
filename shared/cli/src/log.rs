//! The log of a program, on stderr.

use std::io::{self, IsTerminal};

use tracing_subscriber::EnvFilter;

/// Starts to write log lines to stderr: those that the variable `RUST_LOG` selects, or else those
/// of `default_filter`, such as `info` or `warn,winit=error`. Call it once.
pub fn show_log(default_filter: &str) {
    let filter = EnvFilter::try_from_default_env();
    tracing_subscriber::fmt()
        .with_env_filter(filter.unwrap_or_else(|_| EnvFilter::new(default_filter)))
        .with_ansi(io::stderr().is_terminal())
        .with_writer(io::stderr)
        .init();
}
