//! How a client stands in the worlds of a server: it enters, moves over into others, and comes back
//! after its link broke. What it knows of the others is its [`Replica`].
//!
//! It has no socket and no clock, so the sessions of all kinds of clients share it. Whoever carries
//! its messages says hello first, and fetches the worlds that are offered.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use sightline_protocol::{
    message::{ClientMessage, HeadOffer, STATIONS_TOLD_MAX, ServerMessage, StationAddress},
    text::Name,
};
use sightline_world::{
    ContentId, World,
    motion::{Agility, AvatarId, Pose},
};

use crate::{
    own_motion::OwnMotion,
    replica::{Event, Outgoing, Replica, ReplicaError},
};

/// An avatar that is put no farther away than this, in metres, goes on where it was.
const GOES_ON_M: f32 = 1.0;
/// The number of events kept for the caller. Beyond it, the oldest are dropped.
const EVENTS_MAX: usize = 1_024;

/// How the client stands with the server. Unless it is present, its avatar stands still.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// It is in the world.
    Present,
    /// It is on its way into another world.
    MovingOver,
    /// The link broke at a time, for a reason.
    Broken(Duration, String),
}

/// A world that the server offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorldOffer {
    /// The number of the world: each is higher than the one before.
    pub number: u32,
    /// The content id of the world.
    pub id: ContentId,
    /// The length of its file.
    pub bytes: u64,
    /// Its head, where it can be had in pieces.
    pub head: Option<HeadOffer>,
}

/// What comes of a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// Nothing that its carrier must do.
    Nothing,
    /// Another world is offered. Once the client has it, [`Presence::leave_world`] follows.
    World(WorldOffer),
    /// The server ends the connection.
    Goodbye {
        /// The reason, to show to people.
        reason: String,
        /// Whether the client may come back by itself.
        may_return: bool,
    },
}

/// How a client stands in the worlds of a server.
#[derive(Clone, Debug)]
pub struct Presence {
    /// What the client knows of the others.
    pub replica: Replica,
    /// The name of this client, as the server knows it.
    name: Name,
    world: Arc<World>,
    link: Link,
    returns: u32,
    own_motion: OwnMotion,
    /// Where the client was when it was told of the world that it enters now.
    moves_from: Option<Pose>,
    events: VecDeque<Event>,
    /// Where the client may go when its server is lost.
    stations: Vec<StationAddress>,
}

impl Presence {
    /// A client that was welcomed as `avatar`, and has the first world that it was offered.
    pub fn new(avatar: AvatarId, tick_interval: Duration, world: Arc<World>, name: Name) -> Self {
        let agility = Agility::of(&world.body, world.speed_max);
        Self {
            replica: Replica::new(avatar, tick_interval, agility),
            name,
            world,
            link: Link::Present,
            returns: 0,
            own_motion: OwnMotion::default(),
            moves_from: None,
            events: VecDeque::new(),
            stations: Vec::new(),
        }
    }

    /// The world that the client is in, or was in last.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// How the client stands with the server.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// How often the link broke and the client came back.
    pub fn returns(&self) -> u32 {
        self.returns
    }

    /// Other servers of the building, to which the client may go when its own is lost.
    pub fn stations(&self) -> &[StationAddress] {
        &self.stations
    }

