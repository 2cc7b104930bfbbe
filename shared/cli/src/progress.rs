//! Progress of long tasks on stderr: a bar on a terminal, plain lines elsewhere.

use std::{
    io::{IsTerminal, Write, stderr},
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

/// A stage tells how much time is left once it has taken this long …
const TELLING: Duration = Duration::from_secs(4);
/// … and this share of it is done.
const TELLING_SHARE: f32 = 0.03;
/// The bar's resolution: its length in steps.
const STEPS: u64 = 1_000;

/// Shows the completed share of one named stage after another, on stderr.
///
/// On a terminal this is a bar with the percentage and the elapsed time. Elsewhere it is a line
/// for each new stage and for each further tenth of it. A long stage tells about how much time is
/// left of it.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    /// The present stage, and when it began.
    began: Mutex<Option<(String, Instant)>>,
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
            let printed = Some(Mutex::default());
            return Self { bar: ProgressBar::hidden(), began: Mutex::default(), printed };
        }
        let style =
            ProgressStyle::with_template("{msg:<32} [{wide_bar}] {percent:>3} %  {elapsed}")
                .expect("the template is valid")
                .progress_chars("=> ");
        let bar = ProgressBar::new(STEPS).with_style(style);
        Self { bar, began: Mutex::default(), printed: None }
    }

    /// Shows the completed share of a stage, from 0 to 1.
    pub fn show(&self, stage: &str, share: f32) {
        self.show_with_note(stage, share, "");
    }

    /// Shows the completed share of a stage, from 0 to 1, with a note such as `(12 visitors)`.
    pub fn show_with_note(&self, stage: &str, share: f32, note: &str) {
        debug_assert!(!share.is_nan(), "the share of {stage} is no number");
        let share = share.clamp(0.0, 1.0);
        let left = time_left(self.elapsed(stage), share);
        let note = &format!("{note} {left}");
        let Some(printed) = &self.printed else {
            let message = format!("{stage} {}", note.trim());
            let message = message.trim_end();
            if self.bar.message() != message {
                self.bar.set_message(message.to_owned());
            }
            self.bar.set_position((share * STEPS as f32) as u64);
            return;
        };
        let mut printed = printed.lock().unwrap_or_else(PoisonError::into_inner);
        if printed.is_news(stage, share) {
            let line = format!("{stage}: {} % {}", printed.tenth * 10, note.trim());
            // The work goes on after the reader of stderr has gone.
            let _ = writeln!(stderr(), "{}", line.trim_end());
        }
    }

    /// How long a stage has taken.
    fn elapsed(&self, stage: &str) -> Duration {
        let mut began = self.began.lock().unwrap_or_else(PoisonError::into_inner);
        match &*began {
            Some((known, start)) if known == stage => start.elapsed(),
            _ => {
                *began = Some((stage.to_owned(), Instant::now()));
                Duration::ZERO
            }
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

/// What is to be said of the time that a stage still takes. Empty while nobody knows.
fn time_left(elapsed: Duration, share: f32) -> String {
    if elapsed < TELLING || !(TELLING_SHARE..1.0).contains(&share) {
        return String::new();
    }
    let left = elapsed.mul_f32((1.0 - share) / share).as_secs();
    match left {
        0..60 => format!("about {} s left", left + 1),
        _ => format!("about {} min left", left.div_ceil(60)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_stage_tells_how_much_time_is_left() {
        let left = |seconds, share| time_left(Duration::from_secs(seconds), share);
        assert_eq!(left(2, 0.5), "");
        assert_eq!(left(10, 0.01), "");
        assert_eq!(left(10, 0.5), "about 11 s left");
        assert_eq!(left(100, 0.25), "about 5 min left");
    }

    #[test]
    fn each_stage_has_a_line_for_each_tenth() {
        let mut printed = PrintedLine::default();
        let shares = [0.0, 0.05, 0.1, 0.19, 0.55, 0.5, 1.0];
        let news: Vec<bool> = shares.iter().map(|share| printed.is_news("carve", *share)).collect();
        assert_eq!(news, [true, false, true, false, true, false, true]);
        assert!(printed.is_news("split", 0.0), "a new stage starts again");
    }
}
