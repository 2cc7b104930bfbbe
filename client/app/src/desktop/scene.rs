//! The building as one sees it: the walker's steps, and the pictures, layer by layer.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use glam::Vec3;
use sightline_client_core::{
    arriving::ArrivingWorld,
    fetching::{Outlook, PieceError, ShownBranch},
    footing::{Footing, Rescue},
    replica::{AvatarSource, ShownAvatar},
    walker::{MoveInput, Walker},
};
use sightline_renderer::{
    Camera, Frame, Renderer, mover_visibility::MoverVisibility, movers, moving::InView,
    node_visibility::VisibilityPrefetcher, streaming::shown_branches,
};
use sightline_world::{Mover, Spawn, motion::Pose};

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

/// A view that has not changed for this long is drawn with all the window's pixels.
const RESTS: Duration = Duration::from_millis(400);
/// While the eye rests, what moves is drawn no more often than this: half of the highest rate.
const MOVING_INTERVAL: Duration = Duration::from_millis(33);
/// The most bytes of pieces that may be asked for and not taken in yet.
const UNDER_WAY: usize = 256 * 1_024;
/// How long taking in pieces may hold up a picture.
const TAKING: Duration = Duration::from_millis(6);
/// While the eye moves, one pixel of this number, in one row of this number, tells what a picture
/// shows.
const LOOK_STEP: usize = 4;
/// The picture where too little of the building is here.
const NOTHING: u32 = 0x0038_4450;

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
    /// The camera and how many pieces were taken in, and since when it has been those.
    view: ((Camera, u64), Instant),
    /// When what moves was looked at last.
    looked: Instant,
    seen: Vec<ShownAvatar>,
    clock: Clock,
    before: Option<Instant>,
    draw_time: Duration,
    /// Pieces of the building that have come and are not taken in yet.
    arrived: VecDeque<(usize, Vec<u8>)>,
    /// The branches that the last picture shows, and how closely it was looked at.
    branches: (Vec<ShownBranch>, usize),
    /// Whether the plan of the storey is wanted.
    pub(super) wants_plan: bool,
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
    pub(super) fn new(
        building: ArrivingWorld,
        start: Spawn,
        drawing: Drawing,
        now: Instant,
    ) -> Self {
        let walker = Walker::new(building.world(), start);
        let mut renderer = Renderer::default();
        renderer.mode = drawing.mode;
        Self {
            view: ((Camera::at(&walker.pose()), 0), now),
            looked: now,
            walker,
            surroundings: Surroundings::new(building, drawing.fuzzy),
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
            arrived: VecDeque::new(),
            branches: (Vec::new(), usize::MAX),
            wants_plan: false,
        }
    }

    pub(super) fn pose(&self) -> Pose {
        self.walker.pose()
    }

    /// The avatars of which at least one pixel is shown.
    pub(super) fn seen(&self) -> &[ShownAvatar] {
        &self.seen
    }

    /// The time spent on drawing.
    pub(super) fn draw_time(&self) -> Duration {
        self.draw_time
    }

    /// Enters the building of a session at a pose. Returns whether it is another building.
    pub(super) fn enter(&mut self, session: &Session, pose: Pose, controls: &mut Controls) -> bool {
        let is_another = !self.surroundings.building.is(&session.world());
        if is_another {
            let building = session.building();
            self.walker = Walker::new(building.world(), Spawn { eye: pose.eye, yaw: pose.yaw });
            self.surroundings = Surroundings::new(building, self.drawing.fuzzy);
            self.worlds += 1;
            self.arrived.clear();
            self.branches = (Vec::new(), usize::MAX);
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

    /// Whether there is enough of the building for a picture from where the eye is.
    pub(super) fn is_open(&self) -> bool {
        self.surroundings.building.is_open_at(self.pose().eye)
    }

    /// Takes in pieces of the building that have come, and asks for those that are missing in
    /// pictures with this number of rows.
    ///
    /// # Errors
    /// When a piece is malformed.
    pub(super) fn fetch(&mut self, session: &Session, rows: usize) -> Result<(), PieceError> {
        let building = &mut self.surroundings.building;
        if building.complete().is_some() {
            return Ok(());
        }
        self.arrived.extend(session.arrived_pieces(building));
        building.refuse(&session.refused_pieces(building));
        let start = Instant::now();
        while let Some((number, piece)) = self.arrived.pop_front() {
            building.take(number, piece)?;
            if start.elapsed() >= TAKING {
                break;
            }
        }
        let Pose { eye, velocity, .. } = self.walker.pose();
        let outlook = Outlook {
            eye,
            velocity,
            focal: Camera::at(&self.walker.pose()).focal(rows),
            shown: &self.branches.0,
            plan: self.wants_plan,
            all: false,
        };
        let next = building.next(&outlook, UNDER_WAY);
        if !next.is_empty() {
            session.ask_for_pieces(building, &next);
        }
        Ok(())
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
        // A body moves only where all voxels around it are here.
        if stands || !self.is_open() {
            // The eye looks around and stays where it is.
            let stands = Pose { yaw: wish.yaw, pitch: wish.pitch, ..self.walker.pose() };
            self.walker.place(Pose { velocity: Vec3::ZERO, ..stands });
            return false;
        }
        let (world, octree) = (self.surroundings.world(), self.surroundings.building.octree());
        let rescue = self.footing.rescue(world, octree, &self.walker, &wish, dt_s);
        let input: MoveInput = match rescue {
            Some(Rescue::Back(way)) => way,
            Some(Rescue::Stuck) | None => wish,
        };
        let before = self.walker.clone();
        self.walker.step(octree, input, dt_s);
        if !self.is_open() {
            // It waits where it is until they have come.
            let Pose { yaw, pitch, .. } = self.walker.pose();
            self.walker = before;
            let waits = Pose { yaw, pitch, velocity: Vec3::ZERO, ..self.walker.pose() };
            self.walker.place(waits);
        }
        rescue == Some(Rescue::Stuck)
    }

    /// Draws what has changed since the last call, in a window of this size. Returns whether
    /// anything has.
    pub(super) fn draw(
        &mut self,
        session: Option<&Session>,
        window: (usize, usize),
        now: Instant,
        rooms: RoomDisplay,
    ) -> bool {
        let start = Instant::now();
        let camera = Camera::at(&self.walker.pose());
        let taken = self.surroundings.building.taken();
        if (camera, taken) != self.view.0 {
            self.view = ((camera, taken), now);
        }
        let rests = now.saturating_duration_since(self.view.1) >= RESTS;
        self.divisor = if rests { 1 } else { self.dynamic_resolution.divisor() };
        let size = (window.0.div_ceil(self.divisor), window.1.div_ceil(self.divisor));
        let pieces = self.is_open().then_some(taken);
        let (world, hidden) = (self.worlds, rooms.hidden);
        let view = BuildingView { camera, size, world, hidden, pieces };
        let building_changes = self.shown.building_changes(view);
        if pieces.is_none() {
            self.show_nothing(size, building_changes);
            return building_changes;
        }
        if building_changes {
            self.draw_building(&camera, size, rooms.hidden);
        }
        self.look(&camera, building_changes, if rests { 1 } else { LOOK_STEP });
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

    /// Shows an empty picture.
    fn show_nothing(&mut self, (width, height): (usize, usize), changes: bool) {
        self.branches.0.clear();
        self.seen.clear();
        if changes {
            self.building = Frame::new(width, height);
            self.building.colour.fill(NOTHING);
            self.inhabited.copy_from(&self.building);
        }
    }

    /// Notes the branches that the picture of the building shows, unless it is the one before,
    /// which was looked at as closely.
    fn look(&mut self, camera: &Camera, is_new: bool, step: usize) {
        if let Some(fetcher) = self.surroundings.building.fetcher()
            && (is_new || step < self.branches.1)
        {
            let shown = shown_branches(&self.building, camera, fetcher.octree(), step);
            self.branches = (shown, step);
        }
    }

    /// Draws the building: what rooms show of it, or what they hide, too.
    fn draw_building(&mut self, camera: &Camera, (width, height): (usize, usize), hidden: bool) {
        self.building.resize(width, height);
        let focal = camera.focal(height);
        let Pose { eye, velocity, .. } = self.walker.pose();
        let known = |ahead: &VisibilityPrefetcher| ahead.at(eye, velocity, focal);
        self.renderer.node_visibility = self.surroundings.ahead.as_ref().and_then(known);
        self.renderer.building_sight = if hidden { None } else { self.surroundings.sight(eye) };
        self.renderer.draw(self.surroundings.building.octree(), camera, &mut self.building);
    }

    /// Draws the movers that a flight sees, or those that rooms hide, too. There are no avatars on
    /// it.
    fn draw_flight(&mut self, camera: &Camera, time: Duration, hidden: bool) {
        let Surroundings { building, rooms, .. } = &self.surroundings;
        let world = building.world();
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
        let Surroundings { building, moving, .. } = &mut self.surroundings;
        let world = building.world();
        let mut in_view: InView = moving.find(&self.building, camera, world, source, time);
        if let Some(sight) = &self.renderer.building_sight {
            in_view.leave_out_hidden(sight, world);
        }
        if !self.shown.moving_changes(in_view.clone(), with_rooms) {
            return false;
        }
        self.inhabited.copy_from(&self.building);
        self.seen = in_view.draw(&mut self.inhabited, camera, world, building.octree());
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
