//! The commands: flags in, one outcome out. Exit codes: 0 done, 1 failed, 2 wrong usage.

pub mod bench;
mod flags;
mod picture;
mod progress;
pub mod shot;
pub mod swarm;
#[cfg(feature = "desktop")]
pub mod walk;

use std::{
    io::{self, IsTerminal, Write},
    net::{SocketAddr, ToSocketAddrs},
};

use anyhow::Context;
use tracing_subscriber::EnvFilter;

/// The address of a server, as host:port; of several the first, those of IPv4 before others.
pub fn resolve(address: &str) -> anyhow::Result<SocketAddr> {
    let mut found: Vec<SocketAddr> =
        address.to_socket_addrs().with_context(|| format!("no such address: {address}"))?.collect();
    found.sort_by_key(SocketAddr::is_ipv6);
    found.first().copied().with_context(|| format!("no such address: {address}"))
}

/// Writes to stdout. When nobody reads it any more, that is no fault: the work is done.
///
/// # Errors
/// When stdout is there and refuses, such as a full disk.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to stdout")
        }
        _ => Ok(()),
    }
}

/// An error and its causes on one line, whatever characters a file or a peer put into it.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Many errors name their cause already.
        if line.is_empty() {
            line = cause;
        } else if !line.ends_with(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// Shows warnings (the window's own are of no use to anybody), or what the variable `RUST_LOG` asks for, on stderr.
pub fn show_log() {
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn,winit=error"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(io::stderr().is_terminal())
        .with_writer(io::stderr)
        .init();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_resolved() {
        assert_eq!(resolve("127.0.0.1:4777").ok(), Some(([127, 0, 0, 1], 4777).into()));
        for wrong in ["", "127.0.0.1", "a b:c"] {
            assert!(resolve(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn causes_are_told_once() {
        let cause = io::Error::other("no\nsuch file");
        let named = anyhow::Error::new(cause).context("cannot read w.slw: no\nsuch file");
        assert_eq!(one_line(&named), "cannot read w.slw: no such file");
        let unnamed = anyhow::anyhow!("no such file").context("cannot read w.slw");
        assert_eq!(one_line(&unnamed), "cannot read w.slw: no such file");
    }
}
