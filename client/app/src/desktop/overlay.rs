//! What is written over the picture: the status, the chat, the line being typed, banners and
//! panels.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use sightline_renderer::{Frame, text};

use super::{link::Notice, panels::Panel};

/// What is written over the picture at one moment.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Overlay {
    /// The line at the top.
    pub(super) status: String,
    /// The line below it.
    pub(super) statistics: Option<String>,
    /// The lines at the bottom, the oldest first.
    pub(super) lines: Vec<String>,
    /// The line being typed, below them.
    pub(super) typed: Option<String>,
    /// What is written across the middle.
    pub(super) notice: Option<Notice>,
    pub(super) panel: Option<Panel>,
}

/// The last lines of chat and notices.
#[derive(Default)]
pub(super) struct Log {
    lines: VecDeque<(Instant, String)>,
}

/// How long a line is shown.
const SHOWN: Duration = Duration::from_secs(20);

/// The largest number of lines shown.
const LINES_MAX: usize = 8;

pub(super) const PLAIN: u32 = 0x00f0_f4f8;
pub(super) const STRONG: u32 = 0x00ff_f6d8;
const TYPED: u32 = 0x00b8_f0c0;
const BAR: u32 = 0x0058_a070;

impl Log {
    pub(super) fn add(&mut self, now: Instant, line: String) {
        self.lines.push_back((now, line));
        if self.lines.len() > LINES_MAX {
            self.lines.pop_front();
        }
    }

    /// The lines that are still shown, the oldest first.
    pub(super) fn shown(&self, now: Instant) -> Vec<String> {
        let fresh = |(at, _): &&(Instant, String)| now.saturating_duration_since(*at) < SHOWN;
        self.lines.iter().filter(fresh).map(|(_, line)| line.clone()).collect()
    }
}

impl Overlay {
    /// Writes over a picture.
    pub(super) fn draw(&self, frame: &mut Frame) {
        if !self.status.is_empty() {
            line(frame, 0, PLAIN, &self.status);
        }
        if let Some(statistics) = &self.statistics {
            line(frame, line_height(frame) as i32, PLAIN, statistics);
        }
        self.draw_lines(frame);
        if let Some(panel) = &self.panel {
            panel.draw(frame);
        }
        if let Some(notice) = &self.notice {
            draw_notice(frame, notice);
        }
    }

    /// Writes the lines from the bottom upward, above the line being typed.
    fn draw_lines(&self, frame: &mut Frame) {
        let height = line_height(frame);
        let mut y = frame.height() as i32 - height as i32;
        if let Some(typed) = &self.typed {
            // Show the end of a long line: that is where the person types.
            let room = letters_in(frame).saturating_sub(4);
            let hidden = typed.chars().count().saturating_sub(room);
            let end: String = typed.chars().skip(hidden).collect();
            line(frame, y, TYPED, &format!("> {end}_"));
            y -= height as i32;
        }
        for said in self.lines.iter().rev() {
            for part in wrapped(said, letters_in(frame)).into_iter().rev() {
                line(frame, y, STRONG, &part);
                y -= height as i32;
            }
        }
    }
}

/// Draws a notice in a box across the middle, with a bar where its share is known. The letters of
/// the title are larger.
fn draw_notice(frame: &mut Frame, notice: &Notice) {
    let (height, own) = (line_height(frame) as i32, scale(frame));
    let room = letters_in(frame).saturating_sub(2).max(1);
    let (large, in_title) = (own + 1, (room * own / (own + 1)).max(1));
    let title = wrapped(&notice.title, in_title);
    let title = title.into_iter().map(|part| (large, STRONG, part));
    let note = wrapped(&notice.note, room).into_iter().map(|part| (own, PLAIN, part));
    let lines: Vec<(usize, u32, String)> = title.chain(note).collect();
    let line_px = |scale: usize| ((text::LETTER + 6) * scale) as i32;
    let tall: i32 = lines.iter().map(|(scale, ..)| line_px(*scale)).sum();
    let tall = tall + 2 * height + if notice.share.is_some() { height } else { 0 };
    let top = (frame.height() as i32 - tall) / 2;
    let width = frame.width();
    for _ in 0..2 {
        text::darken(frame, [0, top], [width, tall as usize]);
    }
    let mut y = top + height;
    for (scale, colour, part) in lines {
        let x = (width as i32 - text::width(&part, scale) as i32) / 2;
        text::draw(frame, [x, y + 3 * scale as i32], scale, colour, &part);
        y += line_px(scale);
    }
    if let Some(share) = notice.share {
        let (long, thick) = (width / 2, (height / 2) as usize);
        let at = [(width / 4) as i32, y + height / 4];
        text::darken(frame, at, [long, thick]);
        let done = (long as f32 * share.clamp(0.0, 1.0)) as usize;
        text::fill(frame, at, [done, thick], BAR);
    }
}

