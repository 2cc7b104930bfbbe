//! Turns keys and mouse motion into wishes for the walker and actions.

use std::collections::HashSet;

use sightline_client_core::{gaze::Gaze, walker::MoveInput};
use sightline_protocol::text::LINE_CHARS_MAX;
use sightline_world::motion::Pose;
use winit::keyboard::KeyCode;

use super::panels::PanelKind;

/// An action of a key, besides movement.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Say something to the others.
    Say(String),
    /// Bookmark the view under this number, from 0.
    Bookmark(usize),
    /// Fly to the bookmark with this number, from 0.
    Fly(usize),
    /// Open or close a panel.
    Panel(PanelKind),
    /// Show or hide statistics.
    Statistics,
    /// Go back to the entrance.
    Home,
    /// Show or hide the outlines of rooms.
    Rooms,
    /// Draw what rooms hide from the eye, or leave it out.
    Hidden,
    /// Close the panel, or else the window.
    Leave,
}

/// The keys held, the direction of view, and the line being typed.
#[derive(Clone, Debug, Default)]
pub(super) struct Controls {
    held: HashSet<KeyCode>,
    gaze: Gaze,
    flying: bool,
    line: Option<String>,
}

/// Radians per pixel of mouse motion.
const MOUSE_TURN: f32 = 0.0022;

/// Radians per second while an arrow key is held.
const KEY_TURN: f32 = 1.8;

/// The share of the top speed without Shift.
const WALK_SHARE: f32 = 0.6;

impl Controls {
    /// Takes the direction of view from a pose.
    pub(super) fn face(&mut self, pose: &Pose) {
        self.gaze.face(pose);
    }

    /// A key goes down or up. `text` is what it types.
    pub(super) fn key(&mut self, code: KeyCode, down: bool, text: Option<&str>) -> Option<Action> {
        if !down {
            self.held.remove(&code);
            return None;
        }
        if self.line.is_some() {
            return self.type_key(code, text);
        }
        match code {
            KeyCode::Escape => return Some(Action::Leave),
            KeyCode::Enter | KeyCode::NumpadEnter => {
                self.held.clear();
                self.line = Some(String::new());
            }
            code if number(code).is_some() && !self.held.contains(&code) => {
                let bookmarks =
                    self.holds(KeyCode::ControlLeft) || self.holds(KeyCode::ControlRight);
                self.held.insert(code);
                return number(code).map(if bookmarks { Action::Bookmark } else { Action::Fly });
            }
            KeyCode::KeyF if !self.held.contains(&code) => self.flying = !self.flying,
            _ => (),
        }
        let is_pressed = self.line.is_none() && self.held.insert(code);
        if is_pressed { switch(code) } else { None }
    }

    fn type_key(&mut self, code: KeyCode, text: Option<&str>) -> Option<Action> {
        let line = self.line.as_mut()?;
        match code {
            KeyCode::Escape => self.line = None,
            KeyCode::Enter | KeyCode::NumpadEnter => {
                let line = self.line.take().filter(|line| !line.trim().is_empty());
                return line.map(Action::Say);
            }
            KeyCode::Backspace => {
                line.pop();
            }
            _ => {
                let room = LINE_CHARS_MAX.saturating_sub(line.chars().count());
                let typed = text.unwrap_or_default().chars().filter(|c| !c.is_control());
                line.extend(typed.take(room));
            }
        }
        None
    }

    /// The mouse moves while it is grabbed, in pixels.
    pub(super) fn look(&mut self, right: f64, down: f64) {
        self.gaze.turn(-right as f32 * MOUSE_TURN, -down as f32 * MOUSE_TURN);
    }

    /// Forgets the held keys: another window has the focus.
    pub(super) fn release(&mut self) {
        self.held.clear();
    }

    /// The line being typed, if any.
    pub(super) fn line(&self) -> Option<&str> {
        self.line.as_deref()
    }

    /// The wish for the next `dt_s` seconds.
    pub(super) fn wish(&mut self, dt_s: f32) -> MoveInput {
        let turn = KEY_TURN * dt_s;
        let left = self.axis(KeyCode::ArrowLeft, KeyCode::ArrowRight) * turn;
        let up = self.axis(KeyCode::ArrowUp, KeyCode::ArrowDown) * turn;
        self.gaze.turn(left, up);
        let runs = self.holds(KeyCode::ShiftLeft) || self.holds(KeyCode::ShiftRight);
        let share = if runs { 1.0 } else { WALK_SHARE };
        let (forward, right) =
            (self.axis(KeyCode::KeyW, KeyCode::KeyS), self.axis(KeyCode::KeyD, KeyCode::KeyA));
        // Diagonal steps are no faster than straight ones.
        let share = share / forward.hypot(right).max(1.0);
        MoveInput {
            forward: forward * share,
            right: right * share,
            up: self.axis(KeyCode::Space, KeyCode::KeyC) * share,
            yaw: self.gaze.yaw(),
            pitch: self.gaze.pitch(),
            fly: self.flying,
            jump: self.holds(KeyCode::Space),
        }
    }

    fn holds(&self, code: KeyCode) -> bool {
        self.held.contains(&code)
    }

    /// The value of an axis: 1, -1 or 0.
    fn axis(&self, more: KeyCode, less: KeyCode) -> f32 {
        f32::from(u8::from(self.holds(more))) - f32::from(u8::from(self.holds(less)))
    }
}

