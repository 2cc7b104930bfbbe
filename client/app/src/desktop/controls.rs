//! Keys and mouse in; wishes, and what is said, out.

use std::{collections::HashSet, f32::consts::FRAC_PI_2};

use sightline_protocol::text::LINE_CHARS_MAX;
use sightline_world::motion::Pose;
use winit::keyboard::KeyCode;

use sightline_client_core::walker::MoveInput;

/// What a key does besides moving.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Tell the others.
    Say(String),
    /// Keep the view as a bookmark with this number, from 0.
    Keep(usize),
    /// Fly to that.
    Fly(usize),
    /// Close the window.
    Leave,
}

/// What is held, where the look is turned, and what is being typed.
#[derive(Clone, Debug, Default)]
pub(super) struct Controls {
    held: HashSet<KeyCode>,
    yaw: f32,
    pitch: f32,
    flying: bool,
    rooms: bool,
    line: Option<String>,
}

/// Radians for each pixel of the mouse.
const MOUSE_TURN: f32 = 0.0022;

/// Radians a second while an arrow key is held.
const KEY_TURN: f32 = 1.8;

/// Straight up is where the look would turn over.
const PITCH_MAX: f32 = FRAC_PI_2 - 0.01;

/// The part of the greatest speed without Shift.
const WALK_SHARE: f32 = 0.6;

impl Controls {
    /// Turns the look to that of a pose.
    pub(super) fn face(&mut self, pose: &Pose) {
        (self.yaw, self.pitch) = (pose.yaw, pose.pitch);
    }

