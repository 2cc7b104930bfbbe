//! A connection without its socket: from hello to the world, and what is said meanwhile.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use sightline_client_core::{
    arriving::ArrivingWorld,
    presence::{Heard, Link, Presence, WorldOffer},
    replica::{Event, Outgoing, Replica},
};
use sightline_protocol::{
    frame::{self, FrameBuffer},
    message::{ClientMessage, Refusal, ServerMessage},
    text::ChatLine,
};
use sightline_world::{
    ContentId, PieceId, World, WorldHead, content_id,
    motion::{AvatarId, Pose},
};

use crate::hello::Hello;

/// The time between ticks before the server has said it.
const TICK: Duration = Duration::from_millis(50);
/// The round trip before one was measured.
const ROUND_TRIP: Duration = Duration::from_millis(100);
/// The number of datagrams that may wait to be sent. Beyond it, the oldest are dropped.
const DATAGRAMS_MAX: usize = 8;

/// How far a client has come.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Stage {
    /// There is no connection, for this reason.
    Closed(String),
    /// It has said hello.
    Greeted,
    /// It is welcome, and the server has no world yet: what it does meanwhile.
    Waiting(String),
    /// The world of the offer is needed.
    Fetching,
    /// It has asked to enter.
    Entering,
    /// It is in the world.
    In,
    /// The server, or the client, ended it.
    Over(Ending),
}

/// Why a connection was ended.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ending {
    /// To show to people.
    pub(crate) reason: String,
    /// Whether another attempt may succeed.
    pub(crate) may_pass: bool,
    /// When it may, at the earliest.
    pub(crate) retry: Duration,
    /// Whether the server speaks another version: it has another page.
    pub(crate) is_version: bool,
}

/// A world that is here, or of which the head is.
#[derive(Debug)]
struct KnownWorld {
    id: ContentId,
    /// The head by which its pieces come; `None` when it is a whole one.
    head: Option<PieceId>,
    world: Arc<World>,
}

/// What a client needs of a world that is offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Its file.
    File(ContentId),
    /// Its head.
    Head(PieceId),
}

impl Wanted {
    /// The path by which a page fetches it.
    pub(crate) fn path(self) -> String {
        match self {
            Self::File(id) => format!("world/{id}"),
            Self::Head(id) => format!("pieces/{id}/head"),
        }
    }
}

/// A connection without its socket, and what lasts from one to the next.
#[derive(Debug)]
pub(crate) struct Connection {
    hello: Hello,
    stage: Stage,
    frames: FrameBuffer,
    control: Vec<u8>,
    datagrams: VecDeque<Vec<u8>>,
    /// As whom the server has welcomed this client, and the time between its ticks.
    welcomed: Option<(AvatarId, Duration)>,
    /// Whether [`Connection::presence`] is about this connection.
    is_presence_new: bool,
    offer: Option<WorldOffer>,
    /// The world that is here.
    world: Option<KnownWorld>,
    /// The head of that world, until a scene takes it.
    head: Option<WorldHead>,
    /// Whether heads of this server cannot be read, so that files are fetched.
    needs_files: bool,
    /// `None` before the first world.
    presence: Option<Presence>,
    /// When the hello was said.
    hello_at: Duration,
    round_trip: Duration,
}

impl Connection {
    pub(crate) fn new(hello: Hello) -> Self {
        Self {
            hello,
            stage: Stage::Closed(String::new()),
            frames: FrameBuffer::default(),
            control: Vec::new(),
            datagrams: VecDeque::new(),
            welcomed: None,
            is_presence_new: false,
            offer: None,
            world: None,
            head: None,
            needs_files: false,
            presence: None,
            hello_at: Duration::ZERO,
            round_trip: ROUND_TRIP,
        }
    }

    pub(crate) fn stage(&self) -> &Stage {
        &self.stage
    }

    pub(crate) fn is_in(&self) -> bool {
        self.stage == Stage::In
    }

