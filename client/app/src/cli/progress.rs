//! How long tasks show that they go on: a bar on a terminal, plain lines elsewhere, on stderr.

use std::{
    cell::RefCell,
    io::{self, IsTerminal, Write},
};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shows how far a task is, of so many steps.
pub struct Progress {
    bar: ProgressBar,
    /// What was told last, where there is no terminal.
    told: Option<RefCell<(String, u64)>>,
}

impl Progress {
    /// Nothing done yet.
    pub fn new() -> Self {
        let is_terminal = io::stderr().is_terminal();
        let target =
            if is_terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(1_000), target);
        let style = ProgressStyle::with_template("{msg:<32} [{bar:40}] {percent:>3} %");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        let told = (!is_terminal).then(RefCell::default);
        Self { bar, told }
    }

    /// Shows what share of a stage is done, from 0 to 1, and a note on how it goes. Where there is no terminal, a line for
    /// each quarter.
    pub fn tell(&self, stage: &str, share: f32, note: &str) {
        let share = share.clamp(0.0, 1.0);
        let Some(told) = &self.told else {
            self.bar.set_message(format!("{stage} {note}"));
            self.bar.set_position((share * 1e3) as u64);
            return;
        };
        let quarter = (share * 4.0) as u64;
        let mut told = told.borrow_mut();
        if told.0 != stage || told.1 < quarter {
            *told = (stage.to_owned(), quarter);
            // A reader that has gone must not end the work.
            let _ = writeln!(io::stderr(), "{stage}: {:.0} % {note}", share * 100.0);
        }
    }

    /// Clears the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
