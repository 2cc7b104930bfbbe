//! The window itself: passes winit's events to the controls, and frames from the scene to the
//! screen.

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
    DesktopError, FRAMES_PER_S_MAX, WalkSummary, WindowOptions,
    controls::{Action, Controls},
    scene::WalkScene,
};

/// The handler of winit's events.
pub(super) struct WindowApp<'a> {
    scene: WalkScene<'a>,
    options: WindowOptions<'a>,
    context: Context<OwnedDisplayHandle>,
    screen: Option<Screen>,
    controls: Controls,
    /// Whether the mouse turns the view.
    grabbed: bool,
    start: Instant,
    next_frame: Instant,
    frames: u64,
    size: (usize, usize),
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
        scene: WalkScene<'a>,
        options: WindowOptions<'a>,
        context: Context<OwnedDisplayHandle>,
        start: Instant,
    ) -> Self {
        let mut controls = Controls::default();
        controls.face(&scene.walker().pose());
        Self {
            scene,
            options,
            context,
            screen: None,
            controls,
            grabbed: false,
            start,
            next_frame: start,
            frames: 0,
            size: (0, 0),
            error: None,
        }
    }

    /// What happened, once the event loop has ended.
    pub(super) fn finish(self) -> Result<WalkSummary, DesktopError> {
        match self.error {
            Some(error) => Err(error),
            None => Ok(WalkSummary {
                frames: self.frames,
                seconds: self.start.elapsed().as_secs_f64(),
                draw_ms: self.scene.draw_time().as_secs_f64() * 1.0e3 / self.frames.max(1) as f64,
                size: self.size,
                ended: self.scene.ended(),
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

    fn draw(&mut self) -> Result<(), DesktopError> {
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
        self.size = (size.width as usize, size.height as usize);
        let frame = self.scene.frame(&mut self.controls, self.size, Instant::now());
        // A window wider than the widest frame keeps a margin.
        let rows = buffer.chunks_mut(self.size.0).zip(frame.colour.chunks(frame.width().max(1)));
        for (row, pixels) in rows {
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
            || self.scene.ended().is_some()
    }

    fn key(&mut self, events: &ActiveEventLoop, event: &KeyEvent) {
        let PhysicalKey::Code(code) = event.physical_key else { return };
        let down = event.state == ElementState::Pressed;
        if down && code == KeyCode::Escape && self.grabbed && self.controls.line().is_none() {
            // The first Escape releases the mouse, the second one leaves.
            return self.grab(false);
        }
        match self.controls.key(code, down, event.text.as_deref()) {
            Some(Action::Say(line)) => self.scene.say(Instant::now(), &line),
            Some(Action::Bookmark(number)) => self.scene.bookmark(Instant::now(), number),
            Some(Action::Fly(number)) => self.scene.fly(Instant::now(), number),
            Some(Action::Leave) => events.exit(),
            None => (),
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
                let outcome = self.draw();
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
        if now >= self.next_frame {
            // A late frame does not hurry the next ones.
            let interval = Duration::from_secs(1) / FRAMES_PER_S_MAX;
            self.next_frame = (self.next_frame + interval).max(now);
            if let Some(Screen { window, .. }) = &self.screen {
                window.request_redraw();
            }
        }
        events.set_control_flow(ControlFlow::WaitUntil(self.next_frame));
    }
}

fn surface_error(error: softbuffer::SoftBufferError) -> DesktopError {
    DesktopError::Surface(error.to_string())
}
