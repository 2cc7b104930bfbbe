//! A visit, without the window itself: it joins a server, hears what happens, takes keys, and makes
//! the picture of each moment.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use sightline_client_core::{
    arriving::ArrivingWorld,
    replica::{Event, ShownAvatar},
    words,
};
use sightline_renderer::{Frame, plan};
use sightline_world::{
    Spawn, World,
    motion::{AvatarId, Pose},
};

use super::{
    Drawing,
    company::Company,
    controls::{Action, Controls},
    link::arriving,
    overlay::{Log, Overlay},
    panels::{self, Panel, PanelKind},
    redraw::RoomDisplay,
    scene::Scene,
    statistics::Statistics,
};
use crate::net::Session;

/// A visit to a building, alone or with others.
pub(super) struct Visit<'a> {
    company: Company<'a>,
    /// `None` before the first building is there.
    scene: Option<Scene>,
    /// Where a visitor without a server begins.
    entrance: Option<Spawn>,
    /// Whether hidden nodes are found ahead of the eye.
    drawing: Drawing,
    log: Log,
    panel: Option<PanelKind>,
    rooms: RoomDisplay,
    statistics: Statistics,
    /// Whether there is a server that does not know this client at the moment.
    is_away: bool,
    /// What the window shows.
    screen: Frame,
    /// What is written while there is no scene.
    written: Option<Overlay>,
}

const BACK: &str = "you are back";
const HELP: &str = "F1 shows the keys";
const NO_ROOMS: &str = "there are no rooms to show: the author of this building has declared none";
const STUCK: &str = "you were stuck, and go back to the entrance";

/// Behind what is written while there is no building.
const BACKGROUND: u32 = 0x0038_4450;

impl<'a> Visit<'a> {
    /// A visit with others.
    pub(super) fn with(company: Company<'a>, drawing: Drawing) -> Self {
        Self {
            company,
            scene: None,
            entrance: None,
            drawing,
            log: Log::default(),
            panel: None,
            rooms: RoomDisplay::default(),
            statistics: Statistics::default(),
            is_away: false,
            screen: Frame::default(),
            written: None,
        }
    }

    /// A visit without a server.
    pub(super) fn alone(world: &Arc<World>, start: Spawn, drawing: Drawing, now: Instant) -> Self {
        let building = ArrivingWorld::whole(world.clone());
        let scene = Some(Scene::new(building, start, drawing, now));
        let mut visit =
            Self { scene, entrance: Some(start), ..Self::with(Company::Nobody, drawing) };
        visit.log.add(now, HELP.to_owned());
        visit
    }

    /// The pose at which one looks around; `None` before there is a building.
    pub(super) fn pose(&self) -> Option<Pose> {
        self.scene.as_ref().map(Scene::pose)
    }

    /// What the window shows.
    pub(super) fn screen(&self) -> &Frame {
        &self.screen
    }

    /// The time spent on drawing.
    pub(super) fn draw_time(&self) -> Duration {
        self.scene.as_ref().map(Scene::draw_time).unwrap_or_default()
    }

    /// Whether the visit has ended by itself.
    pub(super) fn is_over(&self) -> bool {
        self.company.ended().is_some()
    }

    /// Whether Escape closes a panel.
    pub(super) fn has_panel(&self) -> bool {
        self.panel.is_some()
    }

    /// Leaves. Returns why there was no connection at the end, if there was none, and whether there
    /// ever was one.
    pub(super) fn leave(self) -> (Option<String>, bool) {
        self.company.leave()
    }

    /// Goes on to a moment, in a window of this size. Returns whether the screen has changed.
    pub(super) fn step(
        &mut self,
        controls: &mut Controls,
        size: (usize, usize),
        now: Instant,
    ) -> bool {
        self.company.poll(now);
        self.greet(now);
        self.open_scene(controls, now);
        self.handle_events(controls, now);
        if let Some(is_stuck) = self.go(controls, now)
            && is_stuck
        {
            self.log.add(now, STUCK.to_owned());
            self.go_home(controls, now);
        }
        let session = self.company.session();
        if let (Some(scene), Some(session)) = (&mut self.scene, session)
            && let Err(error) = scene.fetch(session, size.1)
        {
            session.give_up(format!("cannot use the server's world: {error}"));
        }
        let draws = |scene: &mut Scene| scene.draw(session, size, now, self.rooms);
        let is_drawn = self.scene.as_mut().is_some_and(draws);
        if is_drawn {
            self.statistics.count(now);
        }
        let overlay = self.overlay(controls, now);
        match &mut self.scene {
            Some(scene) => scene.show(&mut self.screen, size, &overlay),
            None => self.write(size, overlay),
        }
    }

