//! The client for browsers: what a page calls to be in a building.
//!
//! A page carries the bytes and shows the pictures; everything else is here. There is one
//! [`Client`] on a page. The page gives it what arrives ([`Client::control`],
//! [`Client::datagram`]) and sends what it has to say ([`Client::take_control`],
//! [`Client::take_datagram`]). It fetches the world that the client wants ([`Client::wanted`]),
//! moves the body ([`Client::step`]) and draws ([`Client::draw`]). Times are milliseconds since
//! the page was opened. What a page shows in words comes as JSON ([`Client::state`]).
//!
//! There is no socket, no clock and no thread. `page/` has the page itself.

mod connection;
mod hello;
mod reported;
mod resolution;
mod scene;
mod walk;

use std::time::Duration;

use sightline_client_core::replica::Event;
use wasm_bindgen::prelude::*;

use self::{
    connection::Connection,
    hello::Hello,
    reported::{Said, reported},
    resolution::Resolution,
    scene::Scene,
};

/// The client of a page.
#[wasm_bindgen]
pub struct Client {
    connection: Connection,
    /// `None` before the client is in a world for the first time.
    scene: Option<Scene>,
    resolution: Resolution,
    /// What the page has not shown yet.
    said: Vec<Said>,
}

#[wasm_bindgen]
impl Client {
    /// A client that will call itself so, with a colour as 0xRRGGBB, a secret of 32 bytes by which
    /// the server knows it again, and an invitation where one is needed (empty where none is).
    ///
    /// # Errors
    /// When one of them cannot be taken: the reason, in words.
    #[wasm_bindgen(constructor)]
    pub fn new(name: &str, colour: u32, secret: &[u8], invitation: &str) -> Result<Self, JsError> {
        let hello =
            Hello::new(name, colour, secret, invitation).map_err(|why| JsError::new(&why))?;
        Ok(Self {
            connection: Connection::new(hello),
            scene: None,
            resolution: Resolution::default(),
            said: Vec::new(),
        })
    }

    /// A connection is open: the client says hello.
    pub fn opened(&mut self, now_ms: f64) {
        self.connection.opened(time(now_ms));
    }

    /// The connection has ended, or none could be made, for a reason in words.
    pub fn closed(&mut self, now_ms: f64, reason: &str) {
        self.connection.closed(time(now_ms), reason);
    }

    /// Bytes of the control stream have arrived.
    pub fn control(&mut self, now_ms: f64, bytes: &[u8]) {
        self.connection.control(time(now_ms), bytes);
        self.take_events();
    }

    /// A datagram has arrived.
    pub fn datagram(&mut self, now_ms: f64, bytes: &[u8]) {
        self.connection.datagram(time(now_ms), bytes);
    }

    /// Says goodbye: the page is being closed.
    pub fn leave(&mut self) {
        self.connection.leave();
    }

    /// Whether the client is in a world, on a connection that stands.
    pub fn is_in(&self) -> bool {
        self.connection.is_in()
    }

    /// Whether the server or the client has ended the connection.
    pub fn is_over(&self) -> bool {
        self.connection.is_over()
    }

    /// Whatever the client sends by itself becomes due. To be called at each tick.
    pub fn tick(&mut self, now_ms: f64) {
        self.connection.tick(time(now_ms));
    }

    /// The server's time from tick to tick, in milliseconds.
    pub fn tick_ms(&self) -> f64 {
        self.connection.tick_interval().as_secs_f64() * 1e3
    }

    /// The bytes to send on the control stream; empty when there are none.
    pub fn take_control(&mut self) -> Vec<u8> {
        self.connection.take_control()
    }

    /// The next datagram to send.
    pub fn take_datagram(&mut self) -> Option<Vec<u8>> {
        self.connection.take_datagram()
    }

    /// The content id of the world that the client needs and does not have.
    pub fn wanted(&self) -> Option<String> {
        self.connection.wanted().map(|id| id.to_string())
    }

    /// Gives the file of the world that was wanted. Files that are not wanted are ignored.
    pub fn give_world(&mut self, bytes: &[u8]) {
        self.connection.give_world(bytes);
    }

    /// Turns the view, in radians.
    pub fn turn(&mut self, left: f32, up: f32) {
        if let Some(scene) = &mut self.scene {
            scene.walk.turn(left, up);
        }
    }

    /// Moves the body on to a moment, as far as the connection allows it. Forward and right are
    /// shares of the greatest speed, from -1 to 1.
    pub fn step(&mut self, now_ms: f64, forward: f32, right: f32, up: f32, jump: bool, fly: bool) {
        let now = time(now_ms);
        let Some(scene) = &mut self.scene else { return };
        let stands = !self.connection.is_in();
        let is_stuck = scene.walk.step(now, [forward, right, up], jump, fly, stands);
        self.connection.set_pose(now, scene.walk.pose());
        if is_stuck {
            self.said.push(Said::notice("you were stuck, and go back to the entrance"));
            self.connection.respawn();
        }
    }

