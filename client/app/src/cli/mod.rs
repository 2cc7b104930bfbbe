//! The commands: flags in, one outcome out. Exit codes: 0 done, 1 failed, 2 wrong usage.

pub mod bench;
mod flags;
mod picture;
pub mod shot;
pub mod swarm;
#[cfg(feature = "desktop")]
pub mod walk;