    /// Says that one is back after the server was lost.
    fn greet(&mut self, now: Instant) {
        let is_present = self.company.session().is_some_and(Session::is_present);
        if is_present && self.is_away {
            self.log.add(now, BACK.to_owned());
        }
        self.is_away = self.scene.is_some() && !self.company.is_nobody() && !is_present;
    }

    /// Makes the scene when the first building is there.
    fn open_scene(&mut self, controls: &mut Controls, now: Instant) {
        if self.scene.is_some() {
            return;
        }
        let Some(session) = self.company.session() else { return };
        let pose = session.pose();
        let start = Spawn { eye: pose.eye, yaw: pose.yaw };
        self.scene = Some(Scene::new(session.building(), start, self.drawing, now));
        controls.face(&pose);
        self.log.add(now, HELP.to_owned());
    }

    /// Handles the events of the session.
    fn handle_events(&mut self, controls: &mut Controls, now: Instant) {
        let (Some(session), Some(scene)) = (self.company.session(), &mut self.scene) else {
            return;
        };
        for event in session.events() {
            match event {
                Event::Entered(pose) => {
                    if scene.enter(session, pose, controls) {
                        self.log.add(now, "you are in the changed building".to_owned());
                    }
                }
                Event::Corrected(pose) => scene.put(pose, controls),
                Event::Chat { name, text, .. } => self.log.add(now, format!("{name}: {text}")),
                Event::Notice(text) => self.log.add(now, text),
                Event::Goodbye(reason) => self.log.add(now, format!("goodbye: {reason}")),
                Event::Appeared(_) | Event::Vanished(_) => (),
            }
        }
    }

    /// Moves the body, and tells the session. Returns whether it is stuck; `None` where there is no
    /// body.
    fn go(&mut self, controls: &mut Controls, now: Instant) -> Option<bool> {
        let scene = self.scene.as_mut()?;
        let session = self.company.session();
        // Nobody walks without a server that knows it.
        let stands = !self.company.is_nobody() && !session.is_some_and(Session::is_present);
        let is_stuck = scene.go(controls, now, stands);
        if let Some(session) = session {
            session.set_pose(scene.pose());
        }
        Some(is_stuck)
    }

    /// Goes back to the entrance, by itself or by the server's leave. Without a connection it asks
    /// for one again.
    fn go_home(&mut self, controls: &mut Controls, now: Instant) {
        self.company.try_again(now);
        if let Some(session) = self.company.session() {
            session.respawn();
        } else if let (Some(scene), Some(Spawn { eye, yaw })) = (&mut self.scene, self.entrance) {
            scene.put(Pose { eye, yaw, ..Pose::default() }, controls);
        }
    }

    /// Does what a key asks for. Returns whether the person leaves.
    pub(super) fn act(&mut self, action: Action, controls: &mut Controls, now: Instant) -> bool {
        match action {
            Action::Leave => return self.panel.take().is_none(),
            Action::Panel(kind) => self.panel = Some(kind).filter(|kind| self.panel != Some(*kind)),
            Action::Statistics => self.statistics.is_shown ^= true,
            Action::Home => self.go_home(controls, now),
            Action::Rooms => self.toggle_rooms(now, |rooms| &mut rooms.outlines),
            Action::Hidden => self.toggle_rooms(now, |rooms| &mut rooms.hidden),
            Action::Say(line) => self.say(now, &line),
            Action::Bookmark(number) => self.bookmark(now, number),
            Action::Fly(number) => self.fly(now, number),
        }
        false
    }

    /// Turns something on or off that only a building with rooms has.
    fn toggle_rooms(&mut self, now: Instant, of: fn(&mut RoomDisplay) -> &mut bool) {
        let has_rooms = self.scene.as_ref().is_some_and(|scene| scene.surroundings.has_rooms());
        if self.scene.is_some() && !has_rooms {
            self.log.add(now, NO_ROOMS.to_owned());
        }
        let is_on = of(&mut self.rooms);
        *is_on = has_rooms && !*is_on;
    }

    /// Says something to the others.
    fn say(&mut self, now: Instant, line: &str) {
        let refused = match self.company.session() {
            Some(session) => session.chat(line).err().map(|error| error.to_string()),
            None if self.company.is_nobody() => Some("nobody else is here".to_owned()),
            None => Some("there is no connection".to_owned()),
        };
        if let Some(reason) = refused {
            self.log.add(now, format!("your line was not sent: {reason}"));
        }
    }

    /// Bookmarks the view.
    fn bookmark(&mut self, now: Instant, number: usize) {
        let Some(scene) = &mut self.scene else { return };
        scene.bookmarks.keep(number, scene.pose());
        self.log.add(now, format!("view {} is bookmarked", number + 1));
    }

