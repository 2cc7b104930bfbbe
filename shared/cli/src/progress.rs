//! Progress of long tasks on stderr: a bar on a terminal, plain lines elsewhere.

use std::{
    io::{IsTerminal, Write, stderr},
    sync::{Mutex, PoisonError},
};

use indicatif::{ProgressBar, ProgressStyle};

/// The bar's resolution: its length in steps.
const STEPS: u64 = 1_000;

/// Shows the completed share of one named stage after another, on stderr.
///
/// On a terminal this is a bar with the percentage and the elapsed time. Elsewhere it is a line
/// for each new stage and for each further tenth of it.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    /// The last printed line; `None` on a terminal, where there are no lines.
    printed: Option<Mutex<PrintedLine>>,
}

/// The stage and the tenth of the last plain line.
#[derive(Debug, Default)]
struct PrintedLine {
    stage: String,
    tenth: u32,
}

impl Default for Progress {
    fn default() -> Self {
        Self::new()
    }
}

impl Progress {
    /// An empty bar on a terminal; elsewhere no line yet.
    pub fn new() -> Self {
        if !stderr().is_terminal() {
            return Self { bar: ProgressBar::hidden(), printed: Some(Mutex::default()) };
        }
        let style =
            ProgressStyle::with_template("{msg:<32} [{wide_bar}] {percent:>3} %  {elapsed}")
                .expect("the template is valid")
                .progress_chars("=> ");
        Self { bar: ProgressBar::new(STEPS).with_style(style), printed: None }
    }

    /// Shows the completed share of a stage, from 0 to 1.
    pub fn show(&self, stage: &str, share: f32) {
        self.show_with_note(stage, share, "");
    }

    /// Shows the completed share of a stage, from 0 to 1, with a note such as `(12 visitors)`.
    pub fn show_with_note(&self, stage: &str, share: f32, note: &str) {
        debug_assert!(!share.is_nan(), "the share of {stage} is no number");
        let share = share.clamp(0.0, 1.0);
        let Some(printed) = &self.printed else {
            let message = format!("{stage} {note}");
            let message = message.trim_end();
            if self.bar.message() != message {
                self.bar.set_message(message.to_owned());
            }
            self.bar.set_position((share * STEPS as f32) as u64);
            return;
        };
        let mut printed = printed.lock().unwrap_or_else(PoisonError::into_inner);
        if printed.is_news(stage, share) {
            let line = format!("{stage}: {} % {note}", printed.tenth * 10);
            // The work goes on after the reader of stderr has gone.
            let _ = writeln!(stderr(), "{}", line.trim_end());
        }
    }

    /// Clears the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl PrintedLine {
    /// Moves on to a share of a stage. Tells whether that deserves a new line.
    fn is_news(&mut self, stage: &str, share: f32) -> bool {
        let tenth = (share * 10.0) as u32;
        let is_news = self.stage != stage || tenth > self.tenth;
        if is_news {
            *self = Self { stage: stage.to_owned(), tenth };
        }
        is_news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stage_has_a_line_for_each_tenth() {
        let mut printed = PrintedLine::default();
        let shares = [0.0, 0.05, 0.1, 0.19, 0.55, 0.5, 1.0];
        let news: Vec<bool> = shares.iter().map(|share| printed.is_news("carve", *share)).collect();
        assert_eq!(news, [true, false, true, false, true, false, true]);
        assert!(printed.is_news("split", 0.0), "a new stage starts again");
    }
}
