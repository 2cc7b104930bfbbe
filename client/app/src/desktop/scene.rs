//! One frame after another: the walker's step, the building, the avatars and the overlay.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_client_core::{
    replica::{AvatarSource, Event, VisibleAvatar},
    walker::Walker,
};
use sightline_renderer::{
    Camera, Frame, Renderer, mover_visibility::MoverVisibility, movers,
    node_visibility::VisibilityPrefetcher,
};
use sightline_world::{Spawn, motion::Pose};

use super::{
    WorldSource, bookmarks::Bookmarks, controls::Controls, dynamic_resolution::DynamicResolution,
    overlay, overlay::Log, surroundings::Surroundings,
};
use crate::net::SessionState;

/// Everything that the window shows, without the window itself.
pub(super) struct WalkScene<'a> {
    visit: WorldSource<'a>,
    walker: Walker,
    surroundings: Surroundings,
    /// Whether hidden nodes are found ahead of the eye.
    fuzzy: bool,
    bookmarks: Bookmarks,
    /// Which movers the current flight can see.
    mover_visibility: Option<MoverVisibility>,
    renderer: Renderer,
    drawn: Frame,
    shown: Frame,
    log: Log,
    dynamic_resolution: DynamicResolution,
    rate: Rate,
    /// The start of the clock where there is no server.
    start: Instant,
    before: Option<Instant>,
    draw_time: Duration,
}

const MOVING_OVER: &str = "The building has changed. You will be in the new one in a moment.";
const RETURNING: &str = "The connection broke. You will be back when the server answers.";
const HELP: &str =
    "WASD walk, click and mouse look, Shift run, Space jump, F fly, R rooms, Enter chat, Esc leave";

impl<'a> WalkScene<'a> {
    pub(super) fn new(visit: WorldSource<'a>, fuzzy: bool) -> Self {
        let (world, spawn) = match visit {
            WorldSource::Alone(world, spawn) => (world.clone(), spawn),
            WorldSource::Shared(session) => {
                let pose = session.pose();
                (session.world(), Spawn { eye: pose.eye, yaw: pose.yaw })
            }
        };
        let mut log = Log::default();
        log.add(Instant::now(), HELP.into());
        Self {
            visit,
            walker: Walker::new(&world, spawn),
            surroundings: Surroundings::new(world, fuzzy),
            fuzzy,
            bookmarks: Bookmarks::default(),
            mover_visibility: None,
            renderer: Renderer::default(),
            drawn: Frame::default(),
            shown: Frame::default(),
            log,
            dynamic_resolution: DynamicResolution::default(),
            rate: Rate::default(),
            start: Instant::now(),
            before: None,
            draw_time: Duration::ZERO,
        }
    }

    pub(super) fn walker(&self) -> &Walker {
        &self.walker
    }

    /// The time spent on drawing all frames.
    pub(super) fn draw_time(&self) -> Duration {
        self.draw_time
    }

    /// How this client stands with its server; `None` without one.
    fn session_state(&self) -> Option<SessionState> {
        match self.visit {
            WorldSource::Shared(session) => Some(session.state()),
            WorldSource::Alone(..) => None,
        }
    }

    /// Why the session ended; `None` while it runs.
    pub(super) fn ended(&self) -> Option<String> {
        match self.visit {
            WorldSource::Shared(session) => session.end(),
            WorldSource::Alone(..) => None,
        }
    }

    /// Says something to the others.
    pub(super) fn say(&mut self, now: Instant, line: &str) {
        let refused = match self.visit {
            WorldSource::Shared(session) => session.chat(line).err().map(|error| error.to_string()),
            WorldSource::Alone(..) => Some("nobody else is here".into()),
        };
        if let Some(reason) = refused {
            self.log.add(now, format!("your line was not sent: {reason}"));
        }
    }

    /// Bookmarks the view.
    pub(super) fn bookmark(&mut self, now: Instant, number: usize) {
        self.bookmarks.keep(number, self.walker.pose());
        self.log.add(now, format!("view {} is bookmarked", number + 1));
    }

