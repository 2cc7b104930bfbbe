//! Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted. Clap itself exits with 2.

use std::process::ExitCode;

use clap::{Parser, error::ErrorKind};

use crate::output;

/// The exit code of an interrupted program, as shells have it: 128 and the number of SIGINT.
pub const INTERRUPTED: u8 = 130;

/// The error of a command that Ctrl-C ended before it wrote its files.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; nothing was written")]
pub struct Interrupted;

/// The exit code of wrong usage, as clap has it.
const USAGE: i32 = 2;

/// The arguments of a program. Wrong usage is told on one line of stderr, and ends the program.
pub fn arguments<A: Parser>(program: &str) -> A {
    A::try_parse().unwrap_or_else(|error| match error.kind() {
        ErrorKind::DisplayHelp
        | ErrorKind::DisplayVersion
        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => error.exit(),
        _ => {
            output::note(&format!("{program}: {}; see --help", usage_line(&error.to_string())));
            std::process::exit(USAGE)
        }
    })
}

/// What clap says of wrong usage, without the usage itself, on one line.
fn usage_line(said: &str) -> String {
    let is_about_it = |line: &&str| !line.starts_with("Usage:") && !line.starts_with("For more");
    let lines = said.lines().take_while(is_about_it).map(str::trim);
    let words: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    words.join(" ").trim_start_matches("error: ").replace(" tip: ", "; ")
}

/// The exit code for a command's outcome. Prints an error on one line of stderr, after the
/// program's name.
pub fn code(program: &str, outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    output::note(&format!("{program}: {}", output::one_line(&error)));
    if error.is::<Interrupted>() { ExitCode::from(INTERRUPTED) } else { ExitCode::FAILURE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_usage_is_one_line() {
        let said = "error: the following required arguments were not provided:\n  --output <OUT>\n\n\
                    Usage: compile --output <OUT> <INPUT>\n\nFor more information, try '--help'.\n";
        let expected = "the following required arguments were not provided: --output <OUT>";
        assert_eq!(usage_line(said), expected);
        let said = "error: unexpected argument '--voxl' found\n\n  tip: a similar argument exists: \
                    '--voxel'\n\nUsage: compile\n";
        let expected = "unexpected argument '--voxl' found; a similar argument exists: '--voxel'";
        assert_eq!(usage_line(said), expected);
    }
}
