//! The window itself: passes winit's events to the controls, and the visit's pictures to the
//! screen. A picture that does not change is not shown again.

use std::{
    num::NonZeroU32,
    rc::Rc,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

use softbuffer::{Context, Surface};
use winit::{
    application::ApplicationHandler,
    dpi::LogicalSize,
    event::{DeviceEvent, DeviceId, ElementState, KeyEvent, MouseButton, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, OwnedDisplayHandle},
    keyboard::{KeyCode, PhysicalKey},
    window::{CursorGrabMode, Window, WindowId},
};

use super::{
    DesktopError, FRAMES_PER_S_MAX, WalkSummary, WindowOptions, controls::Controls, visit::Visit,
};

/// The handler of winit's events.
pub(super) struct WindowApp<'a> {
    visit: Visit<'a>,
    options: WindowOptions<'a>,
    context: Context<OwnedDisplayHandle>,
    screen: Option<Screen>,
    controls: Controls,
    /// Whether the mouse turns the view.
    grabbed: bool,
    start: Instant,
    next_step: Instant,
    frames: u64,
    error: Option<DesktopError>,
}

struct Screen {
    window: Rc<Window>,
    surface: Surface<OwnedDisplayHandle, Rc<Window>>,
}

/// The initial size of the window, in logical pixels.
const SIZE: LogicalSize<f64> = LogicalSize::new(960.0, 540.0);

impl<'a> WindowApp<'a> {
    pub(super) fn new(
        visit: Visit<'a>,
        options: WindowOptions<'a>,
        context: Context<OwnedDisplayHandle>,
        start: Instant,
    ) -> Self {
        let mut controls = Controls::default();
        if let Some(pose) = visit.pose() {
            controls.face(&pose);
        }
        Self {
            visit,
            options,
            context,
            screen: None,
            controls,
            grabbed: false,
            start,
            next_step: start,
            frames: 0,
            error: None,
        }
    }

    /// Leaves, and says what happened, once the event loop has ended.
    pub(super) fn finish(self) -> Result<WalkSummary, DesktopError> {
        let draw_time = self.visit.draw_time();
        let size = (self.visit.screen().width(), self.visit.screen().height());
        let (ended, came_in) = self.visit.leave();
        match self.error {
            Some(error) => Err(error),
            None => Ok(WalkSummary {
                frames: self.frames,
                seconds: self.start.elapsed().as_secs_f64(),
                draw_ms: draw_time.as_secs_f64() * 1.0e3 / self.frames.max(1) as f64,
                size,
                ended,
                came_in,
            }),
        }
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), DesktopError> {
        let materials =
            Window::default_attributes().with_title(self.options.title).with_inner_size(SIZE);
        let window = events.create_window(materials).map_err(super::display_error)?;
        let window = Rc::new(window);
        let surface = Surface::new(&self.context, window.clone()).map_err(surface_error)?;
        self.screen = Some(Screen { window, surface });
        Ok(())
    }

    /// Goes on to a moment, and asks for a redraw if the picture has changed.
    fn step(&mut self, now: Instant) {
        let Some(Screen { window, .. }) = &self.screen else { return };
        let size = window.inner_size();
        let size = (size.width as usize, size.height as usize);
        // A minimised window has no picture, and is still there for the others.
        let size = if size.0 == 0 || size.1 == 0 { (1, 1) } else { size };
        if self.visit.step(&mut self.controls, size, now) {
            window.request_redraw();
        }
    }

    /// Shows the picture.
    fn present(&mut self) -> Result<(), DesktopError> {
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let size = screen.window.inner_size();
        let (Some(width), Some(height)) =
            (NonZeroU32::new(size.width), NonZeroU32::new(size.height))
        else {
            // The window is minimised.
            return Ok(());
        };
        screen.surface.resize(width, height).map_err(surface_error)?;
        let mut buffer = screen.surface.buffer_mut().map_err(surface_error)?;
        let frame = self.visit.screen();
        // A window wider than the widest frame keeps a margin. So does one that has just grown,
        // until the next step.
        let rows = buffer.chunks_mut(width.get() as usize);
        for (row, pixels) in rows.zip(frame.colour.chunks(frame.width().max(1))) {
            let shown = row.len().min(pixels.len());
            row[..shown].copy_from_slice(&pixels[..shown]);
        }
        buffer.present().map_err(surface_error)?;
        self.frames += 1;
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.options.end.is_some_and(|end| self.start.elapsed() >= end)
            || self.options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed))
            || self.visit.is_over()
    }

    fn key(&mut self, events: &ActiveEventLoop, event: &KeyEvent) {
        let PhysicalKey::Code(code) = event.physical_key else { return };
        let down = event.state == ElementState::Pressed;
        let is_free = self.controls.line().is_none() && !self.visit.has_panel();
        if down && code == KeyCode::Escape && self.grabbed && is_free {
            // The first Escape releases the mouse, the second one leaves.
            return self.grab(false);
        }
        let action = self.controls.key(code, down, event.text.as_deref());
        if let Some(action) = action
            && self.visit.act(action, &mut self.controls, Instant::now())
        {
            events.exit();
        }
    }

    fn grab(&mut self, grabs: bool) {
        let Some(Screen { window, .. }) = &self.screen else { return };
        let mode = if grabs { CursorGrabMode::Locked } else { CursorGrabMode::None };
        // Where neither mode is supported, the mouse still turns the view, until it meets the
        // screen's edge.
        let grabbed = window
            .set_cursor_grab(mode)
            .or_else(|_| window.set_cursor_grab(CursorGrabMode::Confined));
        if let Err(error) = grabbed {
            tracing::debug!(%error, "the mouse cannot be grabbed");
        }
        window.set_cursor_visible(!grabs);
        if grabs {
            // Without a window manager, nothing else gives the window the focus.
            window.focus_window();
        }
        self.grabbed = grabs;
    }

    /// Records an error, and ends the event loop.
    fn check(&mut self, events: &ActiveEventLoop, outcome: Result<(), DesktopError>) {
        if let Err(error) = outcome {
            self.error = Some(error);
            events.exit();
        }
    }
}

impl ApplicationHandler for WindowApp<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.screen.is_none() {
            let outcome = self.open(events);
            self.check(events, outcome);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                let outcome = self.present();
                self.check(events, outcome);
            }
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
                self.key(events, &event);
            }
            WindowEvent::MouseInput {
                state: ElementState::Pressed,
                button: MouseButton::Left,
                ..
            } => self.grab(true),
            WindowEvent::Focused(false) => {
                self.controls.release();
                self.grab(false);
            }
            _ => (),
        }
    }

    fn device_event(&mut self, _: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let DeviceEvent::MouseMotion { delta: (right, down) } = event
            && self.grabbed
        {
            self.controls.look(right, down);
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if self.is_over() {
            return events.exit();
        }
        let now = Instant::now();
        if now >= self.next_step {
            // A late step does not hurry the next ones.
            let interval = Duration::from_secs(1) / FRAMES_PER_S_MAX;
            self.next_step = (self.next_step + interval).max(now);
            self.step(now);
        }
        events.set_control_flow(ControlFlow::WaitUntil(self.next_step));
    }
}

fn surface_error(error: softbuffer::SoftBufferError) -> DesktopError {
    DesktopError::Surface(error.to_string())
}
