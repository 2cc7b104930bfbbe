//! What was sent to a client about each avatar.

use std::time::Duration;

use sightline_world::motion::AvatarId;

use crate::quantise::WirePose;

/// A pose at a tick, from which an avatar goes on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Course {
    pub(super) tick: u32,
    pub(super) pose: WirePose,
}

impl Course {
    /// Where the course leads by a tick.
    pub(super) fn at(&self, tick: u32, interval: Duration) -> WirePose {
        self.pose.straight_on(interval * tick.saturating_sub(self.tick))
    }
}

/// What was sent about an avatar.
#[derive(Clone, Copy, Debug)]
pub(super) struct AvatarRecord {
    /// The newest course that was sent.
    pub(super) course: Course,
    /// The first datagram with that course. Later datagrams have it too.
    course_sequence: u32,
    /// The newest datagram with that course, and its tick.
    pub(super) sent_sequence: u32,
    pub(super) sent_tick: u32,
    /// How often the course was sent and not lost, as far as is known.
    pub(super) copies: u32,
    /// The newest course that the client acknowledged.
    pub(super) acknowledged: Option<Acknowledged>,
}

/// A course that the client acknowledged, and its datagram.
#[derive(Clone, Copy, Debug)]
pub(super) struct Acknowledged {
    pub(super) sequence: u32,
    pub(super) course: Course,
}

impl AvatarRecord {
    /// A record of a new course in a datagram.
    pub(super) fn new(course: Course, sequence: u32, acknowledged: Option<Acknowledged>) -> Self {
        Self {
            course,
            course_sequence: sequence,
            sent_sequence: sequence,
            sent_tick: course.tick,
            copies: 1,
            acknowledged,
        }
    }

    /// Takes in that the course goes with another datagram. An acknowledgement of any of them
    /// counts.
    pub(super) fn repeat(&mut self, tick: u32, sequence: u32) {
        (self.sent_tick, self.sent_sequence) = (tick, sequence);
        self.copies += 1;
    }

    /// Takes in that the client has received a datagram with a course.
    pub(super) fn acknowledge(&mut self, sequence: u32, course: Course) {
        if self.acknowledged.is_none_or(|known| known.sequence < sequence) {
            self.acknowledged = Some(Acknowledged { sequence, course });
        }
    }

    /// Whether the client has acknowledged the course.
    pub(super) fn is_settled(&self) -> bool {
        self.acknowledged.is_some_and(|known| known.sequence >= self.course_sequence)
    }

    /// Takes in that a datagram was lost. If it was the last one with the course, that is sent
    /// again at once.
    pub(super) fn lose(&mut self, sequence: u32) {
        if sequence >= self.course_sequence && !self.is_settled() {
            self.copies = self.copies.saturating_sub(1);
            if self.copies == 0 {
                self.sent_tick = 0;
            }
        }
    }

    /// Whether at `tick` at least `ticks` ticks have passed since the course was last sent.
    pub(super) fn has_waited(&self, tick: u32, ticks: u32) -> bool {
        tick.saturating_sub(self.sent_tick) >= ticks
    }
}

/// A datagram that is not acknowledged.
#[derive(Clone, Debug)]
pub(super) struct SentDatagram {
    pub(super) sequence: u32,
    pub(super) tick: u32,
    /// The poses in it, in ascending order of id.
    pub(super) poses: Vec<(AvatarId, WirePose)>,
    /// Whether the client has acknowledged a later datagram and not this one.
    pub(super) is_missing: bool,
    /// Whether nothing in it need be sent again: it is known, or has gone with a later datagram.
    pub(super) is_spent: bool,
}