    /// Walks to the floor below a point of the world, in metres. Returns whether a way leads there.
    pub fn go_to(&mut self, x: f32, y: f32, z: f32) -> bool {
        self.scene.as_mut().is_some_and(|scene| scene.walk.go_to(glam::Vec3::new(x, y, z)))
    }

    /// Stops walking to a place.
    pub fn stop(&mut self) {
        if let Some(scene) = &mut self.scene {
            scene.walk.stop();
        }
    }

    /// Asks to be put back to the entrance.
    pub fn go_home(&mut self) {
        self.connection.respawn();
    }

    /// Says something to those in sight. Returns why it cannot be said, if it cannot.
    pub fn say(&mut self, text: &str) -> Option<String> {
        self.connection.say(text).err()
    }

    /// The size to draw in for a canvas of this many device pixels, so that it is drawn often
    /// enough: columns and rows.
    pub fn size(&mut self, now_ms: f64, columns: usize, rows: usize) -> Vec<usize> {
        let rests = self.scene.as_ref().is_some_and(|scene| scene.rests(time(now_ms)));
        self.resolution.size([columns, rows], rests).to_vec()
    }

    /// Takes in how long a new picture took until it was on the page, in milliseconds.
    pub fn drew(&mut self, milliseconds: f64) {
        self.resolution.drew(milliseconds as f32);
    }

    /// Draws what one sees now. Returns whether the picture has changed since the last call.
    pub fn draw(&mut self, now_ms: f64, columns: usize, rows: usize) -> bool {
        let Some(scene) = &mut self.scene else { return false };
        scene.draw(self.connection.replica(), time(now_ms), (columns, rows))
    }

    /// Draws what rooms hide from the eye from now on, or leaves it out again. Returns false where
    /// the author of the building has declared no rooms.
    pub fn toggle_hidden(&mut self) -> bool {
        self.scene.as_mut().is_none_or(Scene::toggle_hidden)
    }

    /// Where the bytes of the picture begin in the memory: red, green, blue and 255 for each pixel,
    /// row by row.
    pub fn pixels(&self) -> usize {
        self.scene.as_ref().map_or(0, |scene| scene.pixels().as_ptr() as usize)
    }

    /// How the client stands, where it is and who is near, as JSON.
    pub fn state(&mut self, now_ms: f64) -> String {
        reported(&self.connection, self.scene.as_ref(), time(now_ms))
    }

    /// What was said, and what happened, since the last call, as a JSON list.
    pub fn said(&mut self) -> String {
        let said = std::mem::take(&mut self.said);
        serde_json::to_string(&said).unwrap_or_default()
    }

    /// The rooms that the author of the building has declared, as a JSON list.
    pub fn rooms(&self) -> String {
        let rooms = self.scene.as_ref().map(Scene::rooms).unwrap_or_default();
        serde_json::to_string(&rooms).unwrap_or_default()
    }

    /// Goes on making the plan of the storey that one is on, by some rows. Returns whether another
    /// one has been finished.
    pub fn make_plan(&mut self, rows: usize) -> bool {
        self.scene.as_mut().is_some_and(|scene| scene.make_plan(rows))
    }

    /// Whether a plan is being made.
    pub fn makes_plan(&self) -> bool {
        self.scene.as_ref().is_some_and(Scene::makes_plan)
    }

    /// Where the plan is, in metres and pixels, as JSON; empty before there is one.
    pub fn plan(&self) -> String {
        let plan = self.scene.as_ref().and_then(Scene::plan_place);
        plan.and_then(|place| serde_json::to_string(&place).ok()).unwrap_or_default()
    }

    /// The pixels of the plan: red, green, blue and opacity for each, row by row.
    pub fn plan_pixels(&self) -> Vec<u8> {
        self.scene.as_ref().map(Scene::plan_pixels).unwrap_or_default()
    }

    /// Takes in what has happened in the world.
    fn take_events(&mut self) {
        for event in self.connection.take_events() {
            match event {
                Event::Entered(pose) => {
                    let Some(world) = self.connection.world() else { continue };
                    match &mut self.scene {
                        Some(scene) => {
                            if scene.enter(world, pose) {
                                self.said.push(Said::notice("you are in the changed building"));
                            }
                        }
                        None => self.scene = Some(Scene::new(world, pose)),
                    }
                }
                Event::Corrected(pose) => {
                    if let Some(scene) = &mut self.scene {
                        scene.walk.put(pose);
                    }
                }
                Event::Chat { name, text, .. } => self.said.push(Said::chat(name, text)),
                Event::Notice(text) => self.said.push(Said::notice(&text)),
                Event::Goodbye(_) | Event::Appeared(_) | Event::Vanished(_) => {}
            }
        }
    }
}

/// A time of the page.
fn time(milliseconds: f64) -> Duration {
    Duration::try_from_secs_f64(milliseconds / 1e3).unwrap_or_default()
}
