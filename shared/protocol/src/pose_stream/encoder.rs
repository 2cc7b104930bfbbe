//! The server's end of a pose stream.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use sightline_world::motion::{AvatarId, Pose};

use super::{
    Ack, BASELINE_DISTANCE_MAX, DATAGRAM_BYTES_MAX, ENTRIES_MAX,
    entry::{self, BASELINE},
};
use crate::{quantise::WirePose, varint};

/// The number of ticks after which a course is sent again at the latest unless it was acknowledged.
/// It exceeds the time for which clients put acknowledgements off, and a long round trip.
pub const RESEND_TICKS: u32 = 12;
/// The number of ticks after which a course is sent again at the earliest.
pub(super) const RESEND_TICKS_MIN: u32 = 3;
/// The number of ticks after which an open course goes with a datagram that is sent anyway.
const REPEAT_TICKS: u32 = 8;
/// How long a client's acknowledgements take is known from this number of the last ones.
const ACKS_KEPT: usize = 16;
/// Where datagrams may be lost, each course is sent a second time after this number of ticks, so
/// that the loss of one datagram shows for no longer.
const COPY_TICKS: u32 = 2;
/// The number of datagrams by which a client that has entered learns the server's clock.
const CLOCK_COPIES: u32 = 2;
/// Once this number of datagrams was acknowledged since the last loss, no loss is expected, and no
/// second copies are sent.
const CLEAN_DATAGRAMS: u32 = 128;
/// The greatest number of unacknowledged poses that are remembered: 28 bytes each, 112 KiB in all.
const SENT_POSES_MAX: usize = 4_096;

/// The server's end of one client's pose stream: it encodes poses into datagrams.
#[derive(Clone, Debug)]
pub struct PoseEncoder {
    /// The time from tick to tick.
    interval: Duration,
    /// The number of the newest datagram; 0 before the first.
    sequence: u32,
    datagram_bytes_max: usize,
    /// What was sent about each avatar. The caller bounds it by [`PoseEncoder::forget`].
    pub(super) avatars: BTreeMap<AvatarId, AvatarRecord>,
    /// The datagrams that are not acknowledged, oldest first: at most [`BASELINE_DISTANCE_MAX`],
    /// with at most [`SENT_POSES_MAX`] poses.
    pub(super) sent: VecDeque<SentDatagram>,
    pub(super) sent_poses: usize,
    /// The tick of the last call of [`PoseEncoder::encode`].
    tick: u32,
    /// How many datagrams were acknowledged since one was lost.
    acknowledged_in_a_row: u32,
    /// How many ticks each of the last acknowledgements took, oldest first: at most [`ACKS_KEPT`].
    ack_ticks: VecDeque<u32>,
    /// How many more datagrams the client must get, even without poses, to know the server's clock.
    clock_copies: u32,
    /// The tick of the last datagram that was sent.
    datagram_tick: u32,
}

/// Where a course that the client knows leads by the tick of an entry, which is coded against it.
#[derive(Clone, Copy, Debug, Default)]
struct Baseline {
    /// How many datagrams back the pose was sent; 0 stands for the default pose.
    distance: u32,
    pose: WirePose,
}

/// What was sent about an avatar.
#[derive(Clone, Copy, Debug)]
pub(super) struct AvatarRecord {
    /// The newest pose that was sent: the avatar's course begins with it.
    course: WirePose,
    /// The tick of that pose.
    course_tick: u32,
    /// The first datagram with that course. Later datagrams have it too.
    course_sequence: u32,
    /// The tick at which the course was last sent.
    sent_tick: u32,
    /// How often the course was sent and not lost, as far as is known.
    copies: u32,
    /// The newest pose that the client acknowledged, and its datagram.
    acknowledged: Option<Acknowledged>,
}

/// A pose that the client acknowledged.
#[derive(Clone, Copy, Debug)]
struct Acknowledged {
    /// Its datagram.
    sequence: u32,
    /// Its tick.
    tick: u32,
    pose: WirePose,
}

/// A datagram that is not acknowledged.
#[derive(Clone, Debug)]
pub(super) struct SentDatagram {
    sequence: u32,
    tick: u32,
    /// The poses in it, in ascending order of id.
    pub(super) poses: Vec<(AvatarId, WirePose)>,
    /// Whether the client has acknowledged a later datagram and not this one.
    is_missing: bool,
}