    /// Starts a flight to a bookmarked view. Only possible without a server.
    pub(super) fn fly(&mut self, now: Instant, number: usize) {
        let refused = match self.visit {
            WorldSource::Shared(_) => {
                Some("flights to views need a building without a server".to_owned())
            }
            WorldSource::Alone(..) if self.bookmarks.fly(number, self.walker.pose(), now) => None,
            WorldSource::Alone(..) => {
                Some(format!("no view {0} is bookmarked: Ctrl+{0} bookmarks one", number + 1))
            }
        };
        if let Some(reason) = refused {
            self.log.add(now, reason);
        }
    }

    /// Moves to the next pose: along the current flight, or as the keys say.
    fn go(
        &mut self,
        controls: &mut Controls,
        now: Instant,
        dt_s: f32,
        size: (usize, usize),
    ) -> Pose {
        if let Some(pose) = self.bookmarks.flight(now) {
            self.walker.place(pose);
            controls.face(&pose);
            self.mover_visibility.get_or_insert_with(|| MoverVisibility::new(size, Camera::FOV_Y));
            return pose;
        }
        self.mover_visibility = None;
        let wish = controls.wish(dt_s);
        if self.session_state().is_some_and(|state| state != SessionState::Present) {
            // The eye looks around and stays where it is.
            let stands = Pose { yaw: wish.yaw, pitch: wish.pitch, ..self.walker.pose() };
            self.walker.place(Pose { velocity: Vec3::ZERO, ..stands });
            return self.walker.pose();
        }
        self.walker.step(&self.surroundings.world.octree, wish, dt_s)
    }

    /// Advances to `now`, and draws a frame of the given size.
    pub(super) fn frame(
        &mut self,
        controls: &mut Controls,
        size: (usize, usize),
        now: Instant,
    ) -> &Frame {
        let (width, height) = size;
        self.handle_events(controls, now);
        let dt_s = self.before.map_or(0.0, |before| (now - before).as_secs_f32());
        self.before = Some(now);
        self.rate.count(now);
        let pose = self.go(controls, now, dt_s, size);
        if let WorldSource::Shared(session) = self.visit {
            session.set_pose(pose);
        }
        let divisor = self.dynamic_resolution.divisor();
        self.drawn.resize(width.div_ceil(divisor), height.div_ceil(divisor));
        let start = Instant::now();
        let time = match self.visit {
            WorldSource::Shared(session) => session.server_time(),
            WorldSource::Alone(..) => now - self.start,
        };
        let camera = Camera::at(&pose);
        let seen = self.draw(&pose, time);
        if controls.shows_rooms() {
            self.surroundings.wires().draw(&mut self.drawn, &camera);
        }
        self.draw_time += start.elapsed();
        self.dynamic_resolution.drew(start.elapsed().as_secs_f32() * 1.0e3);
        let (status, state) = (self.status(pose.eye, &seen), self.session_state());
        let shown = if divisor == 1 {
            &mut self.drawn
        } else {
            self.shown.resize(width, height);
            enlarge(&self.drawn, &mut self.shown, divisor);
            &mut self.shown
        };
        overlay::status(shown, &status);
        match state {
            Some(SessionState::MovingOver) => overlay::banner(shown, MOVING_OVER),
            Some(SessionState::Returning { .. }) => overlay::banner(shown, RETURNING),
            _ => {}
        }
        self.log.draw(shown, now, controls.line());
        shown
    }

    /// Handles the events of the session.
    fn handle_events(&mut self, controls: &mut Controls, now: Instant) {
        let WorldSource::Shared(session) = self.visit else { return };
        for event in session.events() {
            match event {
                Event::Entered(pose) => {
                    let world = session.world();
                    if !Arc::ptr_eq(&world, &self.surroundings.world) {
                        self.walker = Walker::new(&world, Spawn { eye: pose.eye, yaw: pose.yaw });
                        self.surroundings = Surroundings::new(world, self.fuzzy);
                        self.log.add(now, "you are in the changed building".into());
                    }
                    self.walker.place(pose);
                    controls.face(&pose);
                }
                Event::Corrected(pose) => self.walker.place(pose),
                Event::Chat { name, text, .. } => self.log.add(now, format!("{name}: {text}")),
                Event::Notice(text) => self.log.add(now, text),
                Event::Goodbye(reason) => self.log.add(now, format!("goodbye: {reason}")),
                Event::Appeared(_) | Event::Vanished(_) => (),
            }
        }
    }

