//! The window: a thin shell around the renderer, the walker and a session.
//!
//! [`run`] opens it at once, and returns when the person leaves. It joins the server meanwhile, and
//! again when the server is lost. F1 shows the keys (`panels.rs`).
//!
//! A visit (`visit.rs`) makes a picture of each moment, in three layers: the building, what moves
//! in it, and what is written over it. A layer that would look as before is not drawn again
//! (`redraw.rs`), so a still scene costs little more than listening to the server.

mod bookmarks;
mod company;
mod controls;
mod dynamic_resolution;
mod link;
mod overlay;
mod panels;
mod plans;
mod redraw;
mod scene;
mod statistics;
mod surroundings;
mod visit;
mod window;

use std::{
    sync::{Arc, atomic::AtomicBool},
    time::{Duration, Instant},
};

use sightline_renderer::Mode;
use sightline_world::{Spawn, World};
use thiserror::Error;
use winit::event_loop::EventLoop;

use self::{
    company::{Company, ServerLink},
    visit::Visit,
    window::WindowApp,
};
use crate::net::{Connector, Session};

/// The building that is walked in.
pub enum WorldSource<'a> {
    /// A building shared with others, in a session that the caller keeps. The window closes when it
    /// ends.
    Shared(&'a Session),
    /// The building of a server, which the person calls by this name. The window joins it, and
    /// again when it is lost.
    Server(Box<Connector>, String),
    /// A building without a server, and where to start.
    Alone(&'a Arc<World>, Spawn),
}

/// The title of the window, and when it closes by itself.
#[derive(Clone, Copy, Default)]
pub struct WindowOptions<'a> {
    /// The window's title.
    pub title: &'a str,
    /// The window closes after this time.
    pub end: Option<Duration>,
    /// The window closes when this becomes true.
    pub stop: Option<&'a AtomicBool>,
    /// How the building is drawn.
    pub drawing: Drawing,
}

/// How the building is drawn. The picture does not depend on it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drawing {
    /// Finds hidden nodes ahead of the eye on a separate thread, and leaves them out: see
    /// [`sightline_renderer::node_visibility`].
    pub fuzzy: bool,
    /// How nodes are projected.
    pub mode: Mode,
}

/// What the window did until it closed.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct WalkSummary {
    /// The number of frames shown.
    pub frames: u64,
    /// How long the window was open, in seconds.
    pub seconds: f64,
    /// The mean time to draw a frame, in milliseconds. The frame rate is limited to
    /// [`FRAMES_PER_S_MAX`], so it tells less.
    pub draw_ms: f64,
    /// Columns and rows of the last frame.
    pub size: (usize, usize),
    /// Why there was no connection at the end, if there was none.
    pub ended: Option<String>,
    /// Whether the person was ever in the building.
    pub came_in: bool,
}

impl WalkSummary {
    /// Frames shown per second.
    pub fn frames_per_s(&self) -> f64 {
        if self.seconds > 0.0 { self.frames as f64 / self.seconds } else { 0.0 }
    }
}

/// The highest frame rate: people do not see more, and the cores may have other work. Pictures that
/// would look as the one before are left out.
pub const FRAMES_PER_S_MAX: u32 = 60;

/// Why there is no window.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DesktopError {
    /// There is no display, or it does not answer.
    #[error("cannot open a window: the display does not answer")]
    Display,
    /// The window cannot be drawn on.
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

/// Opens a window. Returns when the person leaves, the session ends, or the options say so. Must be
/// called on the main thread, and only once in a process.
///
/// # Errors
///
/// When there is no display, or the window cannot be drawn on.
pub fn run(visit: WorldSource, options: WindowOptions) -> Result<WalkSummary, DesktopError> {
    let events = EventLoop::new().map_err(display_error)?;
    let display = events.owned_display_handle();
    let context = softbuffer::Context::new(display)
        .map_err(|error| DesktopError::Surface(error.to_string()))?;
    let start = Instant::now();
    let visit = match visit {
        WorldSource::Alone(world, spawn) => Visit::alone(world, spawn, options.drawing, start),
        WorldSource::Shared(session) => Visit::with(Company::Guests(session), options.drawing),
        WorldSource::Server(connector, host) => {
            let server = Box::new(ServerLink::new(*connector, host, start));
            Visit::with(Company::Server(server), options.drawing)
        }
    };
    let mut shell = WindowApp::new(visit, options, context, start);
    events.run_app(&mut shell).map_err(display_error)?;
    shell.finish()
}

/// winit's messages name lines of its source, so they go to the log only.
fn display_error(error: impl std::fmt::Display) -> DesktopError {
    tracing::debug!(%error, "winit cannot open a window");
    DesktopError::Display
}
