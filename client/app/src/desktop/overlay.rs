//! Text over the picture: the status line, the chat, and the line being typed.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use sightline_renderer::{Frame, text};

/// The last lines of chat and notices.
#[derive(Default)]
pub(super) struct Log {
    lines: VecDeque<(Instant, String)>,
}

/// How long a line is shown.
const SHOWN: Duration = Duration::from_secs(20);

/// The largest number of lines shown.
const LINES_MAX: usize = 8;

const STATUS: u32 = 0x00f0_f4f8;
const SAID: u32 = 0x00ff_f6d8;
const TYPED: u32 = 0x00b8_f0c0;

impl Log {
    pub(super) fn add(&mut self, now: Instant, line: String) {
        self.lines.push_back((now, line));
        if self.lines.len() > LINES_MAX {
            self.lines.pop_front();
        }
    }

    /// Draws the lines from the bottom upward, above the line being typed.
    pub(super) fn draw(&self, frame: &mut Frame, now: Instant, typed: Option<&str>) {
        let height = line_height(frame);
        let mut y = frame.height() as i32 - height as i32;
        if let Some(typed) = typed {
            // Show the end of a long line: that is where the person types.
            let room = letters_in(frame).saturating_sub(4);
            let hidden = typed.chars().count().saturating_sub(room);
            let end: String = typed.chars().skip(hidden).collect();
            line(frame, y, TYPED, &format!("> {end}_"));
            y -= height as i32;
        }
        let fresh = |at: &Instant| now.saturating_duration_since(*at) < SHOWN;
        for (_, said) in self.lines.iter().rev().filter(|(at, _)| fresh(at)) {
            for part in wrapped(said, letters_in(frame)).into_iter().rev() {
                line(frame, y, SAID, &part);
                y -= height as i32;
            }
        }
    }
}

/// Draws the status line at the top.
pub(super) fn status(frame: &mut Frame, status: &str) {
    line(frame, 0, STATUS, status);
}

/// Draws a notice across the middle.
pub(super) fn banner(frame: &mut Frame, notice: &str) {
    let height = line_height(frame) as i32;
    let parts = wrapped(notice, letters_in(frame));
    let mut y = (frame.height() as i32 - height * parts.len() as i32) / 2;
    for part in parts {
        line(frame, y, TYPED, &part);
        y += height;
    }
}

fn line(frame: &mut Frame, y: i32, colour: u32, said: &str) {
    let (scale, height) = (scale(frame), line_height(frame));
    let width = text::width(said, scale) + 8 * scale;
    text::darken(frame, [0, y], [width, height]);
    text::draw(frame, [4 * scale as i32, y + 2 * scale as i32], scale, colour, said);
}

/// Letters are twice as large in tall windows.
fn scale(frame: &Frame) -> usize {
    1 + frame.height() / 900
}

fn line_height(frame: &Frame) -> usize {
    (text::LETTER + 4) * scale(frame)
}

fn letters_in(frame: &Frame) -> usize {
    (frame.width() / (text::LETTER * scale(frame))).saturating_sub(1).max(1)
}

/// Cuts a line into parts that fit.
fn wrapped(said: &str, letters: usize) -> Vec<String> {
    let letters_all: Vec<char> = said.chars().collect();
    letters_all.chunks(letters).map(|part| part.iter().collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_wrapped_and_old_ones_disappear() {
        assert_eq!(wrapped("abcdefgh", 3), ["abc", "def", "gh"]);
        let now = Instant::now();
        let mut log = Log::default();
        for i in 0..20 {
            log.add(now, format!("{i}"));
        }
        assert_eq!(log.lines.len(), LINES_MAX);
        let drawn = |at: Instant, typed: Option<&str>| {
            let mut frame = Frame::new(80, 160);
            log.draw(&mut frame, at, typed);
            frame.colour.iter().filter(|&&pixel| pixel == SAID || pixel == TYPED).count()
        };
        assert!(drawn(now, None) > 50);
        assert_eq!(drawn(now + SHOWN, None), 0);
        assert!(drawn(now + SHOWN, Some(&"é".repeat(300))) > 10);
    }

    #[test]
    fn a_long_banner_stays_in_the_frame() {
        let mut frame = Frame::new(80, 160);
        banner(&mut frame, "one two three four five six");
        let rows: Vec<bool> = frame.colour.chunks(80).map(|row| row.contains(&TYPED)).collect();
        assert!(rows[60..100].contains(&true) && !rows[..40].contains(&true), "in the middle");
    }
}