    /// Draws the building, its movers at a time of the server's clock, and the avatars. Returns the
    /// avatars in sight. On a flight there are no others.
    fn draw(&mut self, pose: &Pose, time: Duration) -> Vec<VisibleAvatar> {
        let camera = &Camera::at(pose);
        let focal = camera.focal(self.drawn.height());
        let hidden = |ahead: &VisibilityPrefetcher| ahead.at(pose.eye, pose.velocity, focal);
        self.renderer.node_visibility = self.surroundings.ahead.as_ref().and_then(hidden);
        let Surroundings { world, rooms, moving, .. } = &mut self.surroundings;
        self.renderer.draw(&world.octree, camera, &mut self.drawn);
        if let Some(mover_visibility) = &mut self.mover_visibility {
            let movers = mover_visibility.movers(world, rooms, pose);
            movers::draw_selected(&mut self.drawn, camera, &movers, time);
            return Vec::new();
        }
        let mut session = match self.visit {
            WorldSource::Shared(session) => Some(session),
            WorldSource::Alone(..) => None,
        };
        let told = session.as_mut().map(|session| session as &mut dyn AvatarSource);
        moving.draw(&mut self.drawn, camera, world, told, time)
    }

    fn status(&self, eye: Vec3, seen: &[VisibleAvatar]) -> String {
        let title = self.surroundings.place_name(eye);
        let fps = self.rate.per_s;
        let WorldSource::Shared(session) = self.visit else {
            return format!("{title} | {fps:.0} fps | alone");
        };
        let stats = session.stats();
        let state =
            stats.reporting_state.map_or_else(|| "outside".to_owned(), |state| state.to_string());
        let [rate_in, rate_out] = [stats.udp_rate_in, stats.udp_rate_out].map(|rate| rate / 1.0e3);
        let names: Vec<&str> = seen.iter().map(|other| other.name.as_str()).collect();
        let held = stats.visible;
        format!(
            "{title} | {fps:.0} fps | {state} | in {rate_in:.1} out {rate_out:.1} kB/s \
             | told of {held}, sees {}{}{}",
            names.len(),
            if names.is_empty() { "" } else { ": " },
            names.join(", ")
        )
    }
}

/// The frame rate, measured every half second.
#[derive(Default)]
struct Rate {
    since: Option<Instant>,
    frames: u32,
    per_s: f32,
}

impl Rate {
    fn count(&mut self, now: Instant) {
        self.frames += 1;
        let since = *self.since.get_or_insert(now);
        let elapsed_s = (now - since).as_secs_f32();
        if elapsed_s >= 0.5 {
            *self = Self { since: Some(now), frames: 0, per_s: self.frames as f32 / elapsed_s };
        }
    }
}

/// Draws each pixel as a square of `divisor` × `divisor` pixels.
fn enlarge(small: &Frame, large: &mut Frame, divisor: usize) {
    let width = large.width();
    assert!(small.width() >= width.div_ceil(divisor), "the drawn frame covers the window");
    for (y, row) in large.colour.chunks_mut(width.max(1)).enumerate() {
        let start = y / divisor * small.width();
        let source = &small.colour[start..start + small.width()];
        for (pixels, &colour) in row.chunks_mut(divisor).zip(source) {
            pixels.fill(colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enlarged_frames_fill_windows_of_odd_size() {
        let mut small = Frame::new(3, 2);
        small.colour.copy_from_slice(&[1, 2, 3, 4, 5, 6]);
        let mut large = Frame::new(5, 3);
        enlarge(&small, &mut large, 2);
        assert_eq!(large.colour, [1, 1, 2, 2, 3, 1, 1, 2, 2, 3, 4, 4, 5, 5, 6]);
    }

    #[test]
    fn the_frame_rate_is_that_of_the_last_half_second() {
        let start = Instant::now();
        let mut rate = Rate::default();
        (0..=40).for_each(|i| rate.count(start + Duration::from_millis(25 * i)));
        assert!((rate.per_s - 40.0).abs() < 3.0, "{}", rate.per_s);
    }
}