    pub(crate) fn is_over(&self) -> bool {
        matches!(self.stage, Stage::Over(_))
    }

    /// The world that the client is in, or was in last.
    pub(crate) fn world(&self) -> Option<Arc<World>> {
        self.presence.as_ref().map(|presence| presence.world().clone())
    }

    pub(crate) fn replica(&mut self) -> Option<&mut Replica> {
        self.presence.as_mut().map(|presence| &mut presence.replica)
    }

    pub(crate) fn presence(&self) -> Option<&Presence> {
        self.presence.as_ref()
    }

    pub(crate) fn tick_interval(&self) -> Duration {
        self.welcomed.map_or(TICK, |(_, interval)| interval)
    }

    pub(crate) fn take_events(&mut self) -> Vec<Event> {
        self.presence.as_mut().map(Presence::take_events).unwrap_or_default()
    }

    /// A socket is open.
    pub(crate) fn opened(&mut self, now: Duration) {
        self.forget_link();
        self.stage = Stage::Greeted;
        self.hello_at = now;
        self.send(&self.hello.message());
    }

    /// The socket has closed. Why the server ended the connection before stays known.
    pub(crate) fn closed(&mut self, now: Duration, reason: &str) {
        self.forget_link();
        self.lose(now, reason);
        if !matches!(self.stage, Stage::Over(_)) {
            self.stage = Stage::Closed(reason.to_owned());
        }
    }

    fn forget_link(&mut self) {
        (self.frames, self.control) = (FrameBuffer::default(), Vec::new());
        self.datagrams.clear();
        (self.welcomed, self.offer, self.is_presence_new) = (None, None, false);
    }

    fn lose(&mut self, now: Duration, reason: &str) {
        if let Some(presence) = &mut self.presence {
            presence.lose(now, reason.to_owned());
        }
    }

    /// Takes in bytes of the control stream.
    pub(crate) fn control(&mut self, now: Duration, bytes: &[u8]) {
        self.frames.push(bytes);
        while !matches!(self.stage, Stage::Closed(_) | Stage::Over(_)) {
            let message = match self.frames.next_frame() {
                Ok(Some(frame)) => ServerMessage::decode(frame),
                Ok(None) => return,
                Err(error) => Err(error),
            };
            match message {
                Ok(message) => self.hear(now, message),
                Err(error) => self.end(now, format!("the server sent a {error}"), false),
            }
        }
    }

    fn hear(&mut self, now: Duration, message: ServerMessage) {
        match self.stage {
            Stage::Greeted => self.hear_answer(now, message),
            Stage::Waiting(_) | Stage::Fetching => self.hear_offer(now, message),
            Stage::Entering | Stage::In => self.hear_in_world(now, message),
            Stage::Closed(_) | Stage::Over(_) => {}
        }
    }

    /// The answer to the hello.
    fn hear_answer(&mut self, now: Duration, message: ServerMessage) {
        match message {
            ServerMessage::Welcome { avatar, tick_interval_us } => {
                let interval = Duration::from_micros(tick_interval_us.get().into());
                self.welcomed = Some((avatar, interval));
                self.round_trip = now.saturating_sub(self.hello_at);
                self.stage = Stage::Waiting(String::new());
            }
            ServerMessage::Refused { reason } => self.refuse(now, reason),
            ServerMessage::Goodbye { reason, may_return } => {
                self.end(now, reason.into(), may_return);
            }
            _ => self.out_of_place(now),
        }
    }

    fn refuse(&mut self, now: Duration, refusal: Refusal) {
        let may_pass = matches!(refusal, Refusal::Full | Refusal::Closing | Refusal::Busy { .. });
        self.end(now, refusal.to_string(), may_pass);
        if let Stage::Over(ending) = &mut self.stage {
            ending.is_version = matches!(refusal, Refusal::Version { .. });
            if let Refusal::Busy { retry_ms } = refusal {
                ending.retry = Duration::from_millis(retry_ms.into());
            }
        }
    }

