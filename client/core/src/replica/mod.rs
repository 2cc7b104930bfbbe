//! What this client knows of the others, and what the server expects of it. No socket, no clock.
//!
//! Feed a [`Replica`] each [`ServerMessage`] and each datagram with the client's own time, tell it
//! where its own avatar is, and ask it at each tick what to send and at each frame whom to draw.

mod avatar_source;
mod timeline;

use std::{collections::BTreeMap, time::Duration};

use sightline_protocol::{
    DecodeError,
    message::{ClientMessage, ServerMessage},
    pose_stream::{ClientDatagram, PoseDecoder},
    quantise::WirePose,
};
use sightline_world::motion::{Agility, AvatarId, Pose, ReportingState, Tbv};

use self::timeline::{Clock, Timeline};
use crate::reporting::{ReportReason, Reporter};

pub use self::avatar_source::{AvatarSource, Update};

/// A server that makes more avatars appear than this is not to be trusted. Each costs about 400
/// bytes.
const AVATARS_MAX: usize = 16_384;

/// What one client knows.
#[derive(Clone, Debug)]
pub struct Replica {
    avatar: AvatarId,
    tick_interval: Duration,
    others: BTreeMap<AvatarId, Other>,
    /// Of them, those that [`AvatarSource::updates`] has not told of.
    news: BTreeMap<AvatarId, Update>,
    decoder: PoseDecoder,
    clock: Clock,
    reporter: Reporter,
    own: Own,
}

/// Another avatar, as it is to be drawn now.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleAvatar {
    /// Who.
    pub id: AvatarId,
    /// How it is called.
    pub name: String,
    /// sRGB.
    pub colour: [u8; 3],
    /// Where, between what was told.
    pub pose: Pose,
}

/// Another avatar, as it was last told of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldAvatar {
    /// Who.
    pub id: AvatarId,
    /// The newest pose that arrived.
    pub pose: Pose,
    /// How long ago it arrived. An avatar that stands still is not told of again.
    pub age: Duration,
}

/// What somebody should know.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// You are in the world, here.
    Entered(Pose),
    /// Somebody may come into view.
    Appeared(AvatarId),
    /// Somebody cannot be seen any more, or has left.
    Vanished(AvatarId),
    /// Somebody said something.
    Chat {
        /// Who.
        from: AvatarId,
        /// How it is called, as far as is known.
        name: String,
        /// What.
        text: String,
    },
    /// A report was refused: you are here.
    Corrected(Pose),
    /// The server ends the connection, and why.
    Goodbye(String),
}

/// What to send.
#[derive(Clone, Debug, PartialEq)]
pub enum Outgoing {
    /// As a datagram.
    Datagram(Vec<u8>),
    /// On the stream.
    Message(ClientMessage),
}

/// The server does what no server does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplicaError {
    /// A message that has no place here.
    #[error("the server sent a message out of place")]
    OutOfPlace,
    /// More avatars than there can be.
    #[error("the server tells of too many avatars")]
    TooMany,
}

#[derive(Clone, Debug)]
struct Other {
    name: String,
    colour: [u8; 3],
    since_sequence: u32,
    newest_sequence: u32,
    timeline: Timeline,
}

#[derive(Clone, Debug, Default)]
struct Own {
    pose: Pose,
    /// Of the newest report.
    sequence: u32,
    owes_ack: bool,
}

impl Replica {
    /// A client that was welcomed as an avatar, whose body can do so much.
    pub fn new(avatar: AvatarId, tick_interval: Duration, agility: Agility) -> Self {
        Self {
            avatar,
            tick_interval,
            others: BTreeMap::new(),
            news: BTreeMap::new(),
            decoder: PoseDecoder::default(),
            clock: Clock::new(tick_interval),
            reporter: Reporter::new(tick_interval, agility),
            own: Own::default(),
        }
    }

    /// Takes in a message.
    pub fn message(
        &mut self,
        now: Duration,
        message: ServerMessage,
    ) -> Result<Option<Event>, ReplicaError> {
        let event = match message {
            ServerMessage::Welcome { .. } | ServerMessage::Refused { .. } => {
                return Err(ReplicaError::OutOfPlace);
            }
            ServerMessage::Entered { pose } => {
                self.reporter.enter();
                self.own.pose = pose.into();
                Some(Event::Entered(self.own.pose))
            }
            ServerMessage::Appear { avatar, name, colour, pose, since_sequence } => {
                if self.others.len() >= AVATARS_MAX {
                    return Err(ReplicaError::TooMany);
                }
                self.appear(now, avatar, (name.into(), colour), pose, since_sequence);
                Some(Event::Appeared(avatar))
            }
            ServerMessage::Vanish { avatar } => {
                self.news.remove(&avatar);
                self.others.remove(&avatar).map(|_| Event::Vanished(avatar))
            }
            ServerMessage::Ask => {
                self.reporter.ask();
                None
            }
            ServerMessage::Quiet { tbv } => {
                self.reporter.expect_silence(tbv.at(now), now);
                None
            }
            ServerMessage::Live => {
                self.reporter.expect_reports(now);
                None
            }
            ServerMessage::Correct { pose } => {
                self.own.pose = pose.into();
                Some(Event::Corrected(self.own.pose))
            }
            ServerMessage::Chat { from, text } => {
                let name = self.others.get(&from).map_or_else(String::new, |o| o.name.clone());
                Some(Event::Chat { from, name, text: text.into() })
            }
            ServerMessage::Goodbye { reason } => Some(Event::Goodbye(reason.into())),
        };
        Ok(event)
    }

