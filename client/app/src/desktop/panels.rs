//! The panels: help, people and the plan. One of them is open at a time.

use std::sync::Arc;

use sightline_client_core::replica::ShownAvatar;
use sightline_renderer::{
    Frame,
    plan::{self, PlanMark},
    text,
};
use sightline_world::{
    motion::{AvatarId, Pose},
    plan::Plan,
};

use super::overlay::{PLAIN, STRONG, line_height, scale};

/// Which panel is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PanelKind {
    Help,
    People,
    Plan,
}

/// An open panel at one moment.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Panel {
    /// Lines in two columns.
    Table { title: String, rows: Vec<Row> },
    /// The plan of a storey, and who is where on it.
    Plan { plan: Arc<Plan>, marks: Vec<PlanMark> },
}

/// A row of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Row {
    /// The colour of a patch before the row, sRGB.
    patch: Option<[u8; 3]>,
    left: String,
    right: String,
}

/// The keys and what they do.
const KEYS: &[(&str, &str)] = &[
    ("W A S D", "walk"),
    ("click", "look around with the mouse"),
    ("arrows", "look around"),
    ("Shift", "run"),
    ("Space", "jump"),
    ("F", "fly, with Space and C up and down"),
    ("Home", "go back to the entrance"),
    ("M", "the plan of this storey"),
    ("Tab", "the people near you"),
    ("Enter", "say something"),
    ("R", "outlines of the rooms"),
    ("V", "what rooms hide from you"),
    ("F1", "this help"),
    ("F3", "statistics"),
    ("Escape", "close this, free the mouse, leave"),
];

/// What only works without others.
const KEYS_ALONE: &[(&str, &str)] =
    &[("Ctrl 1-9", "bookmark the view"), ("1-9", "fly to a bookmarked view")];

/// The number of people that are listed.
const PEOPLE_MAX: usize = 24;

/// The help. Some keys only work without a server.
pub(super) fn help(is_alone: bool) -> Panel {
    let keys = KEYS.iter().chain(if is_alone { KEYS_ALONE } else { &[] });
    let row = |(key, what): &(&str, &str)| Row {
        patch: None,
        left: (*key).to_owned(),
        right: (*what).to_owned(),
    };
    Panel::Table { title: "Keys".to_owned(), rows: keys.map(row).collect() }
}

/// The people of whom the server tells this client, the nearest first.
pub(super) fn people(own: &Pose, told: &[ShownAvatar], in_sight: &[AvatarId]) -> Panel {
    let metres = |other: &ShownAvatar| own.eye.distance(other.pose.eye).round() as u32;
    let mut others: Vec<&ShownAvatar> = told.iter().collect();
    others.sort_by_key(|other| (metres(other), other.id));
    let row = |other: &&ShownAvatar| {
        let sight = if in_sight.contains(&other.id) { "in sight" } else { "out of sight" };
        let right = format!("{:>3} m, {sight}", metres(other));
        Row { patch: Some(other.colour), left: other.name.clone(), right }
    };
    let mut rows: Vec<Row> = others.iter().take(PEOPLE_MAX).map(row).collect();
    if others.len() > PEOPLE_MAX {
        let left = format!("and {} more", others.len() - PEOPLE_MAX);
        rows.push(Row { patch: None, left, right: String::new() });
    }
    let title = match others.len() {
        0 => "Nobody is near you".to_owned(),
        1 => "One person is near you".to_owned(),
        count => format!("{count} people are near you"),
    };
    Panel::Table { title, rows }
}

impl Panel {
    /// Draws the panel in the middle of a picture.
    pub(super) fn draw(&self, frame: &mut Frame) {
        match self {
            Self::Table { title, rows } => draw_table(frame, title, rows),
            Self::Plan { plan, marks } => plan::draw(plan, frame, marks),
        }
    }
}

fn draw_table(frame: &mut Frame, title: &str, rows: &[Row]) {
    let (scale, height) = (scale(frame), line_height(frame) as i32);
    let letters = |text: &str| text.chars().count();
    let left = rows.iter().map(|row| letters(&row.left)).max().unwrap_or(0);
    let right = rows.iter().map(|row| letters(&row.right)).max().unwrap_or(0);
    let patches = if rows.iter().any(|row| row.patch.is_some()) { 2 } else { 0 };
    let across = letters(title).max(patches + left + 2 + right) + 4;
    let side = (text::LETTER * scale) as i32;
    let (width, tall) = (across as i32 * side, (rows.len() as i32 + 4) * height);
    let [x, y] =
        [(frame.width() as i32 - width) / 2, ((frame.height() as i32 - tall) / 2).max(height)];
    for _ in 0..2 {
        text::darken(frame, [x, y], [width as usize, tall as usize]);
    }
    let x = x + 2 * side;
    text::draw(frame, [x, y + height], scale, STRONG, title);
    for (row, number) in rows.iter().zip(3..) {
        let y = y + number * height;
        if let Some([r, g, b]) = row.patch {
            let edge = text::LETTER * scale;
            text::fill(frame, [x, y], [edge, edge], u32::from_be_bytes([0, r, g, b]));
        }
        let x = x + patches as i32 * side;
        text::draw(frame, [x, y], scale, STRONG, &row.left);
        text::draw(frame, [x + (left as i32 + 2) * side, y], scale, PLAIN, &row.right);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn people_are_listed_by_distance_and_the_rest_is_counted() {
        let other = |id: u32, x: f32| ShownAvatar {
            id: AvatarId(id),
            name: format!("P{id}"),
            colour: [1, 2, 3],
            pose: Pose { eye: Vec3::X * x, ..Pose::default() },
        };
        let told: Vec<ShownAvatar> = (0..30).map(|id| other(id, 30.0 - id as f32)).collect();
        let Panel::Table { title, rows } = people(&Pose::default(), &told, &[AvatarId(29)]) else {
            panic!("a table");
        };
        assert_eq!(title, "30 people are near you");
        assert_eq!((rows[0].left.as_str(), rows[0].right.as_str()), ("P29", "  1 m, in sight"));
        assert_eq!(rows[1].right, "  2 m, out of sight");
        assert_eq!((rows.len(), rows[PEOPLE_MAX].left.as_str()), (PEOPLE_MAX + 1, "and 6 more"));
    }

    #[test]
    fn the_help_fits_the_window_that_opens() {
        let mut frame = Frame::new(960, 540);
        frame.colour.fill(0x00ff_ffff);
        help(true).draw(&mut frame);
        let is_dark = |x: usize, y: usize| frame.colour[y * 960 + x] != 0x00ff_ffff;
        assert!(is_dark(480, 270) && !is_dark(480, 2) && !is_dark(480, 537) && !is_dark(5, 270));
    }
}
