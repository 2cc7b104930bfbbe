//! The window: a thin shell around the renderer, the walker and a session.
//!
//! [`run`] opens it and stays until the person leaves. WASD walk, the mouse (after a click) or the
//! arrow keys look, Shift runs, Space jumps, F flies, R shows rooms, Enter says something, Escape leaves.
//! Who is alone keeps views by Ctrl and a number, and flies to them by the number.

mod bookmarks;
mod controls;
mod dynamic_resolution;
mod overlay;
mod scene;
mod window;

use std::{
    sync::atomic::AtomicBool,
    time::{Duration, Instant},
};

use sightline_world::{Spawn, World};
use thiserror::Error;
use winit::event_loop::EventLoop;

use self::{scene::Scene, window::WindowApp};
use crate::net::Session;

/// What is walked in.
#[derive(Clone, Copy)]
pub enum WorldSource<'a> {
    /// A building shared with others.
    Shared(&'a Session),
    /// A building for oneself.
    Alone(&'a World, Spawn),
}

/// How the window looks and when it closes by itself.
#[derive(Clone, Copy, Default)]
pub struct WindowOptions<'a> {
    /// Written on the window's frame.
    pub title: &'a str,
    /// Closes after so long.
    pub end: Option<Duration>,
    /// Closes when it becomes true.
    pub stop: Option<&'a AtomicBool>,
    /// Prepares what is hidden from where the eye will be, on a thread of its own, and leaves it out: see
    /// [`render::hidden`](sightline_renderer::node_visibility).
    pub fuzzy: bool,
}

/// What happened in the window.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct WalkSummary {
    /// Frames shown.
    pub frames: u64,
    /// How long the window was open, in seconds.
    pub seconds: f64,
    /// The mean time to draw a frame, in milliseconds: what limits the frame rate, which itself is
    /// held at [`FRAMES_PER_S_MAX`].
    pub draw_ms: f64,
    /// Pixels of the last frame.
    pub size: (usize, usize),
    /// Why the session ended, when it was not the person who left.
    pub ended: Option<String>,
}

impl WalkSummary {
    /// Frames shown for each second.
    pub fn frames_per_s(&self) -> f64 {
        if self.seconds > 0.0 { self.frames as f64 / self.seconds } else { 0.0 }
    }
}

/// More frames would not be seen, and the cores may have other work.
pub const FRAMES_PER_S_MAX: u32 = 60;

/// Why there is no window.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DesktopError {
    /// Nothing to open it on.
    #[error("cannot open a window: the display does not answer")]
    Display,
    /// It cannot be drawn on.
    #[error("cannot draw in the window: {0}")]
    Surface(String),
}

/// Whether there seems to be a display. [`run`] may still fail.
pub fn has_display() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(not(all(unix, not(target_os = "macos"))))
        || is_set("DISPLAY")
        || is_set("WAYLAND_DISPLAY")
        || is_set("WAYLAND_SOCKET")
}

/// Opens a window and stays until the person leaves, the session ends or the options say so. To be
/// called on the main thread, and once only in a process.
///
/// # Errors
///
/// When there is no display, or no drawing on it.
pub fn run(visit: WorldSource, options: WindowOptions) -> Result<WalkSummary, DesktopError> {
    let events = EventLoop::new().map_err(display_error)?;
    let display = events.owned_display_handle();
    let context = softbuffer::Context::new(display)
        .map_err(|error| DesktopError::Surface(error.to_string()))?;
    let start = Instant::now();
    let mut shell = WindowApp::new(Scene::new(visit, options.fuzzy), options, context, start);
    events.run_app(&mut shell).map_err(display_error)?;
    shell.finish()
}

/// What winit says names lines of its own source, which is of no use to a person.
fn display_error(error: impl std::fmt::Display) -> DesktopError {
    tracing::debug!(%error, "no window");
    DesktopError::Display
}
