//! The client for browsers: what a page calls to be in a building.
//!
//! A page carries the bytes and shows the pictures; everything else is here. There is one
//! [`Client`] on a page. The page gives it what arrives ([`Client::control`], [`Client::datagram`])
//! and sends what it has to say ([`Client::take_control`], [`Client::take_datagram`]). It fetches
//! the world that the client wants ([`Client::wanted`]), or its pieces ([`Client::next_pieces`]),
//! moves the body ([`Client::step`]) and draws ([`Client::draw`]). Times are milliseconds since the
//! page was opened. What a page shows in words comes as JSON ([`Client::state`]).
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
    connection::{Connection, Wanted},
    hello::Hello,
    reported::{Said, reported},
    resolution::Resolution,
    scene::{Scene, Step},
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

    /// The path of what the client needs before it can come in: the file of a world, or its head.
    pub fn wanted(&self) -> Option<String> {
        self.connection.wanted().map(Wanted::path)
    }

    /// Gives what was wanted. Bytes that are not wanted are ignored.
    pub fn give(&mut self, bytes: &[u8]) {
        self.connection.give(bytes);
    }

    /// The path of pieces to fetch now, if there are any. With those that are under way they take at
    /// most `bytes_max` bytes, or are one.
    pub fn next_pieces(&mut self, bytes_max: usize) -> Option<String> {
        let scene = self.scene.as_mut()?;
        let head = scene.head?;
        let numbers = scene.next_pieces(bytes_max);
        let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        (!numbers.is_empty()).then(|| format!("pieces/{head}/{}", numbers.join(",")))
    }

    /// Gives what was at the path of pieces, without those whose numbers are `refused`, with commas
    /// between them; nothing when it could not be had. Then they are asked for again.
    pub fn give_pieces(&mut self, path: &str, bytes: Option<Vec<u8>>, refused: &str) {
        let Some(scene) = &mut self.scene else { return };
        let Some(head) = scene.head else { return };
        // What comes of a world that was left is of no use.
        let Some(numbers) = path.strip_prefix(&format!("pieces/{head}/")) else { return };
        let [numbers, refused] = [numbers, refused].map(|list| {
            list.split(',').filter_map(|number| number.parse().ok()).collect::<Vec<usize>>()
        });
        if let Err(error) = scene.give_pieces(&numbers, bytes.as_deref(), &refused) {
            self.connection.refuse_world(&error.to_string());
        }
    }

    /// Whether there is enough of the building for a picture.
    pub fn is_open(&self) -> bool {
        self.scene.as_ref().is_some_and(Scene::is_open)
    }

    /// The share of the building that is here, from 0 to 1.
    pub fn share(&self) -> f32 {
        self.scene.as_ref().map_or(0.0, Scene::share)
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
        let step = scene.step(now, [forward, right, up], jump, fly, stands);
        self.connection.set_pose(now, scene.walk.pose());
        match step {
            Step::Moved => {}
            Step::Stuck => {
                self.said.push(Said::notice("you were stuck, and go back to the entrance"));
                self.connection.respawn();
            }
            Step::NoWay => self.said.push(Said::notice("no way leads there from here")),
        }
    }

    /// Walks to the floor below a point of the world, in metres. Returns whether a way leads there.
    /// While not all of the building is here, that is not known, and the way is found later.
    pub fn go_to(&mut self, x: f32, y: f32, z: f32) -> bool {
        let Some(scene) = &mut self.scene else { return false };
        let is_whole = scene.share() >= 1.0;
        let goes = scene.go_to(glam::Vec3::new(x, y, z));
        if !is_whole {
            self.said.push(Said::notice("you go there once all of the building is here"));
        }
        goes
    }

    /// Stops walking to a place.
    pub fn stop(&mut self) {
        if let Some(scene) = &mut self.scene {
            scene.stop();
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
        if let Some(scene) = &mut self.scene {
            scene.set_full_size((columns, rows));
        }
        self.resolution.size([columns, rows], rests).to_vec()
    }

    /// Takes in how long a new picture took until it was on the page, in milliseconds.
    pub fn drew(&mut self, milliseconds: f64) {
        self.resolution.drew(milliseconds as f32);
    }

    /// Draws what one sees now. Returns whether the picture has changed since the last call.
    pub fn draw(&mut self, now_ms: f64, columns: usize, rows: usize) -> bool {
        let Some(scene) = &mut self.scene else { return false };
        if let Err(error) = scene.take_pieces() {
            self.connection.refuse_world(&error.to_string());
        }
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

    /// Takes the plan of the storey that one is on, or goes on making it, by some rows. Returns
    /// whether there is another one now.
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
                        Some(scene) if scene.is_in(&world) => scene.walk.put(pose),
                        scene => {
                            let Some(building) = self.connection.building() else { continue };
                            if scene
                                .replace(Scene::new(building, self.connection.head_id(), pose))
                                .is_some()
                            {
                                self.said.push(Said::notice("you are in the changed building"));
                            }
                        }
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
