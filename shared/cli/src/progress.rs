//! How long tasks show that they go on: a bar on a terminal, plain lines elsewhere.

use std::{
    io::{IsTerminal, Write, stderr},
    sync::Mutex,
};

use indicatif::{ProgressBar, ProgressStyle};

/// Shows the share done of one named stage after another, on stderr.
pub struct Progress {
    bar: ProgressBar,
    /// The stage and the tenth last told, where there is no terminal.
    told: Option<Mutex<(String, u32)>>,
}

impl Default for Progress {
    fn default() -> Self {
        Self::new()
    }
}

impl Progress {
    /// A bar on a terminal, plain lines elsewhere.
    pub fn new() -> Self {
        if !stderr().is_terminal() {
            let told = Some(Mutex::new((String::new(), 0)));
            return Self { bar: ProgressBar::hidden(), told };
        }
        let style = ProgressStyle::with_template("{msg:<20} [{bar:40}] {percent:>3} %  {elapsed}")
            .expect("the template is valid")
            .progress_chars("=> ");
        Self { bar: ProgressBar::new(1000).with_style(style), told: None }
    }

    /// Shows a share from 0 to 1.
    pub fn show(&self, stage: &str, share: f32) {
        let share = share.clamp(0.0, 1.0);
        if let Some(told) = &self.told {
            let mut told = told.lock().expect("no holder panics");
            let tenth = (share * 10.0) as u32;
            if told.0 != stage || tenth > told.1 {
                *told = (stage.to_owned(), tenth);
                // A reader that has gone must not end the work.
                let _ = writeln!(stderr(), "{stage}: {} %", tenth * 10);
            }
            return;
        }
        if self.bar.message() != stage {
            self.bar.set_message(stage.to_owned());
        }
        self.bar.set_position((share * 1000.0) as u64);
    }

    /// Clears the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
