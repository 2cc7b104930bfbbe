//! The replica: what this client knows of the other avatars, and what the server expects of it.
//!
//! Feed a [`Replica`] each [`ServerMessage`] and each datagram, with the client's own time. Tell it
//! where its own avatar is. Ask it at each tick what to send, and at each frame whom to draw. It
//! has no socket and no clock.

mod avatar_source;
mod sending;
mod timeline;

use std::{collections::BTreeMap, time::Duration};

use sightline_protocol::{
    DecodeError,
    message::ServerMessage,
    pose_stream::PoseDecoder,
    quantise::{WirePose, WireReport},
};
use sightline_world::motion::{Agility, AvatarId, Pose, ReportingState, Tbv, Tolerance};

use self::{
    sending::OwnAvatar,
    timeline::{Clock, Timeline},
};
use crate::reporting::{ReportReason, Reporter, ReportingCounts};

pub use self::{
    avatar_source::{AvatarSource, Update},
    sending::Outgoing,
    timeline::BLEND,
};

/// A server that makes more avatars appear than this is not trusted. Each avatar takes about 400
/// bytes.
const AVATARS_MAX: usize = 16_384;

/// What one client knows of the other avatars.
#[derive(Clone, Debug)]
pub struct Replica {
    avatar: AvatarId,
    tick_interval: Duration,
    others: BTreeMap<AvatarId, Held>,
    /// The avatars with an update since the last call of [`AvatarSource::updates`].
    updates: BTreeMap<AvatarId, Update>,
    decoder: PoseDecoder,
    clock: Clock,
    reporter: Reporter,
    own: OwnAvatar,
}

/// Another avatar, as it is drawn now.
#[derive(Clone, Debug, PartialEq)]
pub struct ShownAvatar {
    /// The avatar.
    pub id: AvatarId,
    /// The name that its client chose.
    pub name: String,
    /// The colour that its client chose, in sRGB.
    pub colour: [u8; 3],
    /// The pose to draw, along the courses that arrived.
    pub pose: Pose,
}

/// Another avatar, as the newest message has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldAvatar {
    /// The avatar.
    pub id: AvatarId,
    /// Where the newest course that arrived begins.
    pub pose: Pose,
    /// How long ago that course arrived. The server repeats nothing of an avatar that stays on
    /// course.
    pub age: Duration,
    /// How old the certainty is that the avatar is on that course: nothing is missing of what the
    /// server had said up to then. While a datagram is missing, or the server says nothing at all,
    /// certainty ages.
    pub certainty: Duration,
}

/// What a message from the server means to the person at the client.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The own avatar is in the world, at this pose.
    Entered(Pose),
    /// An avatar may come into view.
    Appeared(AvatarId),
    /// An avatar cannot be seen any more, or has left.
    Vanished(AvatarId),
    /// An avatar said something.
    Chat {
        /// The avatar that spoke.
        from: AvatarId,
        /// The name of the avatar; empty when it is not known.
        name: String,
        /// What was said.
        text: String,
    },
    /// The server itself said something.
    Notice(String),
    /// A report was refused, and the own avatar is put back to this pose.
    Corrected(Pose),
    /// The server ends the connection, for this reason.
    Goodbye(String),
}

/// The server breaks the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplicaError {
    /// A message that is not sent to a client in the world, or that its session must handle.
    #[error("the server sent a message out of place")]
    OutOfPlace,
    /// More avatars than a client holds.
    #[error("the server makes too many avatars appear")]
    TooMany,
}

/// What is held of another avatar.
#[derive(Clone, Debug)]
struct Held {
    name: String,
    colour: [u8; 3],
    /// Datagrams with a lower number belong to an earlier appearance.
    since_sequence: u32,
    /// The number of the newest datagram with a pose of the avatar; zero before there is one.
    newest_sequence: u32,
    timeline: Timeline,
}

impl Replica {
    /// The replica of a client that was welcomed as `avatar`, with a body of this agility.
    pub fn new(avatar: AvatarId, tick_interval: Duration, agility: Agility) -> Self {
        Self {
            avatar,
            tick_interval,
            others: BTreeMap::new(),
            updates: BTreeMap::new(),
            decoder: PoseDecoder::new(tick_interval),
            clock: Clock::new(tick_interval),
            reporter: Reporter::new(tick_interval, agility),
            own: OwnAvatar::default(),
        }
    }

