//! The building as one sees it: the walker's steps, and the pictures, layer by layer.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_client_core::{
    footing::{Footing, Rescue},
    replica::{AvatarSource, VisibleAvatar},
    walker::{MoveInput, Walker},
};
use sightline_renderer::{
    Camera, Frame, Renderer, mover_visibility::MoverVisibility, movers, moving::InView,
    node_visibility::VisibilityPrefetcher,
};
use sightline_world::{Mover, Spawn, World, motion::Pose};

use super::{
    Drawing,
    bookmarks::Bookmarks,
    controls::Controls,
    dynamic_resolution::DynamicResolution,
    overlay::Overlay,
    redraw::{BuildingView, RoomDisplay, ShownLayers},
    surroundings::Surroundings,
};
use crate::net::Session;

/// A view that has not changed for so long is drawn with all the window's pixels.
const RESTS: Duration = Duration::from_millis(400);
/// While the eye rests, what moves is drawn no more often than this: half of the highest rate.
const MOVING_INTERVAL: Duration = Duration::from_millis(33);
/// A pose that is farther from the one before was not walked to, in metres.
const LEAP_M: f32 = 2.0;

/// The building as one sees it.
pub(super) struct Scene {
    pub(super) surroundings: Surroundings,
    pub(super) bookmarks: Bookmarks,
    walker: Walker,
    footing: Footing,
    drawing: Drawing,
    /// How often the building was replaced.
    worlds: u32,
    /// Which movers the current flight can see.
    mover_visibility: Option<MoverVisibility>,
    renderer: Renderer,
    /// The building alone.
    building: Frame,
    /// The building, and what moves in it.
    inhabited: Frame,
    shown: ShownLayers,
    dynamic_resolution: DynamicResolution,
    /// Window pixels per drawn pixel, along each axis, in the picture that was drawn last.
    divisor: usize,
    /// The camera, and since when it has been that.
    camera: (Camera, Instant),
    /// When what moves was looked at last.
    looked: Instant,
    seen: Vec<VisibleAvatar>,
    clock: Clock,
    before: Option<Instant>,
    draw_time: Duration,
}

/// The clock by which movers are drawn. Without a server it goes on by itself.
struct Clock {
    /// A time of this clock, and when it was that.
    set: (Duration, Instant),
}

impl Clock {
    fn time(&mut self, session: Option<&Session>, now: Instant) -> Duration {
        let own = self.set.0 + now.saturating_duration_since(self.set.1);
        let time = session.map_or(own, Session::server_time);
        self.set = (time, now);
        time
    }
}

impl Scene {
    pub(super) fn new(world: Arc<World>, start: Spawn, drawing: Drawing, now: Instant) -> Self {
        let walker = Walker::new(&world, start);
        let mut renderer = Renderer::default();
        renderer.mode = drawing.mode;
        Self {
            camera: (Camera::at(&walker.pose()), now),
            looked: now,
            walker,
            surroundings: Surroundings::new(world, drawing.fuzzy),
            bookmarks: Bookmarks::default(),
            footing: Footing::default(),
            drawing,
            worlds: 0,
            mover_visibility: None,
            renderer,
            building: Frame::default(),
            inhabited: Frame::default(),
            shown: ShownLayers::default(),
            dynamic_resolution: DynamicResolution::default(),
            divisor: 1,
            seen: Vec::new(),
            clock: Clock { set: (Duration::ZERO, now) },
            before: None,
            draw_time: Duration::ZERO,
        }
    }

    pub(super) fn pose(&self) -> Pose {
        self.walker.pose()
    }

    /// The avatars of which at least one pixel is shown.
    pub(super) fn seen(&self) -> &[VisibleAvatar] {
        &self.seen
    }

    /// The time spent on drawing.
    pub(super) fn draw_time(&self) -> Duration {
        self.draw_time
    }

    /// Enters a building at a pose. Returns whether it is another building.
    pub(super) fn enter(&mut self, world: Arc<World>, pose: Pose, controls: &mut Controls) -> bool {
        let is_another = !Arc::ptr_eq(&world, &self.surroundings.world);
        if is_another {
            self.walker = Walker::new(&world, Spawn { eye: pose.eye, yaw: pose.yaw });
            self.surroundings = Surroundings::new(world, self.drawing.fuzzy);
            self.worlds += 1;
        }
        self.put(pose, controls);
        is_another
    }

    /// Puts the body elsewhere.
    pub(super) fn put(&mut self, pose: Pose, controls: &mut Controls) {
        if self.pose().eye.distance(pose.eye) > LEAP_M {
            self.footing.forget();
            controls.face(&pose);
        }
        self.walker.place(pose);
    }

    /// Moves to the next pose: along the current flight, or as the keys say, or back to where the
    /// body stood when it has fallen out of the world. Returns whether the body is stuck.
    pub(super) fn go(&mut self, controls: &mut Controls, now: Instant, stands: bool) -> bool {
        let dt_s = self.before.map_or(0.0, |before| (now - before).as_secs_f32());
        self.before = Some(now);
        if let Some(pose) = self.bookmarks.flight(now) {
            self.walker.place(pose);
            controls.face(&pose);
            self.footing.forget();
            let size = (self.building.width(), self.building.height());
            self.mover_visibility.get_or_insert_with(|| MoverVisibility::new(size, Camera::FOV_Y));
            return false;
        }
        self.mover_visibility = None;
        let wish = controls.wish(dt_s);
        if stands {
            // The eye looks around and stays where it is.
            let stands = Pose { yaw: wish.yaw, pitch: wish.pitch, ..self.walker.pose() };
            self.walker.place(Pose { velocity: Vec3::ZERO, ..stands });
            return false;
        }
        let world = &self.surroundings.world;
        let rescue = self.footing.rescue(world, &self.walker, &wish, dt_s);
        let input: MoveInput = match rescue {
            Some(Rescue::Back(way)) => way,
            Some(Rescue::Stuck) | None => wish,
        };
        self.walker.step(&world.octree, input, dt_s);
        rescue == Some(Rescue::Stuck)
    }