    /// The events since the last call, oldest first.
    pub fn take_events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }

    /// Sets the pose of the own avatar, once per frame. Where nobody asks for another one it goes
    /// straight on from there.
    pub fn set_pose(&mut self, now: Duration, pose: Pose) {
        if self.link == Link::Present {
            self.replica.set_pose(pose);
            if pose.is_finite() {
                self.own_motion.set(now, pose);
            }
        }
    }

    /// Takes in that the link broke. Returns whether the client was in a world until then.
    pub fn lose(&mut self, now: Duration, reason: String) -> bool {
        let was_in = !matches!(self.link, Link::Broken(..));
        if was_in {
            self.stand(now, Link::Broken(now, reason));
        }
        was_in
    }

    /// Begins anew on another connection, as which the client was welcomed as `avatar`, with the
    /// world that is offered there. Returns what asks to go on in it.
    pub fn reconnect(
        &mut self,
        avatar: AvatarId,
        tick_interval: Duration,
        number: u32,
        world: Arc<World>,
    ) -> ClientMessage {
        let agility = Agility::of(&world.body, world.speed_max);
        let reports_from = self.replica.reconnect(avatar, tick_interval, agility);
        self.returns += 1;
        self.ask_to_enter(number, world, reports_from)
    }

    /// Leaves the world for another one that was offered, whose world file is here. Returns what
    /// asks to go on in it.
    pub fn leave_world(&mut self, number: u32, world: Arc<World>) -> ClientMessage {
        let agility = Agility::of(&world.body, world.speed_max);
        let reports_from = self.replica.leave_world(agility);
        self.ask_to_enter(number, world, reports_from)
    }

    fn ask_to_enter(&mut self, number: u32, world: Arc<World>, reports_from: u32) -> ClientMessage {
        self.world = world;
        let from = self.replica.pose();
        self.moves_from = Some(from);
        ClientMessage::Enter { world: number, place: Some(from.eye.into()), reports_from }
    }

    /// Takes in a message of a server that has welcomed this client. Returns what comes of it, and
    /// the answer if the server asked.
    ///
    /// # Errors
    /// When the server breaks the protocol.
    pub fn hear(
        &mut self,
        now: Duration,
        message: ServerMessage,
    ) -> Result<(Heard, Option<ClientMessage>), ReplicaError> {
        if let ServerMessage::World { number, id, bytes, head } = message {
            self.stand(now, Link::MovingOver);
            let offer = WorldOffer { number, id: ContentId(id), bytes, head };
            return Ok((Heard::World(offer), None));
        }
        if let ServerMessage::Stations { mut others } = message {
            others.truncate(STATIONS_TOLD_MAX);
            self.stations = others;
            return Ok((Heard::Nothing, None));
        }
        let heard = match &message {
            ServerMessage::Goodbye { reason, may_return } => {
                Heard::Goodbye { reason: reason.to_string(), may_return: *may_return }
            }
            _ => Heard::Nothing,
        };
        if let Some(event) = self.replica.message(now, message)? {
            let event = self.take_in(event);
            self.push_event(event);
        }
        self.move_on(now);
        Ok((heard, self.replica.answer(now)))
    }

    /// What an event means to somebody who may be on the way into another world.
    fn take_in(&mut self, event: Event) -> Event {
        match event {
            Event::Entered(given) => match self.moves_from.take() {
                Some(from) => Event::Entered(self.move_over(&from, given)),
                None => event,
            },
            Event::Corrected(_) => {
                self.own_motion.clear();
                event
            }
            Event::Chat { from, text, .. } if from == self.replica.avatar() => {
                Event::Chat { from, name: self.name.to_string(), text }
            }
            event => event,
        }
    }

    /// What to send at a tick that was due at a time, which may be a while ago. The round trip is a
    /// measured one, and a number of packets were lost so far.
    pub fn tick(
        &mut self,
        due: Duration,
        round_trip: Duration,
        lost_packets: u64,
    ) -> Option<Outgoing> {
        self.move_on(due);
        self.replica.hear_losses(due, lost_packets);
        self.replica.tick(due, round_trip)
    }

    /// Stands still until the client is in a world again.
    fn stand(&mut self, now: Duration, link: Link) {
        self.move_on(now);
        self.own_motion.clear();
        self.link = link;
    }

    /// Moves over into another world: the client is given a place there. One that goes on near its
    /// former place looks where it looked.
    fn move_over(&mut self, from: &Pose, given: Pose) -> Pose {
        let goes_on = from.eye.distance(given.eye) < GOES_ON_M;
        let (yaw, pitch) = if goes_on { (from.yaw, from.pitch) } else { (given.yaw, given.pitch) };
        let pose = Pose { yaw, pitch, ..given };
        self.replica.set_pose(pose);
        self.link = Link::Present;
        pose
    }

    /// Moves the own avatar to where it was at a time.
    fn move_on(&mut self, time: Duration) {
        if let Some(pose) = self.own_motion.at(time) {
            self.replica.set_pose(pose);
        }
    }

    /// Keeps an event for the caller. Drops the oldest one when too many wait.
    fn push_event(&mut self, event: Event) {
        if self.events.len() >= EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(event);
        debug_assert!(self.events.len() <= EVENTS_MAX, "the queue is bounded");
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_fixtures::voxel_floor;
    use sightline_protocol::fingerprint::Fingerprint;

    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    #[test]
    fn who_comes_back_goes_on_where_it_was_and_stands_still_meanwhile() {
        let world = Arc::new(voxel_floor::world(&[]));
        let name = Name::new("Ada").unwrap();
        let mut presence = Presence::new(AvatarId(1), TICK, world.clone(), name);
        let entered = |pose: &Pose| ServerMessage::Entered { pose: pose.into(), tick: 1 };
        let start = Pose { eye: voxel_floor::SPAWN.eye, yaw: 1.0, ..Pose::default() };
        presence.hear(TICK, entered(&start)).unwrap();
        let stood = Pose { eye: start.eye + Vec3::X, yaw: 2.0, ..Pose::default() };
        presence.set_pose(TICK, stood);
        assert!(presence.lose(TICK * 2, "the cable".to_owned()));
        assert!(!presence.lose(TICK * 3, "again".to_owned()), "it is lost once");
        presence.set_pose(TICK * 4, start);
        let asks = presence.reconnect(AvatarId(2), TICK, 7, world);
        let ClientMessage::Enter { world: 7, place: Some(place), .. } = asks else {
            panic!("{asks:?}")
        };
        assert!(Vec3::from(place).distance(stood.eye) < 0.002);
        let given = Pose { eye: stood.eye, yaw: 0.0, ..Pose::default() };
        presence.hear(TICK * 5, entered(&given)).unwrap();
        assert_eq!((presence.link(), presence.returns()), (&Link::Present, 1));
        let events = presence.take_events();
        assert!(matches!(events[..], [_, Event::Entered(pose)] if pose.yaw == 2.0), "{events:?}");
    }

    #[test]
    fn the_last_list_of_stations_counts_and_is_bounded() {
        let world = Arc::new(voxel_floor::world(&[]));
        let mut presence = Presence::new(AvatarId(1), TICK, world, Name::new("Ada").unwrap());
        let others = |ports: std::ops::Range<u16>| -> Vec<StationAddress> {
            let at = |port| StationAddress {
                address: ([127, 0, 0, 1], port).into(),
                fingerprint: Fingerprint([7; 32]),
            };
            ports.map(at).collect()
        };
        for ports in [1..3, 5..5 + 2 * STATIONS_TOLD_MAX as u16] {
            let heard = presence.hear(TICK, ServerMessage::Stations { others: others(ports) });
            assert_eq!(heard.unwrap(), (Heard::Nothing, None));
        }
        assert_eq!(presence.stations(), others(5..5 + STATIONS_TOLD_MAX as u16));
    }

    #[test]
    fn another_world_is_entered_where_the_client_was_and_a_far_place_turns_it() {
        let world = Arc::new(voxel_floor::world(&[]));
        let mut presence =
            Presence::new(AvatarId(1), TICK, world.clone(), Name::new("Ada").unwrap());
        let offer = ServerMessage::World { number: 3, id: [4; 32], bytes: 5, head: None };
        let (heard, answer) = presence.hear(TICK, offer).unwrap();
        let offer = WorldOffer { number: 3, id: ContentId([4; 32]), bytes: 5, head: None };
        assert_eq!((heard, answer), (Heard::World(offer), None));
        assert_eq!(presence.link(), &Link::MovingOver);
        presence.leave_world(3, world);
        let far = Pose { eye: Vec3::new(6.0, 1.7, 6.0), yaw: 3.0, ..Pose::default() };
        presence.hear(TICK, ServerMessage::Entered { pose: (&far).into(), tick: 1 }).unwrap();
        assert!((presence.replica.pose().yaw - 3.0).abs() < 0.001);
    }
}