impl PoseEncoder {
    /// An encoder for a server with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        Self {
            interval,
            sequence: 0,
            datagram_bytes_max: DATAGRAM_BYTES_MAX,
            avatars: BTreeMap::new(),
            sent: VecDeque::new(),
            sent_poses: 0,
            tick: 0,
            acknowledged_in_a_row: 0,
            ack_ticks: VecDeque::new(),
            clock_copies: 0,
            datagram_tick: 0,
        }
    }

    /// Limits the length of later datagrams to what the network path allows, in bytes. The limit is
    /// clamped to 128 at least and [`DATAGRAM_BYTES_MAX`] at most.
    pub fn set_datagram_bytes_max(&mut self, bytes_max: usize) {
        self.datagram_bytes_max = bytes_max.clamp(128, DATAGRAM_BYTES_MAX);
    }

    /// The sequence number of the next datagram.
    pub fn next_sequence(&self) -> u32 {
        self.sequence.saturating_add(1)
    }

    /// Makes sure that the client gets datagrams before long, even if there are no poses. It tells
    /// the server's clock by what arrives soonest, and what was on the stream may have been lost and
    /// sent again.
    pub fn tell_clock(&mut self) {
        self.clock_copies = CLOCK_COPIES;
    }

    /// Whether something that was sent may have to be sent again: a course that the client has not
    /// acknowledged, or the clock. Call it at every tick.
    pub fn has_open(&mut self, tick: u32) -> bool {
        self.tick = tick;
        self.clock_copies > 0 || self.avatars.values().any(|record| !record.is_settled())
    }

    /// Encodes the poses at a tick of avatars with a new course, and again those of courses that the
    /// client has not acknowledged in time. Call it at every tick with poses, or at which something
    /// [is open](PoseEncoder::has_open). The poses are in ascending order of id. Each datagram has at
    /// most [`DATAGRAM_BYTES_MAX`] bytes.
    pub fn encode(&mut self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<Vec<u8>> {
        debug_assert!(poses.is_sorted_by(|(a, _), (b, _)| a < b), "poses in ascending order");
        self.tick = tick;
        let mut writer = DatagramWriter::default();
        let mut datagrams = Vec::new();
        for Due { avatar, pose, is_new } in self.due(tick, poses) {
            let sequence = self.next_sequence();
            let mut base = self.baseline(avatar, sequence);
            let mut entry = writer.entry(avatar, base, &pose);
            if writer.is_full(entry.len(), self.datagram_bytes_max) {
                datagrams.push(self.close(&mut writer));
                base = self.baseline(avatar, sequence.saturating_add(1));
                entry = writer.entry(avatar, base, &pose);
            }
            if writer.poses.is_empty() {
                writer.open(self.next_sequence(), tick);
            }
            writer.push(avatar, base, pose, &entry);
            self.note(avatar, pose, tick, is_new);
        }
        let tells_clock =
            self.clock_copies > 0 && tick.saturating_sub(self.datagram_tick) >= COPY_TICKS;
        if datagrams.is_empty() && writer.poses.is_empty() && tells_clock {
            writer.open(self.next_sequence(), tick);
        }
        if !writer.bytes.is_empty() {
            datagrams.push(self.close(&mut writer));
        }
        if !datagrams.is_empty() {
            self.clock_copies = self.clock_copies.saturating_sub(1);
            self.datagram_tick = tick;
        }
        datagrams
    }

    /// Stops sending about an avatar that vanished.
    pub fn forget(&mut self, avatar: AvatarId) {
        self.avatars.remove(&avatar);
    }

    /// Stops sending about all avatars. Later datagrams count on.
    pub fn forget_all(&mut self) {
        self.avatars.clear();
    }

    /// Processes an acknowledgement of the client. One of a datagram that was never sent is
    /// ignored.
    pub fn acknowledge(&mut self, ack: Ack) {
        if ack.newest > self.sequence {
            return;
        }
        let Self { avatars, acknowledged_in_a_row, .. } = self;
        let (mut poses_left, mut first_tick) = (0, None);
        self.sent.retain_mut(|sent| {
            if !ack.covers(sent.sequence) {
                poses_left += sent.poses.len();
                if sent.sequence < ack.newest && !std::mem::replace(&mut sent.is_missing, true) {
                    // A later datagram has arrived, so this one is lost or late.
                    *acknowledged_in_a_row = 0;
                    for (avatar, _) in &sent.poses {
                        avatars.entry(*avatar).and_modify(|record| record.lose(sent.sequence));
                    }
                }
                return true;
            }
            *acknowledged_in_a_row = acknowledged_in_a_row.saturating_add(1);
            first_tick.get_or_insert(sent.tick);
            for (avatar, pose) in &sent.poses {
                if let Some(record) = avatars.get_mut(avatar)
                    && record.acknowledged.is_none_or(|known| known.sequence < sent.sequence)
                {
                    let SentDatagram { sequence, tick, .. } = *sent;
                    record.acknowledged = Some(Acknowledged { sequence, tick, pose: *pose });
                }
            }
            false
        });
        self.sent_poses = poses_left;
        if let Some(first_tick) = first_tick {
            self.ack_ticks.push_back(self.tick.saturating_sub(first_tick));
        }
        while self.ack_ticks.len() > ACKS_KEPT {
            self.ack_ticks.pop_front();
        }
    }

    /// The number of ticks after which a course should have been acknowledged. The slowest of the
    /// last acknowledgements does not count: the one before it may have been lost.
    fn resend_ticks(&self) -> u32 {
        if self.ack_ticks.len() < ACKS_KEPT {
            return RESEND_TICKS;
        }
        let mut ticks: Vec<u32> = self.ack_ticks.iter().copied().collect();
        ticks.sort_unstable();
        (ticks[ACKS_KEPT - 2] + 1).clamp(RESEND_TICKS_MIN, RESEND_TICKS)
    }

    /// The poses to send: those of new courses, and of courses that must be repeated, in ascending
    /// order of id.
    fn due(&self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<Due> {
        let on_course = |record: &AvatarRecord| record.pose_at(tick, self.interval);
        let is_new = |(avatar, pose): &(AvatarId, WirePose)| {
            self.avatars.get(avatar).is_none_or(|record| on_course(record) != *pose)
        };
        let poses = poses.iter().map(|(avatar, pose)| (*avatar, pose.into()));
        let new: BTreeMap<AvatarId, WirePose> = poses.filter(is_new).collect();
        let open = self.avatars.iter().filter(|(id, r)| !r.is_settled() && !new.contains_key(id));
        let open: Vec<(&AvatarId, &AvatarRecord)> = open.collect();
        let is_clean = self.acknowledged_in_a_row >= CLEAN_DATAGRAMS;
        let resend_ticks = self.resend_ticks();
        let must_repeat = |record: &AvatarRecord| {
            record.has_waited(tick, resend_ticks)
                || !is_clean && record.copies < 2 && record.has_waited(tick, COPY_TICKS)
        };
        let is_sent = !new.is_empty() || open.iter().any(|(_, record)| must_repeat(record));
        let mut due: Vec<Due> =
            new.iter().map(|(id, pose)| Due { avatar: *id, pose: *pose, is_new: true }).collect();
        let goes_along = |record: &AvatarRecord| {
            is_sent && (must_repeat(record) || record.has_waited(tick, REPEAT_TICKS))
        };
        let repeated = open.iter().filter(|(_, record)| goes_along(record));
        due.extend(repeated.map(|(id, r)| Due { avatar: **id, pose: on_course(r), is_new: false }));
        due.sort_unstable_by_key(|due| due.avatar);
        due
    }

    /// The baseline for an avatar in a datagram: where its newest acknowledged course, if it is
    /// recent enough, leads.
    fn baseline(&self, avatar: AvatarId, sequence: u32) -> Option<Baseline> {
        let known = self.avatars.get(&avatar)?.acknowledged?;
        let distance = sequence.saturating_sub(known.sequence);
        let pose = known.pose.straight_on(self.interval * self.tick.saturating_sub(known.tick));
        (distance <= BASELINE_DISTANCE_MAX).then_some(Baseline { distance, pose })
    }

    /// Records that a pose is sent.
    fn note(&mut self, avatar: AvatarId, pose: WirePose, tick: u32, is_new: bool) {
        let sequence = self.next_sequence();
        let before = self.avatars.get(&avatar);
        let acknowledged = before.and_then(|record| record.acknowledged);
        let record = match before {
            // An acknowledgement of any of the datagrams counts.
            Some(record) if !is_new => {
                AvatarRecord { sent_tick: tick, copies: record.copies + 1, ..*record }
            }
            _ => AvatarRecord {
                course: pose,
                course_tick: tick,
                course_sequence: sequence,
                sent_tick: tick,
                copies: 1,
                acknowledged,
            },
        };
        self.avatars.insert(avatar, record);
    }

    /// Ends a datagram and remembers its poses.
    fn close(&mut self, writer: &mut DatagramWriter) -> Vec<u8> {
        self.sequence = self.next_sequence();
        let DatagramWriter { bytes, poses, .. } = std::mem::take(writer);
        self.sent_poses += poses.len();
        self.sent.push_back(SentDatagram {
            sequence: self.sequence,
            tick: self.tick,
            poses,
            is_missing: false,
        });
        while self.sent.len() > BASELINE_DISTANCE_MAX as usize || self.sent_poses > SENT_POSES_MAX {
            let Some(oldest) = self.sent.pop_front() else { break };
            self.sent_poses -= oldest.poses.len();
        }
        debug_assert!(bytes.len() <= DATAGRAM_BYTES_MAX, "a datagram of {} bytes", bytes.len());
        bytes
    }
}

impl AvatarRecord {
    /// Where the avatar is at a tick, if it is on course.
    fn pose_at(&self, tick: u32, interval: Duration) -> WirePose {
        let elapsed = interval * tick.saturating_sub(self.course_tick);
        self.course.straight_on(elapsed)
    }

    /// Whether the client has acknowledged the course.
    fn is_settled(&self) -> bool {
        self.acknowledged.is_some_and(|known| known.sequence >= self.course_sequence)
    }

    /// Takes in that a datagram was lost. If it was the last one with the course, that is sent again
    /// at once.
    fn lose(&mut self, sequence: u32) {
        if sequence >= self.course_sequence && !self.is_settled() {
            self.copies = self.copies.saturating_sub(1);
            if self.copies == 0 {
                self.sent_tick = 0;
            }
        }
    }

    /// Whether at `tick` at least `ticks` ticks have passed since the course was last sent.
    fn has_waited(&self, tick: u32, ticks: u32) -> bool {
        tick.saturating_sub(self.sent_tick) >= ticks
    }
}

/// A pose that must be sent.
struct Due {
    avatar: AvatarId,
    pose: WirePose,
    /// Whether the avatar has a new course.
    is_new: bool,
}

/// A datagram that is being written.
#[derive(Default)]
struct DatagramWriter {
    bytes: Vec<u8>,
    poses: Vec<(AvatarId, WirePose)>,
    /// The baseline distance of the preceding entry; 0 without a baseline.
    distance: u32,
}

impl DatagramWriter {
    fn open(&mut self, sequence: u32, tick: u32) {
        varint::write(&mut self.bytes, sequence);
        varint::write(&mut self.bytes, tick);
    }

    fn entry(&self, avatar: AvatarId, base: Option<Baseline>, pose: &WirePose) -> Vec<u8> {
        let Baseline { distance, pose: base } = base.unwrap_or_default();
        let follows = distance != self.distance;
        let flags = entry::flags(&base, pose);
        let mut out = Vec::with_capacity(40);
        out.push(flags | if follows { BASELINE } else { 0 });
        debug_assert!(self.poses.last().is_none_or(|(preceding, _)| *preceding < avatar));
        let step = match self.poses.last() {
            Some((preceding, _)) => avatar.0 - preceding.0 - 1,
            None => avatar.0,
        };
        varint::write(&mut out, step);
        if follows {
            varint::write(&mut out, distance);
        }
        entry::write_fields(&mut out, flags, &base, pose);
        out
    }

    /// Whether another entry would exceed a limit.
    fn is_full(&self, entry_bytes: usize, bytes_max: usize) -> bool {
        !self.poses.is_empty()
            && (self.poses.len() >= ENTRIES_MAX || self.bytes.len() + entry_bytes > bytes_max)
    }

    fn push(&mut self, avatar: AvatarId, base: Option<Baseline>, pose: WirePose, entry: &[u8]) {
        self.bytes.extend_from_slice(entry);
        self.poses.push((avatar, pose));
        self.distance = base.map_or(0, |base| base.distance);
    }
}
