//! Output of a command: text on stdout, lines on stderr, figures as JSON.

use std::{
    io::{self, Write},
    path::Path,
};

use anyhow::Context;
use serde::Serialize;

/// Writes text to stdout. A reader that has gone is no error, because the work is done.
///
/// # Errors
/// When stdout exists but rejects the text, for example on a full disk.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to stdout")
        }
        _ => Ok(()),
    }
}

/// Writes a line to stderr, whether or not anybody reads it.
pub fn note(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Writes figures to a JSON file, when a file is given.
///
/// The file is written in place, so that `/dev/stdout` works as well.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json(path: Option<&Path>, figures: &impl Serialize) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = serde_json::to_string_pretty(figures)? + "\n";
    debug_assert!(text.starts_with(['{', '[']), "figures are an object or a list");
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// An error and its causes on one line, without control characters from a file or a peer.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if line.is_empty() {
            line = cause;
        } else if !line.ends_with(&cause) {
            // Many errors name their cause themselves; it is not repeated.
            line = format!("{line}: {cause}");
        }
    }
    line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cause_is_named_once() {
        let cause = io::Error::other("no\nsuch file");
        let named = anyhow::Error::new(cause).context("cannot read w.slw: no\nsuch file");
        assert_eq!(one_line(&named), "cannot read w.slw: no such file");
        let unnamed = anyhow::anyhow!("no such file").context("cannot read w.slw");
        assert_eq!(one_line(&unnamed), "cannot read w.slw: no such file");
    }

    #[test]
    fn figures_are_written_to_a_file_that_is_given() {
        let folder = std::env::temp_dir().join(format!("sightline-json-{}", std::process::id()));
        write_json(None, &[1, 2]).unwrap();
        write_json(Some(&folder), &[1, 2]).unwrap();
        assert_eq!(std::fs::read_to_string(&folder).unwrap(), "[\n  1,\n  2\n]\n");
        std::fs::remove_file(&folder).unwrap();
        let error = write_json(Some(Path::new("/no/such/folder/f")), &[1]).unwrap_err();
        assert!(one_line(&error).starts_with("cannot write /no/such/folder/f: "), "{error}");
    }
}
