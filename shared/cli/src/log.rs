//! The log of a program, on stderr.
//!
//! Each event is one line, whatever a peer has written: characters that a terminal takes for
//! commands, and ends of lines, are escaped.

use std::{
    fmt::{Display, Write as _},
    io::{self, IsTerminal, Write},
};

use tracing_subscriber::{
    Layer, Registry,
    field::MakeExt,
    filter::Targets,
    fmt::{self, format::debug_fn},
    layer::SubscriberExt,
    util::SubscriberInitExt,
};

/// How a log is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line, for machines.
    Json,
}

/// Starts to write log lines to stderr: those that the variable `RUST_LOG` selects, or else those
/// of `default_filter`, such as `info` or `warn,winit=error`. Call it once.
///
/// A filter is a list of `LEVEL` for all modules and `MODULE=LEVEL`, separated by commas. Filters
/// by spans and fields, which need regular expressions, are not understood.
///
/// # Panics
/// When `default_filter` is not well formed, or a log is written already.
pub fn show_log(default_filter: &str, format: LogFormat) {
    let filter = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let filter = filter.unwrap_or_else(|| default_filter.parse().expect("well formed"));
    let is_terminal = io::stderr().is_terminal();
    let lines = lines(format, is_terminal, io::stderr);
    tracing_subscriber::registry().with(lines.with_filter(filter)).init();
}

/// Writes each event as a line; in colours for a terminal.
fn lines<W, F>(format: LogFormat, colours: bool, open: F) -> Box<dyn Layer<Registry> + Send + Sync>
where
    W: Write,
    F: Fn() -> W + Send + Sync + 'static,
{
    match format {
        LogFormat::Text => {
            // What is displayed or in the message is as a peer wrote it.
            let fields = debug_fn(|to, field, value| {
                let text = Escaped(format!("{value:?}"));
                if field.name() == "message" {
                    write!(to, "{text}")
                } else {
                    write!(to, "{field}={text}")
                }
            });
            let layer = fmt::layer().with_ansi(colours).with_writer(open);
            layer.fmt_fields(fields.delimited(" ")).boxed()
        }
        LogFormat::Json => fmt::layer().json().flatten_event(true).with_writer(open).boxed(),
    }
}

/// A text without ends of lines, and without characters that a terminal takes for commands.
struct Escaped(String);

impl Display for Escaped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.chars().try_for_each(|c| match c.is_control() {
            true => write!(f, "{}", c.escape_default()),
            false => f.write_char(c),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// What is logged of a text that a peer wrote: as a field each way, and as a part of the
    /// message.
    fn logged(format: LogFormat, text: &str) -> String {
        #[derive(Clone, Default)]
        struct Kept(Arc<Mutex<Vec<u8>>>);
        impl Write for Kept {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0.lock().unwrap().write(bytes)
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let kept = Kept::default();
        let opened = kept.clone();
        let subscriber =
            tracing_subscriber::registry().with(lines(format, false, move || opened.clone()));
        tracing::subscriber::with_default(subscriber, || {
            tracing::info!(name = text, shown = %text, quoted = ?text, "a peer wrote {text}");
        });
        let bytes = kept.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn what_a_peer_writes_is_one_line_without_commands() {
        let hostile = "a\nINFO forged\r\x1b[2J\u{9b}2J\u{7}";
        for format in [LogFormat::Text, LogFormat::Json] {
            let said = logged(format, hostile);
            let line = said.strip_suffix('\n').unwrap();
            assert!(!line.chars().any(|c| c.is_control() && c != '\u{9b}'), "{line:?}");
            assert!(line.contains("forged"), "{line}");
        }
        let line = logged(LogFormat::Json, hostile);
        let read: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert_eq!((&read["name"], &read["level"]), (&hostile.into(), &"INFO".into()));
        let line = logged(LogFormat::Text, hostile);
        assert!(!line.contains('\u{9b}') && line.contains("a peer wrote a\\nINFO"), "{line}");
        assert!(line.contains(" name=\"a\\nINFO") && line.contains(" shown=a\\nINFO"), "{line}");
    }
}
