//! The server's end of a pose stream.

use std::{
    collections::{VecDeque, hash_map::Entry},
    time::Duration,
};

use glam::Vec3;
use rustc_hash::FxHashMap;
use sightline_world::motion::{AvatarId, Pose};

use super::{
    Ack, BASELINE_DISTANCE_MAX, DATAGRAM_BYTES_MAX,
    courses::{AvatarRecord, Course, SentDatagram},
    draft::{Baseline, Draft},
    priority::{Rank, Turn, Waiting, weigh},
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
/// With more courses than this that wait, only this many, the first of each turn, are looked at
/// closely: no datagram holds more.
const CANDIDATES_MAX: usize = 160;
/// What an entry of a datagram takes, in bytes, for a guess at whether all fit.
const ENTRY_BYTES: usize = 9;
/// Where more wait, what each gathers is found anew after this number of ticks.
const REWEIGH_TICKS: u32 = 4;

/// The server's end of one client's pose stream: it encodes poses into datagrams.
///
/// Courses wait here until [`PoseEncoder::encode`]. A newer course of an avatar takes the place of
/// the one that waits, so at most one waits for each avatar that the client holds.
#[derive(Clone, Debug)]
pub struct PoseEncoder {
    /// The time from tick to tick.
    interval: Duration,
    /// The number of the newest datagram; 0 before the first.
    sequence: u32,
    datagram_bytes_max: usize,
    /// Where the viewer's eye is.
    from: Vec3,
    /// The courses that wait, in ascending order of id.
    pub(super) waiting: Vec<Waiting>,
    /// What was sent about each avatar. The caller bounds it by [`PoseEncoder::forget`].
    pub(super) avatars: FxHashMap<AvatarId, AvatarRecord>,
    /// The datagrams that are not acknowledged, oldest first: at most [`BASELINE_DISTANCE_MAX`],
    /// with at most [`SENT_POSES_MAX`] poses.
    pub(super) sent: VecDeque<SentDatagram>,
    pub(super) sent_poses: usize,
    /// Avatars whose course is not acknowledged, and whose last datagram is not remembered any
    /// more.
    forgotten: Vec<AvatarId>,
    /// The tick of the last call.
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

/// A course that may go with the next datagram.
struct Due {
    avatar: AvatarId,
    pose: WirePose,
    rank: Rank,
    /// Whether it has waited, and is not the last one again.
    is_new: bool,
}

impl PoseEncoder {
    /// An encoder for a server with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        Self {
            interval,
            sequence: 0,
            datagram_bytes_max: DATAGRAM_BYTES_MAX,
            from: Vec3::ZERO,
            waiting: Vec::new(),
            avatars: FxHashMap::default(),
            sent: VecDeque::new(),
            sent_poses: 0,
            forgotten: Vec::new(),
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
    /// the server's clock by what arrives soonest, and what was on the stream may have been lost
    /// and sent again.
    pub fn tell_clock(&mut self) {
        self.clock_copies = CLOCK_COPIES;
    }

    /// Takes in the poses at a tick of avatars with a new course, in ascending order of id, and
    /// where the viewer's eye is. They wait for the next datagrams.
    pub fn tell(&mut self, tick: u32, from: Vec3, poses: &[(AvatarId, Pose)]) {
        debug_assert!(poses.is_sorted_by(|(a, _), (b, _)| a < b), "poses in ascending order");
        self.from = from;
        let mut before = std::mem::take(&mut self.waiting).into_iter().peekable();
        self.waiting.reserve(before.len() + poses.len());
        for (avatar, pose) in poses {
            let course = Course { tick, pose: pose.into() };
            while let Some(other) = before.next_if(|waiting| waiting.avatar < *avatar) {
                self.waiting.push(other);
            }
            let known = before.next_if(|waiting| waiting.avatar == *avatar);
            self.waiting.push(match known {
                Some(waiting) => Waiting { course, ..waiting },
                None => {
                    let sent = self.avatars.get(avatar).map(|record| record.course);
                    Waiting::new(*avatar, course, sent)
                }
            });
        }
        self.waiting.extend(before);
    }

    /// Of how many avatars a course was sent.
    pub fn told_len(&self) -> usize {
        self.avatars.len()
    }

    /// How many courses wait to be sent for the first time.
    pub fn waiting_len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether there may be something to send: courses that wait, a course that may have been lost,
    /// or the clock. Call it at every tick.
    pub fn has_due(&mut self, tick: u32) -> bool {
        self.tick = tick;
        let after = self.resend_ticks().min(self.copy_ticks());
        let is_due = |sent: &SentDatagram| {
            !sent.is_spent && (sent.is_missing || sent.tick.saturating_add(after) <= tick)
        };
        self.clock_copies > 0
            || !self.waiting.is_empty()
            || !self.forgotten.is_empty()
            || self.sent.iter().any(is_due)
    }

    /// Encodes a datagram at a tick, with the courses that wait and those that the client has not
    /// acknowledged in time: all, or those that matter most to the viewer. The others wait on.
    /// `None` when there is nothing to send. Call it at every tick at which something [is
    /// due](PoseEncoder::has_due). A datagram has at most [`DATAGRAM_BYTES_MAX`] bytes.
    pub fn encode(&mut self, tick: u32) -> Option<Vec<u8>> {
        self.tick = tick;
        let due = self.due();
        let tells_clock =
            self.clock_copies > 0 && tick.saturating_sub(self.datagram_tick) >= COPY_TICKS;
        if due.is_empty() && !tells_clock {
            return None;
        }
        let sequence = self.next_sequence();
        let mut bytes = Vec::with_capacity(self.datagram_bytes_max.min(16 + 16 * due.len()));
        varint::write(&mut bytes, sequence);
        varint::write(&mut bytes, tick);
        let room = self.datagram_bytes_max.saturating_sub(bytes.len());
        let (draft, chosen) = self.choose(due, room);
        draft.write(&mut bytes);
        for due in &chosen {
            self.note(due, sequence);
        }
        self.remember(draft.poses());
        self.clock_copies = self.clock_copies.saturating_sub(1);
        self.datagram_tick = tick;
        debug_assert!(bytes.len() <= DATAGRAM_BYTES_MAX, "a datagram of {} bytes", bytes.len());
        Some(bytes)
    }

    /// Stops sending about an avatar that vanished.
    pub fn forget(&mut self, avatar: AvatarId) {
        self.waiting.retain(|waiting| waiting.avatar != avatar);
        self.avatars.remove(&avatar);
    }

    /// Stops sending about all avatars. Later datagrams count on.
    pub fn forget_all(&mut self) {
        self.waiting.clear();
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
                let course = Course { tick: sent.tick, pose: *pose };
                avatars.entry(*avatar).and_modify(|r| r.acknowledge(sent.sequence, course));
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
        // The second greatest of a few numbers.
        let mut most = [0, 0];
        for ticks in &self.ack_ticks {
            if *ticks > most[0] {
                most = [*ticks, most[0]];
            } else {
                most[1] = most[1].max(*ticks);
            }
        }
        (most[1] + 1).clamp(RESEND_TICKS_MIN, RESEND_TICKS)
    }

    /// The number of ticks after which a course is sent a second time, whatever becomes of the
    /// first.
    fn copy_ticks(&self) -> u32 {
        let is_clean = self.acknowledged_in_a_row >= CLEAN_DATAGRAMS;
        if is_clean { u32::MAX } else { COPY_TICKS }
    }

    /// Lets the courses that wait gather priority for a tick.
    fn gather(&mut self) {
        let Self { tick, interval, from, ref mut waiting, .. } = *self;
        for waiting in waiting {
            if waiting.weighed.is_none_or(|weighed| weighed.saturating_add(REWEIGH_TICKS) <= tick) {
                let shown = waiting.sent.map(|sent| sent.at(tick, interval));
                let times = [interval * tick.saturating_sub(waiting.since), interval];
                let pose = waiting.course.at(tick, interval);
                (waiting.weight, waiting.is_near) = weigh(from, shown.as_ref(), &pose, times);
                waiting.weighed = Some(tick);
            }
            waiting.priority += waiting.weight;
        }
    }

    fn rank(&self, waiting: &Waiting) -> Rank {
        let waited = self.interval * self.tick.saturating_sub(waiting.since);
        Rank { turn: Turn::of_new(waited, waiting.is_near), priority: waiting.priority }
    }

    /// The courses that wait and may go with a datagram, by position in ascending order: all, or in
    /// a crowd the first ones of each turn.
    fn candidates(&self) -> Vec<u32> {
        let all = 0..self.waiting.len() as u32;
        if self.waiting.len() <= CANDIDATES_MAX {
            return all.collect();
        }
        let mut turns: [Vec<(f32, u32)>; 3] = Default::default();
        for (waiting, at) in self.waiting.iter().zip(all) {
            let Rank { turn, priority } = self.rank(waiting);
            turns[turn as usize].push((priority, at));
        }
        // The overdue and the near take turns: each gets half of the places, and what the other
        // leaves.
        let [overdue, near, _] = turns.each_ref().map(Vec::len);
        let beside = |others: usize| CANDIDATES_MAX - others.min(CANDIDATES_MAX / 2);
        let far = CANDIDATES_MAX.saturating_sub(overdue + near);
        let mut candidates: Vec<u32> = Vec::with_capacity(CANDIDATES_MAX);
        for (all, most) in turns.iter_mut().zip([beside(near), beside(overdue), far]) {
            if most < all.len() {
                all.select_nth_unstable_by(most, |(a, _), (b, _)| b.total_cmp(a));
                all.truncate(most);
            }
            candidates.extend(all.iter().map(|(_, at)| *at));
        }
        candidates.sort_unstable();
        candidates
    }

    /// What may go with a datagram, in ascending order of id.
    fn due(&mut self) -> Vec<Due> {
        let Self { tick, interval, .. } = *self;
        self.gather();
        let candidates = self.candidates();
        let mut due: Vec<Due> = Vec::with_capacity(candidates.len());
        let mut known: Vec<AvatarId> = Vec::new();
        for at in candidates {
            let waiting = &self.waiting[at as usize];
            let (avatar, pose) = (waiting.avatar, waiting.course.at(tick, interval));
            if waiting.sent.is_some_and(|sent| sent.at(tick, interval) == pose) {
                known.push(avatar);
                continue;
            }
            due.push(Due { avatar, pose, rank: self.rank(waiting), is_new: true });
        }
        self.remove_waiting(&known);
        let new = due.len();
        self.repeat(&mut due);
        if due.iter().all(|due| due.rank.turn == Turn::Along) {
            due.clear();
        }
        if due.len() > new {
            due.sort_unstable_by_key(|due| due.avatar);
        }
        due
    }

    /// Removes courses from those that wait. The ids are in ascending order.
    fn remove_waiting(&mut self, ids: &[AvatarId]) {
        debug_assert!(ids.is_sorted(), "ids in ascending order");
        let mut ids = ids.iter().peekable();
        if ids.len() > 0 {
            self.waiting.retain(|waiting| {
                while ids.next_if(|id| **id < waiting.avatar).is_some() {}
                ids.peek().is_none_or(|id| **id != waiting.avatar)
            });
        }
    }

    /// Adds the courses that go again.
    fn repeat(&mut self, due: &mut Vec<Due>) {
        let Self { tick, interval, from, .. } = *self;
        let (resend_ticks, copy_ticks) = (self.resend_ticks(), self.copy_ticks());
        let (avatars, new) = (&self.avatars, due.len());
        let mut consider = |avatar: AvatarId, record: &AvatarRecord| {
            let is_copy = record.copies < 2 && record.has_waited(tick, copy_ticks);
            let must = is_copy || record.has_waited(tick, resend_ticks);
            let goes = must || record.has_waited(tick, REPEAT_TICKS);
            if !goes || due[..new].binary_search_by_key(&avatar, |due| due.avatar).is_ok() {
                return;
            }
            let AvatarRecord { course, acknowledged, .. } = *record;
            let pose = course.at(tick, interval);
            let shown = acknowledged.map(|known| known.course.at(tick, interval));
            let ticks = tick.saturating_sub(course.tick);
            let waited = interval * ticks;
            let (weight, is_near) = weigh(from, shown.as_ref(), &pose, [waited, interval]);
            // Nothing is kept of those that go again: they gather as much at each tick.
            let priority = weight * ticks.max(1) as f32;
            let turn = if must { Turn::of_new(waited, is_near) } else { Turn::Along };
            due.push(Due { avatar, pose, rank: Rank { turn, priority }, is_new: false });
        };
        let soonest = resend_ticks.min(copy_ticks).min(REPEAT_TICKS);
        for sent in self.sent.iter_mut().filter(|sent| !sent.is_spent) {
            if !sent.is_missing && sent.tick.saturating_add(soonest) > tick {
                continue;
            }
            sent.is_spent = true;
            for (avatar, _) in &sent.poses {
                let record = avatars.get(avatar).filter(|record| !record.is_settled());
                // Each course is looked at with its last datagram.
                if let Some(record) = record.filter(|r| r.sent_sequence == sent.sequence) {
                    sent.is_spent = false;
                    consider(*avatar, record);
                }
            }
        }
        let oldest = self.sent.front().map_or(u32::MAX, |sent| sent.sequence);
        self.forgotten.retain(|avatar| {
            let record = avatars.get(avatar).filter(|record| !record.is_settled());
            let record = record.filter(|record| record.sent_sequence < oldest);
            record.inspect(|record| consider(*avatar, record)).is_some()
        });
    }

    /// Chooses what goes into the next datagram, whose entries may take this number of bytes: all
    /// that is due, or what matters most. The rest waits on.
    fn choose(&mut self, mut due: Vec<Due>, room: usize) -> (Draft, Vec<Due>) {
        let mut draft = Draft::default();
        let add = |draft: &mut Draft, due: &Due, encoder: &Self| {
            draft.add(due.avatar, encoder.baseline(due.avatar), due.pose, room)
        };
        // Few may fit as they are. Many are brought into an order at once.
        let may_fit = due.len() * ENTRY_BYTES <= room;
        let fits = may_fit && due.iter().all(|due| add(&mut draft, due, self));
        if !fits || draft.shrink(room) < due.len() {
            draft.clear();
            due = in_turns(due);
            let _ = due.iter().all(|due| add(&mut draft, due, self));
            due.truncate(draft.shrink(room));
        }
        let mut new: Vec<AvatarId> =
            due.iter().filter(|due| due.is_new).map(|due| due.avatar).collect();
        new.sort_unstable();
        self.remove_waiting(&new);
        (draft, due)
    }

    /// The baseline for an avatar in the next datagram: where its newest acknowledged course, if it
    /// is recent enough, leads. Otherwise the default pose.
    fn baseline(&self, avatar: AvatarId) -> Baseline {
        let known = self.avatars.get(&avatar).and_then(|record| record.acknowledged);
        let Some(known) = known else { return Baseline::default() };
        let distance = self.next_sequence().saturating_sub(known.sequence);
        if distance > BASELINE_DISTANCE_MAX {
            return Baseline::default();
        }
        Baseline { distance, pose: known.course.at(self.tick, self.interval) }
    }

    /// Records that a pose is sent.
    fn note(&mut self, due: &Due, sequence: u32) {
        let course = Course { tick: self.tick, pose: due.pose };
        match self.avatars.entry(due.avatar) {
            Entry::Occupied(mut record) if !due.is_new => {
                record.get_mut().repeat(self.tick, sequence);
            }
            Entry::Occupied(mut record) => {
                let acknowledged = record.get().acknowledged;
                record.insert(AvatarRecord::new(course, sequence, acknowledged));
            }
            Entry::Vacant(place) => {
                place.insert(AvatarRecord::new(course, sequence, None));
            }
        }
    }

    /// Remembers the poses of a datagram that is sent.
    fn remember(&mut self, poses: Vec<(AvatarId, WirePose)>) {
        self.sequence = self.next_sequence();
        let (sequence, tick) = (self.sequence, self.tick);
        self.sent_poses += poses.len();
        let (is_missing, is_spent) = (false, false);
        self.sent.push_back(SentDatagram { sequence, tick, poses, is_missing, is_spent });
        while self.sent.len() > BASELINE_DISTANCE_MAX as usize || self.sent_poses > SENT_POSES_MAX {
            let Some(oldest) = self.sent.pop_front() else { break };
            self.sent_poses -= oldest.poses.len();
            let is_open = |avatar: &AvatarId| {
                let record = self.avatars.get(avatar).filter(|record| !record.is_settled());
                record.is_some_and(|record| record.sent_sequence == oldest.sequence)
            };
            self.forgotten.extend(oldest.poses.iter().map(|(id, _)| *id).filter(is_open));
        }
    }
}

/// Brings what is due into the order of its turns. Those that are overdue and those near by take
/// turns.
fn in_turns(mut due: Vec<Due>) -> Vec<Due> {
    due.sort_unstable_by(|a, b| a.rank.compare(&b.rank));
    let first = |turn: Turn| due.partition_point(|due| due.rank.turn < turn);
    let (overdue, near) = (first(Turn::Near), first(Turn::Far));
    let mut ordered = Vec::with_capacity(due.len());
    let mut due = due.into_iter();
    let mut overdue = Vec::from_iter(due.by_ref().take(overdue)).into_iter();
    let mut near = Vec::from_iter(due.by_ref().take(near - overdue.len())).into_iter();
    while overdue.len() + near.len() > 0 {
        ordered.extend(overdue.next());
        ordered.extend(near.next());
    }
    ordered.extend(due);
    ordered
}