    /// Leaves the world for another one, where bodies have this agility. Nobody is in view and no
    /// order stands until the server gives a place there. The own pose stays. Returns the time from
    /// which reports are about the other world, as [`WireReport::made`] counts.
    pub fn leave_world(&mut self, agility: Agility) -> u32 {
        self.others.clear();
        self.updates.clear();
        self.own.forget_resend();
        self.reporter.leave(self.tick_interval, agility);
        WireReport::made_at(self.reporter.reports_from(), self.tick_interval)
    }

    /// Begins anew on another connection, as which the client was welcomed as `avatar`. As with
    /// [`Replica::leave_world`], the own pose and the client's own time stay.
    pub fn reconnect(
        &mut self,
        avatar: AvatarId,
        tick_interval: Duration,
        agility: Agility,
    ) -> u32 {
        let (mut reporter, pose) = (self.reporter.clone(), self.own.pose);
        reporter.leave(tick_interval, agility);
        *self = Self { reporter, ..Self::new(avatar, tick_interval, agility) };
        self.own.pose = pose;
        WireReport::made_at(self.reporter.reports_from(), tick_interval)
    }

    /// Takes in a message from the server.
    ///
    /// # Errors
    /// When the server breaks the protocol.
    pub fn message(
        &mut self,
        now: Duration,
        message: ServerMessage,
    ) -> Result<Option<Event>, ReplicaError> {
        let event = match message {
            ServerMessage::Welcome { .. }
            | ServerMessage::Loading { .. }
            | ServerMessage::World { .. }
            | ServerMessage::Stations { .. }
            | ServerMessage::Refused { .. } => return Err(ReplicaError::OutOfPlace),
            ServerMessage::Entered { pose, tick } => {
                self.clock.synchronise(tick, now);
                self.reporter.enter();
                self.own.pose = pose.into();
                Some(Event::Entered(self.own.pose))
            }
            ServerMessage::Appear { avatar, name, colour, pose, tick, since_sequence } => {
                if self.others.len() >= AVATARS_MAX {
                    return Err(ReplicaError::TooMany);
                }
                self.clock.synchronise(tick, now);
                let timeline = Timeline::new(self.tick_interval, tick, pose.into(), now);
                let name = name.into();
                let held = Held { name, colour, since_sequence, newest_sequence: 0, timeline };
                self.appear(now, avatar, held);
                Some(Event::Appeared(avatar))
            }
            ServerMessage::Vanish { avatar } => {
                self.updates.remove(&avatar);
                self.others.remove(&avatar).map(|_| Event::Vanished(avatar))
            }
            ServerMessage::Ask => {
                self.reporter.ask();
                None
            }
            ServerMessage::Quiet { tbv } => {
                self.reporter.expect_silence(tbv.at(now));
                None
            }
            ServerMessage::Live { tolerance } => {
                self.reporter.expect_reports(tolerance.into());
                None
            }
            ServerMessage::Correct { pose } => {
                self.own.pose = pose.into();
                self.forget_course();
                Some(Event::Corrected(self.own.pose))
            }
            ServerMessage::Chat { from, text } => {
                let name = self.others.get(&from).map_or_else(String::new, |o| o.name.clone());
                Some(Event::Chat { from, name, text: text.into() })
            }
            ServerMessage::Notice { text } => Some(Event::Notice(text.into())),
            ServerMessage::Goodbye { reason, .. } => Some(Event::Goodbye(reason.into())),
        };
        Ok(event)
    }

    /// Takes in a datagram from the server. Poses of avatars that have not appeared, or have
    /// vanished, are ignored.
    ///
    /// # Errors
    /// When the datagram is malformed. The replica is then as if the datagram had been lost.
    pub fn datagram(&mut self, now: Duration, bytes: &[u8]) -> Result<(), DecodeError> {
        let Some(update) = self.decoder.decode(bytes)? else { return Ok(()) };
        self.clock.synchronise(update.tick, now);
        let shown_tick = self.clock.shown_tick(now);
        for (avatar, pose) in &update.poses {
            if let Some(other) = self.others.get_mut(avatar) {
                let heard = Heard { now, shown_tick, sequence: update.sequence };
                other.take_in(heard, update.tick, *pose);
                self.updates.entry(*avatar).or_insert(Update::Moved);
            }
        }
        self.own.owe_ack(now, self.decoder.ack());
        Ok(())
    }

    /// Sets the pose of the own avatar. A pose that is not finite is ignored.
    pub fn set_pose(&mut self, pose: Pose) {
        if pose.is_finite() {
            self.own.pose = pose;
        }
    }

    /// The pose of the own avatar.
    pub fn pose(&self) -> Pose {
        self.own.pose
    }