    /// Draws what has changed since the last call, in a window of this size. Returns whether anything
    /// has.
    pub(super) fn draw(
        &mut self,
        session: Option<&Session>,
        window: (usize, usize),
        now: Instant,
        rooms: RoomDisplay,
    ) -> bool {
        let start = Instant::now();
        let camera = Camera::at(&self.walker.pose());
        if camera != self.camera.0 {
            self.camera = (camera, now);
        }
        let rests = now.saturating_duration_since(self.camera.1) >= RESTS;
        self.divisor = if rests { 1 } else { self.dynamic_resolution.divisor() };
        let size = (window.0.div_ceil(self.divisor), window.1.div_ceil(self.divisor));
        let view = BuildingView { camera, size, world: self.worlds, hidden: rooms.hidden };
        let building_changes = self.shown.building_changes(view);
        if building_changes {
            self.draw_building(&camera, size, rooms.hidden);
        }
        let is_soon = now.saturating_duration_since(self.looked) < MOVING_INTERVAL;
        if rests && is_soon && !building_changes {
            return false;
        }
        self.looked = now;
        let time = self.clock.time(session, now);
        let changes = if self.mover_visibility.is_some() {
            self.draw_flight(&camera, time, rooms.hidden);
            true
        } else {
            self.draw_moving(session, &camera, time, rooms.outlines)
        };
        if building_changes || changes {
            self.draw_time += start.elapsed();
        }
        if building_changes && !rests {
            self.dynamic_resolution.drew(start.elapsed().as_secs_f32() * 1.0e3);
        }
        changes
    }

    /// Draws the building: what rooms show of it, or what they hide, too.
    fn draw_building(&mut self, camera: &Camera, (width, height): (usize, usize), hidden: bool) {
        self.building.resize(width, height);
        let focal = camera.focal(height);
        let Pose { eye, velocity, .. } = self.walker.pose();
        let known = |ahead: &VisibilityPrefetcher| ahead.at(eye, velocity, focal);
        self.renderer.node_visibility = self.surroundings.ahead.as_ref().and_then(known);
        self.renderer.building_sight = if hidden { None } else { self.surroundings.sight(eye) };
        self.renderer.draw(&self.surroundings.world.octree, camera, &mut self.building);
    }

    /// Draws the movers that a flight sees, or those that rooms hide, too. There are no avatars on
    /// it.
    fn draw_flight(&mut self, camera: &Camera, time: Duration, hidden: bool) {
        let Surroundings { world, rooms, .. } = &self.surroundings;
        self.inhabited.copy_from(&self.building);
        let mut movers: Vec<&Mover> = match &mut self.mover_visibility {
            Some(visibility) if !hidden => visibility.movers(world, rooms, &self.walker.pose()),
            _ => world.movers.iter().collect(),
        };
        if let Some(sight) = &self.renderer.building_sight {
            movers.retain(|mover| sight.may_show(mover));
        }
        movers::draw_selected(&mut self.inhabited, camera, world, &movers, time);
        self.shown = ShownLayers::default();
        self.seen.clear();
    }

    /// Draws what moves, if it looks otherwise than before. Returns whether it does.
    fn draw_moving(
        &mut self,
        session: Option<&Session>,
        camera: &Camera,
        time: Duration,
        with_rooms: bool,
    ) -> bool {
        let mut session = session;
        let source = session.as_mut().map(|session| session as &mut dyn AvatarSource);
        let Surroundings { world, moving, .. } = &mut self.surroundings;
        let mut in_view: InView = moving.find(&self.building, camera, world, source, time);
        if let Some(sight) = &self.renderer.building_sight {
            in_view.leave_out_hidden(sight, world);
        }
        if !self.shown.moving_changes(in_view.clone(), with_rooms) {
            return false;
        }
        self.inhabited.copy_from(&self.building);
        self.seen = in_view.draw(&mut self.inhabited, camera, world);
        if with_rooms {
            self.surroundings.wires().draw(&mut self.inhabited, camera);
        }
        true
    }

    /// Puts the picture and an overlay on the screen, if the picture was drawn anew or the overlay
    /// differs. Returns whether it did.
    pub(super) fn show(
        &mut self,
        screen: &mut Frame,
        (width, height): (usize, usize),
        overlay: &Overlay,
    ) -> bool {
        if !self.shown.overlay_changes(overlay, (width, height)) {
            return false;
        }
        screen.resize(width, height);
        enlarge(&self.inhabited, screen, self.divisor);
        overlay.draw(screen);
        true
    }
}

/// Draws each pixel as a square of `divisor` × `divisor` pixels.
fn enlarge(small: &Frame, large: &mut Frame, divisor: usize) {
    let width = large.width();
    for (y, row) in large.colour.chunks_mut(width.max(1)).enumerate() {
        let start = y / divisor * small.width();
        let source = small.colour.get(start..start + small.width()).unwrap_or_default();
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
}