    /// What a client hears that has no world.
    fn hear_offer(&mut self, now: Duration, message: ServerMessage) {
        match message {
            ServerMessage::World { number, id, bytes, head } => {
                self.take_offer(WorldOffer { number, id: ContentId(id), bytes, head });
            }
            ServerMessage::Loading { what } => self.stage = Stage::Waiting(what.into()),
            // What was said to somebody in another world.
            ServerMessage::Notice { .. } | ServerMessage::Stations { .. } => {}
            ServerMessage::Goodbye { reason, may_return } => {
                self.end(now, reason.into(), may_return);
            }
            _ => self.out_of_place(now),
        }
    }

    fn hear_in_world(&mut self, now: Duration, message: ServerMessage) {
        let is_entered = matches!(message, ServerMessage::Entered { .. });
        let Some(presence) = &mut self.presence else { return };
        match presence.hear(now, message) {
            Ok((heard, answer)) => {
                if is_entered {
                    self.stage = Stage::In;
                }
                if let Some(answer) = answer {
                    self.send(&answer);
                }
                match heard {
                    Heard::Nothing => {}
                    Heard::World(offer) => self.take_offer(offer),
                    Heard::Goodbye { reason, may_return } => self.end(now, reason, may_return),
                }
            }
            Err(error) => self.end(now, error.to_string(), false),
        }
    }

    fn out_of_place(&mut self, now: Duration) {
        self.end(now, "the server sent a message out of place".to_owned(), false);
    }

    fn end(&mut self, now: Duration, reason: String, may_pass: bool) {
        self.lose(now, &reason);
        let retry = Duration::ZERO;
        self.stage = Stage::Over(Ending { reason, may_pass, retry, is_version: false });
    }

    /// Takes in an offer. The world may be here already.
    fn take_offer(&mut self, offer: WorldOffer) {
        self.offer = Some(offer);
        let offered = offer.head.map(|head| PieceId(head.id));
        let is_known = |known: &&KnownWorld| {
            known.id == offer.id && (known.head.is_none() || known.head == offered)
        };
        match self.world.as_ref().filter(is_known) {
            Some(known) => self.enter(offer.number, known.world.clone()),
            None => self.stage = Stage::Fetching,
        }
    }

    /// What is needed of the world that is offered.
    pub(crate) fn wanted(&self) -> Option<Wanted> {
        let offer = self.offer.filter(|_| self.stage == Stage::Fetching)?;
        let head = offer.head.filter(|_| !self.needs_files);
        Some(head.map_or(Wanted::File(offer.id), |head| Wanted::Head(PieceId(head.id))))
    }

    /// Takes in what was wanted. Other bytes are ignored.
    pub(crate) fn give(&mut self, bytes: &[u8]) {
        match self.wanted() {
            Some(Wanted::File(id)) => self.give_file(id, bytes),
            Some(Wanted::Head(id)) => self.give_head(id, bytes),
            None => {}
        }
    }

    fn give_file(&mut self, wanted: ContentId, bytes: &[u8]) {
        let read = match content_id(bytes) {
            Ok(id) if id == wanted => World::from_bytes(bytes).map_err(|error| error.to_string()),
            Ok(_) => return,
            Err(error) => Err(error.to_string()),
        };
        match read {
            Ok(world) => self.take_world(None, Arc::new(world)),
            Err(error) => self.refuse_world(&error),
        }
    }

    fn give_head(&mut self, wanted: PieceId, bytes: &[u8]) {
        if PieceId::of(bytes) != wanted {
            return;
        }
        match WorldHead::read(bytes) {
            Ok(head) => {
                let world = head.world.clone();
                self.head = Some(head);
                self.take_world(Some(wanted), world);
            }
            // The file may be a better one.
            Err(_) => self.needs_files = true,
        }
    }

    fn take_world(&mut self, head: Option<PieceId>, world: Arc<World>) {
        if let Some(offer) = self.offer {
            self.world = Some(KnownWorld { id: offer.id, head, world: world.clone() });
            self.enter(offer.number, world);
        }
    }