    /// A key goes down or up; `text` is what it types.
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
                let keeps = self.holds(KeyCode::ControlLeft) || self.holds(KeyCode::ControlRight);
                self.held.insert(code);
                return number(code).map(if keeps { Action::Keep } else { Action::Fly });
            }
            KeyCode::KeyF if !self.held.contains(&code) => self.flying = !self.flying,
            KeyCode::KeyR if !self.held.contains(&code) => self.rooms = !self.rooms,
            _ => (),
        }
        if self.line.is_none() {
            self.held.insert(code);
        }
        None
    }

    fn type_key(&mut self, code: KeyCode, text: Option<&str>) -> Option<Action> {
        let line = self.line.as_mut()?;
        match code {
            KeyCode::Escape => self.line = None,
            KeyCode::Enter | KeyCode::NumpadEnter => {
                let said = self.line.take().filter(|line| !line.trim().is_empty());
                return said.map(Action::Say);
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

    /// The mouse moved while it turns the look.
    pub(super) fn look(&mut self, right: f64, down: f64) {
        self.turn(-right as f32 * MOUSE_TURN, -down as f32 * MOUSE_TURN);
    }

    fn turn(&mut self, left: f32, up: f32) {
        self.yaw = (self.yaw + left).rem_euclid(std::f32::consts::TAU);
        self.pitch = (self.pitch + up).clamp(-PITCH_MAX, PITCH_MAX);
    }

    /// Nothing is held any more: another window has the keys.
    pub(super) fn release(&mut self) {
        self.held.clear();
    }

    /// Whether rooms are to be drawn.
    pub(super) fn shows_rooms(&self) -> bool {
        self.rooms
    }

    /// What is being typed.
    pub(super) fn line(&self) -> Option<&str> {
        self.line.as_deref()
    }

    /// What is wanted for the next `dt_s` seconds.
    pub(super) fn wish(&mut self, dt_s: f32) -> MoveInput {
        let turn = KEY_TURN * dt_s;
        let left = self.axis(KeyCode::ArrowLeft, KeyCode::ArrowRight) * turn;
        let up = self.axis(KeyCode::ArrowUp, KeyCode::ArrowDown) * turn;
        self.turn(left, up);
        let runs = self.holds(KeyCode::ShiftLeft) || self.holds(KeyCode::ShiftRight);
        let share = if runs { 1.0 } else { WALK_SHARE };
        let (forward, right) =
            (self.axis(KeyCode::KeyW, KeyCode::KeyS), self.axis(KeyCode::KeyD, KeyCode::KeyA));
        // Across is not faster than along.
        let share = share / forward.hypot(right).max(1.0);
        MoveInput {
            forward: forward * share,
            right: right * share,
            up: self.axis(KeyCode::Space, KeyCode::KeyC) * share,
            yaw: self.yaw,
            pitch: self.pitch,
            fly: self.flying,
            jump: self.holds(KeyCode::Space),
        }
    }

    fn holds(&self, code: KeyCode) -> bool {
        self.held.contains(&code)
    }

    /// 1, -1 or 0.
    fn axis(&self, more: KeyCode, less: KeyCode) -> f32 {
        f32::from(u8::from(self.holds(more))) - f32::from(u8::from(self.holds(less)))
    }
}

/// Which of the keys 1 to 9 it is, from 0.
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
    fn keys_become_wishes() {
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
    fn flying_is_switched_once_for_each_press() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyF, "f");
        press(&mut controls, KeyCode::KeyF, "f");
        assert!(controls.wish(0.1).fly, "a held key repeats");
        controls.key(KeyCode::KeyF, false, None);
        press(&mut controls, KeyCode::KeyF, "f");
        assert!(!controls.wish(0.1).fly);
    }

    #[test]
    fn numbers_are_views() {
        let mut controls = Controls::default();
        assert_eq!(press(&mut controls, KeyCode::Digit3, "3"), Some(Action::Fly(2)));
        assert_eq!(press(&mut controls, KeyCode::Digit3, "3"), None, "a held key repeats");
        press(&mut controls, KeyCode::ControlLeft, "");
        assert_eq!(press(&mut controls, KeyCode::Digit9, "9"), Some(Action::Keep(8)));
        controls.release();
        press(&mut controls, KeyCode::Enter, "\r");
        assert_eq!(press(&mut controls, KeyCode::Digit1, "1"), None);
        assert_eq!(controls.line(), Some("1"));
    }

    #[test]
    fn rooms_are_switched_but_not_while_typing() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyR, "r");
        press(&mut controls, KeyCode::KeyR, "r");
        assert!(controls.shows_rooms(), "a held key repeats");
        controls.key(KeyCode::KeyR, false, None);
        press(&mut controls, KeyCode::Enter, "\r");
        press(&mut controls, KeyCode::KeyR, "r");
        assert!(controls.shows_rooms());
        press(&mut controls, KeyCode::Escape, "");
        press(&mut controls, KeyCode::KeyR, "r");
        assert!(!controls.shows_rooms());
    }

    #[test]
    fn a_line_is_typed_and_said() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::KeyW, "w");
        assert_eq!(press(&mut controls, KeyCode::Enter, "\r"), None);
        assert_eq!(controls.wish(0.1).forward, 0.0, "typing does not walk");
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
    fn escape_first_drops_the_line_then_leaves() {
        let mut controls = Controls::default();
        press(&mut controls, KeyCode::Enter, "\r");
        press(&mut controls, KeyCode::KeyA, "a");
        assert_eq!(press(&mut controls, KeyCode::Escape, ""), None);
        assert_eq!(controls.line(), None);
        assert_eq!(press(&mut controls, KeyCode::Escape, ""), Some(Action::Leave));
        press(&mut controls, KeyCode::Enter, "\r");
        assert_eq!(press(&mut controls, KeyCode::Enter, "\r"), None, "nothing is not said");
    }

    #[test]
    fn the_look_does_not_turn_over() {
        let mut controls = Controls::default();
        controls.look(1.0e6, -1.0e6);
        let wish = controls.wish(0.0);
        assert!(wish.pitch < FRAC_PI_2 && wish.pitch > 1.5);
        assert!((0.0..=std::f32::consts::TAU).contains(&wish.yaw));
    }
}