    /// Why a report is due now; `None` when the client should be silent.
    pub fn report_due(&self, now: Duration) -> Option<ReportReason> {
        self.reporter.due(now, &self.own.pose)
    }

    /// What the server expects of this client; `None` before it is in the world.
    pub fn reporting_state(&self) -> Option<ReportingState> {
        self.reporter.state()
    }

    /// The region in which silence is expected.
    pub fn tbv(&self) -> Option<Tbv> {
        self.reporter.tbv()
    }

    /// What the client may leave unsaid; `None` while it is quiet.
    pub fn tolerance(&self) -> Option<Tolerance> {
        self.reporter.tolerance()
    }

    /// How many datagrams with poses have arrived, and how many the server has sent by then.
    pub fn delivered(&self) -> [u32; 2] {
        self.decoder.delivered()
    }

    /// For how many ticks the client was quiet, or on course.
    pub fn reporting_counts(&self) -> ReportingCounts {
        self.reporter.counts()
    }

    /// The time of the server's clock that is drawn now: movers are drawn where they are then.
    /// Until a datagram has told the server's time, this client's own time stands in.
    pub fn server_time(&self, now: Duration) -> Duration {
        let shown_s = self.clock.shown_time_s(now).map(|shown_s| shown_s.max(0.0));
        shown_s.and_then(|shown_s| Duration::try_from_secs_f64(shown_s).ok()).unwrap_or(now)
    }

    /// All avatars that may be in view, as they are drawn now, in ascending order.
    pub fn shown_avatars(&self, now: Duration) -> Vec<ShownAvatar> {
        let at = self.clock.shown_tick(now);
        let shown = |(id, other): (&AvatarId, &Held)| ShownAvatar {
            id: *id,
            name: other.name.clone(),
            colour: other.colour,
            pose: other.timeline.at(at),
        };
        self.others.iter().map(shown).collect()
    }

    /// All avatars that may be in view, as the newest messages have them, in ascending order.
    pub fn held(&self, now: Duration) -> impl Iterator<Item = HeldAvatar> + '_ {
        let arrived_tick = self.clock.arrived_tick(now);
        let complete_tick = self.decoder.complete_tick().unwrap_or(0);
        self.others.iter().map(move |(id, other)| {
            let (pose, heard_at) = other.timeline.newest();
            let certain_tick = complete_tick.max(other.timeline.newest_tick());
            let ticks = (arrived_tick - f64::from(certain_tick)).max(0.0);
            let certainty = self.tick_interval.mul_f64(ticks.min(1e6));
            HeldAvatar { id: *id, pose, age: now.saturating_sub(heard_at), certainty }
        })
    }

    /// Whether an avatar may be in view.
    pub fn holds(&self, avatar: AvatarId) -> bool {
        self.others.contains_key(&avatar)
    }

    /// The number of avatars that may be in view.
    pub fn held_len(&self) -> usize {
        self.others.len()
    }

    /// The time from one tick to the next.
    pub fn tick_interval(&self) -> Duration {
        self.tick_interval
    }

    /// The own avatar.
    pub fn avatar(&self) -> AvatarId {
        self.avatar
    }

    /// Takes in an avatar that appears.
    fn appear(&mut self, now: Duration, avatar: AvatarId, mut held: Held) {
        // A datagram may have overtaken this message. It will not come again.
        if let Some((sequence, tick, pose)) = self.decoder.newest(avatar, held.since_sequence) {
            let shown_tick = self.clock.shown_tick(now);
            held.take_in(Heard { now, shown_tick, sequence }, tick, pose);
        }
        self.others.insert(avatar, held);
        debug_assert!(self.others.len() <= AVATARS_MAX, "{} avatars", self.others.len());
        self.updates.insert(avatar, Update::Appeared);
    }
}

/// Which datagram arrived, when, and what was shown then.
#[derive(Clone, Copy)]
struct Heard {
    now: Duration,
    /// The moment that was shown, in ticks.
    shown_tick: f64,
    /// The number of the datagram.
    sequence: u32,
}

impl Held {
    /// Takes in the pose at a tick from a datagram, unless it is outdated.
    fn take_in(&mut self, heard: Heard, tick: u32, pose: WirePose) {
        let Heard { now, shown_tick, sequence } = heard;
        if sequence >= self.since_sequence && sequence > self.newest_sequence {
            self.newest_sequence = sequence;
            self.timeline.push(tick, pose.into(), now, shown_tick);
        }
    }
}

#[cfg(test)]
mod tests;
