//! Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted. Clap itself exits with 2.

use std::process::ExitCode;

use crate::output;

/// The exit code of an interrupted program, as shells have it: 128 and the number of SIGINT.
pub const INTERRUPTED: u8 = 130;

/// The error of a command that Ctrl-C ended before it wrote its files.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; nothing was written")]
pub struct Interrupted;

/// The exit code for a command's outcome. Prints an error on one line of stderr, after the
/// program's name.
pub fn code(program: &str, outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    output::note(&format!("{program}: {}", output::one_line(&error)));
    if error.is::<Interrupted>() { ExitCode::from(INTERRUPTED) } else { ExitCode::FAILURE }
}
