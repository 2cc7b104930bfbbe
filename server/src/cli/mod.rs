//! The commands: flags in, one outcome out. Exit codes: 0 done, 1 failed, 2 wrong usage.

pub mod compile;
pub mod demo_building;
pub mod inspect;
pub mod replay;
pub mod serve;

/// An error and its causes on one line, whatever characters a file or a peer put into it.
pub fn one_line(error: &anyhow::Error) -> String {
    format!("{error:#}").chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