    /// Takes in a datagram. Poses of avatars that have not appeared, or have vanished, are of no
    /// interest; after an error all is as if the datagram had been lost.
    pub fn datagram(&mut self, now: Duration, bytes: &[u8]) -> Result<(), DecodeError> {
        let Some(update) = self.decoder.decode(bytes)? else { return Ok(()) };
        self.own.owes_ack = true;
        self.clock.heard(update.tick, now);
        for (avatar, pose) in &update.poses {
            if let Some(other) = self.others.get_mut(avatar) {
                other.hear(now, update.sequence, update.tick, *pose);
                self.news.entry(*avatar).or_insert(Update::Moved);
            }
        }
        Ok(())
    }

    /// Tells where the own avatar is. What is not finite is ignored.
    pub fn set_pose(&mut self, pose: Pose) {
        if pose.is_finite() {
            self.own.pose = pose;
        }
    }

    /// Where the own avatar is.
    pub fn pose(&self) -> Pose {
        self.own.pose
    }

    /// The answer to an ask, if one was asked. To be sent at once.
    pub fn answer(&mut self) -> Option<ClientMessage> {
        self.reporter.take_ask().then(|| self.report())
    }

    /// What to send at a tick. While quiet that is nothing, unless the avatar has left its TBV, or
    /// could have before long.
    pub fn tick(&mut self, round_trip: Duration) -> Option<Outgoing> {
        if !self.reporter.is_inside() {
            return None;
        }
        match self.reporter.tick(&self.own.pose, round_trip) {
            Some(ReportReason::Live) => {
                self.own.sequence += 1;
                let report = Some((self.own.sequence, WirePose::from(&self.own.pose)));
                Some(self.datagram_with(report))
            }
            Some(ReportReason::Asked | ReportReason::Leaving) => {
                Some(Outgoing::Message(self.report()))
            }
            None => self.own.owes_ack.then(|| self.datagram_with(None)),
        }
    }

    /// What the server expects of this client; `None` before it is in the world.
    pub fn reporting_state(&self) -> Option<ReportingState> {
        self.reporter.state()
    }

    /// The region in which silence is expected.
    pub fn tbv(&self) -> Option<Tbv> {
        self.reporter.tbv()
    }

    /// For how long silence was expected, up to now.
    pub fn quiet_time(&self, now: Duration) -> Duration {
        self.reporter.quiet_time(now)
    }

    /// What the server's clock says of the moment that is to be drawn now: movers are where they are
    /// then. Until a message tells the server's time, that of this client stands for it.
    pub fn server_time(&self, now: Duration) -> Duration {
        let shown_s = self.clock.shown_time_s(now).map(|shown_s| shown_s.max(0.0));
        shown_s.and_then(|shown_s| Duration::try_from_secs_f64(shown_s).ok()).unwrap_or(now)
    }

    /// Everybody that may be in view, where it is to be drawn now; ascending.
    pub fn visible(&self, now: Duration) -> Vec<VisibleAvatar> {
        let at = self.clock.shown_tick(now);
        let visible = |(id, other): (&AvatarId, &Other)| VisibleAvatar {
            id: *id,
            name: other.name.clone(),
            colour: other.colour,
            pose: other.timeline.at(at, self.tick_interval),
        };
        self.others.iter().map(visible).collect()
    }

    /// Everybody that may be in view, as last told of; ascending.
    pub fn held(&self, now: Duration) -> impl Iterator<Item = HeldAvatar> + '_ {
        self.others.iter().map(move |(id, other)| {
            let (pose, heard_at) = other.timeline.newest();
            HeldAvatar { id: *id, pose, age: now.saturating_sub(heard_at) }
        })
    }

    /// How many may be in view.
    pub fn held_len(&self) -> usize {
        self.others.len()
    }

    /// From tick to tick.
    pub fn tick_interval(&self) -> Duration {
        self.tick_interval
    }

    /// Who the own avatar is.
    pub fn avatar(&self) -> AvatarId {
        self.avatar
    }

    fn appear(
        &mut self,
        now: Duration,
        avatar: AvatarId,
        (name, colour): (String, [u8; 3]),
        pose: WirePose,
        since_sequence: u32,
    ) {
        let timeline = Timeline::new(self.clock.newest_tick(), pose.into(), now);
        let mut other = Other { name, colour, since_sequence, newest_sequence: 0, timeline };
        // A datagram may have overtaken this message; it will not come again.
        if let Some((sequence, tick, pose)) = self.decoder.newest(avatar, since_sequence) {
            other.hear(now, sequence, tick, pose);
        }
        self.others.insert(avatar, other);
        self.news.insert(avatar, Update::Appeared);
    }

    fn report(&mut self) -> ClientMessage {
        self.own.sequence += 1;
        let pose = WirePose::from(&self.own.pose);
        ClientMessage::Report { sequence: self.own.sequence, pose }
    }

    fn datagram_with(&mut self, report: Option<(u32, WirePose)>) -> Outgoing {
        self.own.owes_ack = false;
        Outgoing::Datagram(ClientDatagram { ack: self.decoder.ack(), report }.encode())
    }
}

impl Other {
    fn hear(&mut self, now: Duration, sequence: u32, tick: u32, pose: WirePose) {
        if sequence >= self.since_sequence && sequence > self.newest_sequence {
            self.newest_sequence = sequence;
            self.timeline.push(tick, pose.into(), now);
        }
    }
}

#[cfg(test)]
mod tests;