fn line(frame: &mut Frame, y: i32, colour: u32, said: &str) {
    let (scale, height) = (scale(frame), line_height(frame));
    let width = text::width(said, scale) + 8 * scale;
    text::darken(frame, [0, y], [width, height]);
    text::draw(frame, [4 * scale as i32, y + 2 * scale as i32], scale, colour, said);
}

/// Letters are twice as large in tall windows.
pub(super) fn scale(frame: &Frame) -> usize {
    1 + frame.height() / 900
}

pub(super) fn line_height(frame: &Frame) -> usize {
    (text::LETTER + 4) * scale(frame)
}

/// How many letters fit in a line.
pub(super) fn letters_in(frame: &Frame) -> usize {
    (frame.width() / (text::LETTER * scale(frame))).saturating_sub(1).max(1)
}

/// Cuts a text into lines that fit, between words where that is possible.
fn wrapped(said: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    let mut line: Vec<char> = Vec::new();
    for letter in said.chars() {
        if line.len() == letters {
            let end = line.iter().rposition(|letter| *letter == ' ').filter(|end| *end > 0);
            let rest = line.split_off(end.map_or(letters, |end| end + 1));
            lines.push(String::from_iter(&line).trim_end().to_owned());
            line = rest;
        }
        line.push(letter);
    }
    lines.extend((!line.is_empty()).then(|| String::from_iter(&line)));
    lines
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn drawn(overlay: &Overlay) -> Frame {
        let mut frame = Frame::new(240, 160);
        overlay.draw(&mut frame);
        frame
    }

    fn pixels_of(frame: &Frame, colour: u32) -> usize {
        frame.colour.iter().filter(|&&pixel| pixel == colour).count()
    }

    #[test]
    fn old_lines_disappear_and_the_end_of_a_long_typed_one_is_shown() {
        let now = Instant::now();
        let mut log = Log::default();
        for i in 0..20 {
            log.add(now, format!("{i}"));
        }
        let lines = log.shown(now);
        assert_eq!((lines.len(), lines[0].as_str()), (LINES_MAX, "12"));
        assert!(log.shown(now + SHOWN).is_empty());
        assert!(pixels_of(&drawn(&Overlay { lines, ..Overlay::default() }), STRONG) > 50);
        let typed = Some("é".repeat(300));
        assert!(pixels_of(&drawn(&Overlay { typed, ..Overlay::default() }), TYPED) > 10);
    }

    #[test]
    fn a_long_notice_stays_in_the_middle_and_its_bar_grows() {
        let with = |share| {
            let notice = Notice {
                title: "one two three four".to_owned(),
                note: "five six".to_owned(),
                share,
            };
            drawn(&Overlay { notice: Some(notice), ..Overlay::default() })
        };
        let frame = with(None);
        let rows: Vec<bool> = frame.colour.chunks(240).map(|row| row.contains(&STRONG)).collect();
        assert!(rows[40..120].contains(&true), "in the middle");
        assert!(!rows[..30].contains(&true) && !rows[130..].contains(&true), "nowhere else");
        let bar = |share| pixels_of(&with(Some(share)), BAR);
        assert!(bar(0.0) == 0 && 0 < bar(0.2) && bar(0.2) < bar(0.9));
    }

    proptest! {
        #[test]
        fn wrapped_lines_fit_and_keep_every_word(said in "[a-c ]{0,60}", letters in 1..12_usize) {
            let lines = wrapped(&said, letters);
            prop_assert!(lines.iter().all(|line| line.chars().count() <= letters));
            let letters_of = |text: &str| text.replace(' ', "");
            prop_assert_eq!(letters_of(&lines.concat()), letters_of(&said));
        }
    }
}