    /// Ends, because the world cannot be used.
    pub(crate) fn refuse_world(&mut self, why: &str) {
        let reason = format!("cannot use the server's world: {why}");
        let (may_pass, retry) = (false, Duration::ZERO);
        self.stage = Stage::Over(Ending { reason, may_pass, retry, is_version: false });
    }

    /// The world that the client is in, with what is here of it. To be called once for each.
    pub(crate) fn building(&mut self) -> Option<ArrivingWorld> {
        let world = self.world()?;
        let head = self.head.take_if(|head| Arc::ptr_eq(&head.world, &world));
        Some(head.map_or_else(|| ArrivingWorld::whole(world), ArrivingWorld::from_head))
    }

    /// The content id of the head of the world that is here, where it comes in pieces.
    pub(crate) fn head_id(&self) -> Option<PieceId> {
        self.world.as_ref().and_then(|known| known.head)
    }

    /// Asks to enter a world that is here: for the first time, on another connection, or in place
    /// of the one before.
    fn enter(&mut self, number: u32, world: Arc<World>) {
        let Some((avatar, interval)) = self.welcomed else { return };
        let enters = match &mut self.presence {
            Some(presence) if self.is_presence_new => presence.leave_world(number, world),
            Some(presence) => presence.reconnect(avatar, interval, number, world),
            None => {
                let name = self.hello.name.clone();
                self.presence = Some(Presence::new(avatar, interval, world, name));
                ClientMessage::Enter { world: number, place: None, reports_from: 0 }
            }
        };
        self.is_presence_new = true;
        self.stage = Stage::Entering;
        self.send(&enters);
    }

    /// Takes in a datagram. One that makes no sense is ignored, as if it had been lost.
    pub(crate) fn datagram(&mut self, now: Duration, bytes: &[u8]) {
        if self.is_presence_new
            && let Some(presence) = &mut self.presence
        {
            let _ = presence.replica.datagram(now, bytes);
        }
    }

    /// What the client sends by itself.
    pub(crate) fn tick(&mut self, now: Duration) {
        let round_trip = self.round_trip;
        let Some(presence) = self.presence.as_mut().filter(|_| self.stage == Stage::In) else {
            return;
        };
        match presence.tick(now, round_trip, 0) {
            None => {}
            Some(Outgoing::Message(message)) => self.send(&message),
            Some(Outgoing::Datagram(bytes)) => {
                if self.datagrams.len() >= DATAGRAMS_MAX {
                    self.datagrams.pop_front();
                }
                self.datagrams.push_back(bytes);
            }
        }
    }

    pub(crate) fn set_pose(&mut self, now: Duration, pose: Pose) {
        if let Some(presence) = &mut self.presence
            && *presence.link() == Link::Present
        {
            presence.set_pose(now, pose);
        }
    }

    /// Says something to those in sight.
    ///
    /// # Errors
    /// Why it cannot be said, in words.
    pub(crate) fn say(&mut self, text: &str) -> Result<(), String> {
        let text = ChatLine::new(text).map_err(|error| error.to_string())?;
        if !self.is_in() {
            return Err("there is no connection".to_owned());
        }
        self.send(&ClientMessage::Chat { text });
        Ok(())
    }

    /// Asks to be put back to a spawn point.
    pub(crate) fn respawn(&mut self) {
        if self.is_in() {
            self.send(&ClientMessage::Respawn);
        }
    }

    /// Says goodbye, where the server knows this client.
    pub(crate) fn leave(&mut self) {
        if self.welcomed.is_some() {
            self.send(&ClientMessage::Goodbye);
        }
    }

    fn send(&mut self, message: &ClientMessage) {
        self.control.extend_from_slice(&frame::encode(message));
    }

    pub(crate) fn take_control(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.control)
    }

    pub(crate) fn take_datagram(&mut self) -> Option<Vec<u8>> {
        self.datagrams.pop_front()
    }
}

#[cfg(test)]
mod tests;