    /// Starts a flight to a bookmarked view. Only possible without a server.
    fn fly(&mut self, now: Instant, number: usize) {
        let Some(scene) = &mut self.scene else { return };
        let pose = scene.pose();
        if !self.company.is_nobody() {
            let refused = "flights to views need a building without a server";
            self.log.add(now, refused.to_owned());
        } else if !scene.bookmarks.fly(number, pose, now) {
            let refused = format!("no view {0} is bookmarked: Ctrl+{0} bookmarks one", number + 1);
            self.log.add(now, refused);
        }
    }

    /// What is written over the picture now.
    fn overlay(&mut self, controls: &Controls, now: Instant) -> Overlay {
        let mut overlay = Overlay {
            lines: self.log.shown(now),
            typed: controls.line().map(str::to_owned),
            notice: self.company.notice(now),
            ..Overlay::default()
        };
        if matches!(self.panel, Some(PanelKind::Help)) {
            overlay.panel = Some(panels::help(self.company.is_nobody()));
        }
        let Some(scene) = &mut self.scene else { return overlay };
        if overlay.notice.is_none() && !scene.is_open() {
            overlay.notice = Some(arriving());
        }
        let (session, own) = (self.company.session(), scene.pose());
        let place = scene.surroundings.place_name(own.eye);
        let who = match session {
            Some(session) if session.is_present() => {
                words::in_sight(scene.seen().iter().map(|other| other.name.as_str()))
            }
            None if self.company.is_nobody() => "you are alone".to_owned(),
            Some(_) | None => "no connection".to_owned(),
        };
        overlay.status = format!("{place}: {who}");
        overlay.statistics = self.statistics.line(session, scene.seen().len(), now);
        let told = session.map(Session::shown_avatars).unwrap_or_default();
        match self.panel {
            Some(PanelKind::People) => {
                let in_sight: Vec<AvatarId> = scene.seen().iter().map(|other| other.id).collect();
                overlay.panel = Some(panels::people(&own, &told, &in_sight));
            }
            Some(PanelKind::Plan) => overlay.panel = Some(plan_of(scene, &own, &told)),
            Some(PanelKind::Help) | None => {}
        }
        overlay
    }

    /// Writes on an empty screen. Returns whether that changed it.
    fn write(&mut self, (width, height): (usize, usize), overlay: Overlay) -> bool {
        let is_same = (self.screen.width(), self.screen.height()) == (width, height);
        if is_same && self.written.as_ref() == Some(&overlay) {
            return false;
        }
        self.screen.resize(width, height);
        self.screen.colour.fill(BACKGROUND);
        overlay.draw(&mut self.screen);
        self.written = Some(overlay);
        true
    }
}

/// The plan of the storey that one is on.
fn plan_of(scene: &mut Scene, own: &Pose, told: &[ShownAvatar]) -> Panel {
    let title = |title: String| Panel::Table { title, rows: Vec::new() };
    let surroundings = &mut scene.surroundings;
    scene.wants_plan = true;
    let below_eye = surroundings.building.world().body.below_eye;
    let soles = own.eye.y - below_eye;
    let Some(plan) = surroundings.plans.at(&surroundings.building, soles) else {
        return title("The plan of this storey is not here yet".to_owned());
    };
    let others = told.iter().map(|other| (other.pose, other.colour));
    let marks = plan::marks(&plan, own, others, below_eye);
    Panel::Plan { plan, marks }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_alone_stands_still_without_a_new_picture_and_goes_home() {
        let world = Arc::new(sightline_fixtures::voxel_floor::world(&[]));
        let start = sightline_fixtures::voxel_floor::SPAWN;
        let mut now = Instant::now();
        let mut visit = Visit::alone(&world, start, Drawing::default(), now);
        let mut controls = Controls::default();
        let mut seconds = |visit: &mut Visit, controls: &mut Controls, ticks: u32| {
            let mut drawn = 0;
            for _ in 0..ticks {
                now += Duration::from_millis(20);
                drawn += usize::from(visit.step(controls, (64, 48), now));
            }
            drawn
        };
        seconds(&mut visit, &mut controls, 50);
        assert_eq!(seconds(&mut visit, &mut controls, 50), 0, "a still scene");
        controls.key(winit::keyboard::KeyCode::KeyW, true, None);
        assert!(seconds(&mut visit, &mut controls, 50) > 45, "a walk");
        controls.release();
        let away = visit.pose().unwrap().eye;
        assert!(away.distance(start.eye) > 1.0);
        let later = Instant::now() + Duration::from_secs(60);
        assert!(!visit.act(Action::Home, &mut controls, later));
        assert!(visit.pose().unwrap().eye.distance(start.eye) < 0.1);
        assert!(!visit.act(Action::Rooms, &mut controls, later));
        assert!(visit.log.shown(later).contains(&NO_ROOMS.to_owned()));
        visit.act(Action::Panel(PanelKind::Help), &mut controls, later);
        assert!(visit.has_panel() && !visit.act(Action::Leave, &mut controls, later));
        assert!(visit.act(Action::Leave, &mut controls, later), "no panel is left to close");
    }
}