/// What a key switches.
fn switch(code: KeyCode) -> Option<Action> {
    match code {
        KeyCode::F1 => Some(Action::Panel(PanelKind::Help)),
        KeyCode::Tab => Some(Action::Panel(PanelKind::People)),
        KeyCode::KeyM => Some(Action::Panel(PanelKind::Plan)),
        KeyCode::F3 => Some(Action::Statistics),
        KeyCode::Home => Some(Action::Home),
        KeyCode::KeyR => Some(Action::Rooms),
        KeyCode::KeyV => Some(Action::Hidden),
        _ => None,
    }
}

/// The number of one of the keys 1 to 9, from 0.
fn number(code: KeyCode) -> Option<usize> {
    const KEYS: [KeyCode; 9] = [
        KeyCode::Digit1,
        KeyCode::Digit2,
        KeyCode::Digit3,
        KeyCode::Digit4,
        KeyCode::Digit5,
        KeyCode::Digit6,
        KeyCode::Digit7,
        KeyCode::Digit8,
        KeyCode::Digit9,
    ];
    KEYS.iter().position(|key| *key == code)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(controls: &mut Controls, code: KeyCode, text: &str) -> Option<Action> {
        controls.key(code, true, Some(text))
    }

    #[test]
    fn held_keys_become_wishes() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyW, "w");
        press(&mut controls, KeyCode::ShiftLeft, "");
        assert_eq!(controls.wish(0.1).forward, 1.0);
        press(&mut controls, KeyCode::KeyD, "d");
        let wish = controls.wish(0.1);
        assert!((wish.forward.hypot(wish.right) - 1.0).abs() < 1.0e-6);
        controls.key(KeyCode::KeyW, false, None);
        controls.key(KeyCode::ShiftLeft, false, None);
        assert_eq!((controls.wish(0.1).forward, controls.wish(0.1).right), (0.0, WALK_SHARE));
        controls.release();
        assert_eq!(controls.wish(0.1), MoveInput::default());
    }

    #[test]
    fn each_press_of_f_switches_flying_once() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyF, "f");
        press(&mut controls, KeyCode::KeyF, "f");
        assert!(controls.wish(0.1).fly, "a held key repeats");
        controls.key(KeyCode::KeyF, false, None);
        press(&mut controls, KeyCode::KeyF, "f");
        assert!(!controls.wish(0.1).fly);
    }

    #[test]
    fn numbers_bookmark_views_and_fly_to_them() {
        let mut controls = Controls::default();
        assert_eq!(press(&mut controls, KeyCode::Digit3, "3"), Some(Action::Fly(2)));
        assert_eq!(press(&mut controls, KeyCode::Digit3, "3"), None, "a held key repeats");
        press(&mut controls, KeyCode::ControlLeft, "");
        assert_eq!(press(&mut controls, KeyCode::Digit9, "9"), Some(Action::Bookmark(8)));
        controls.release();
        press(&mut controls, KeyCode::Enter, "\r");
        assert_eq!(press(&mut controls, KeyCode::Digit1, "1"), None);
        assert_eq!(controls.line(), Some("1"));
    }

    #[test]
    fn each_press_of_a_switch_counts_once_except_while_typing() {
        let mut controls = Controls::default();
        let switches = [
            (KeyCode::F1, Action::Panel(PanelKind::Help)),
            (KeyCode::Tab, Action::Panel(PanelKind::People)),
            (KeyCode::KeyM, Action::Panel(PanelKind::Plan)),
            (KeyCode::F3, Action::Statistics),
            (KeyCode::Home, Action::Home),
            (KeyCode::KeyR, Action::Rooms),
            (KeyCode::KeyV, Action::Hidden),
        ];
        for (code, action) in &switches {
            assert_eq!(press(&mut controls, *code, ""), Some(action.clone()));
            assert_eq!(press(&mut controls, *code, ""), None, "a held key repeats");
            controls.key(*code, false, None);
        }
        press(&mut controls, KeyCode::Enter, "\r");
        assert!(switches.iter().all(|(code, _)| press(&mut controls, *code, "").is_none()));
    }

    #[test]
    fn a_typed_line_is_said_on_enter() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyW, "w");
        assert_eq!(press(&mut controls, KeyCode::Enter, "\r"), None);
        assert_eq!(controls.wish(0.1).forward, 0.0, "typed letters do not move the walker");
        for letter in ["h", "i", "\u{8}", "!"] {
            press(&mut controls, KeyCode::KeyW, letter);
        }
        press(&mut controls, KeyCode::Backspace, "\u{8}");
        press(&mut controls, KeyCode::KeyW, &"x".repeat(999));
        assert_eq!(controls.line().map(|line| line.chars().count()), Some(LINE_CHARS_MAX));
        (0..LINE_CHARS_MAX - 2).for_each(|_| {
            press(&mut controls, KeyCode::Backspace, "");
        });
        assert_eq!(press(&mut controls, KeyCode::Enter, "\r"), Some(Action::Say("hi".into())));
        assert_eq!(controls.wish(0.1).forward, 0.0);
    }

    #[test]
    fn escape_first_drops_the_line_and_then_leaves() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::Enter, "\r");
        press(&mut controls, KeyCode::KeyA, "a");
        assert_eq!(press(&mut controls, KeyCode::Escape, ""), None);
        assert_eq!(controls.line(), None);
        assert_eq!(press(&mut controls, KeyCode::Escape, ""), Some(Action::Leave));
        press(&mut controls, KeyCode::Enter, "\r");
        assert_eq!(press(&mut controls, KeyCode::Enter, "\r"), None, "an empty line is not said");
    }
}
