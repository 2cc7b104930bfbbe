//! The server's end of a pose stream.

use std::collections::{BTreeMap, VecDeque};

use sightline_world::motion::{AvatarId, Pose};

use super::{
    Ack, BASELINE_DISTANCE_MAX, DATAGRAM_BYTES_MAX, ENTRIES_MAX,
    entry::{self, BASELINE},
};
use crate::{quantise::WirePose, varint};

/// The number of ticks after which a pose is sent again unless its datagram was acknowledged.
const RESEND_TICKS: u32 = 4;
/// The greatest number of unacknowledged poses that are remembered: 28 bytes each, 112 KiB in all.
const SENT_POSES_MAX: usize = 4_096;

/// The server's end of one client's pose stream: it encodes poses into datagrams.
#[derive(Clone, Debug)]
pub struct PoseEncoder {
    /// The number of the newest datagram; 0 before the first.
    sequence: u32,
    datagram_bytes_max: usize,
    /// What was sent about each avatar. The caller bounds it by [`PoseEncoder::forget`].
    pub(super) avatars: BTreeMap<AvatarId, AvatarRecord>,
    /// The datagrams that are not acknowledged, oldest first: at most [`BASELINE_DISTANCE_MAX`],
    /// with at most [`SENT_POSES_MAX`] poses.
    pub(super) sent: VecDeque<SentDatagram>,
    pub(super) sent_poses: usize,
}

/// A pose that the client holds, against which an entry is coded.
#[derive(Clone, Copy, Debug, Default)]
struct Baseline {
    /// How many datagrams back the pose was sent; 0 stands for the default pose.
    distance: u32,
    pose: WirePose,
}

/// What was sent about an avatar.
#[derive(Clone, Copy, Debug)]
pub(super) struct AvatarRecord {
    /// The newest pose that was sent.
    newest: WirePose,
    /// The first datagram with the newest pose. Later datagrams have it too.
    newest_sequence: u32,
    /// The tick at which the newest pose was last sent.
    newest_tick: u32,
    /// The newest pose that the client acknowledged, and its datagram.
    acknowledged: Option<(u32, WirePose)>,
}

/// A datagram that is not acknowledged.
#[derive(Clone, Debug)]
pub(super) struct SentDatagram {
    sequence: u32,
    /// The poses in it, in ascending order of id.
    pub(super) poses: Vec<(AvatarId, WirePose)>,
}

impl Default for PoseEncoder {
    fn default() -> Self {
        Self {
            sequence: 0,
            datagram_bytes_max: DATAGRAM_BYTES_MAX,
            avatars: BTreeMap::new(),
            sent: VecDeque::new(),
            sent_poses: 0,
        }
    }
}

impl PoseEncoder {
    /// Limits the length of later datagrams to what the network path allows, in bytes. The limit is
    /// clamped to 128 at least and [`DATAGRAM_BYTES_MAX`] at most.
    pub fn set_datagram_bytes_max(&mut self, bytes_max: usize) {
        self.datagram_bytes_max = bytes_max.clamp(128, DATAGRAM_BYTES_MAX);
    }

    /// The sequence number of the next datagram.
    pub fn next_sequence(&self) -> u32 {
        self.sequence.saturating_add(1)
    }

    /// Encodes the poses that changed by a tick, and again the poses that the client has not
    /// acknowledged in time. Call it at every tick, even without poses. The poses are in ascending
    /// order of id. Each datagram has at most [`DATAGRAM_BYTES_MAX`] bytes.
    pub fn encode(&mut self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<Vec<u8>> {
        debug_assert!(poses.is_sorted_by(|(a, _), (b, _)| a < b), "poses in ascending order");
        let mut writer = DatagramWriter::default();
        let mut datagrams = Vec::new();
        for (avatar, pose) in self.due(tick, poses) {
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
            self.note(avatar, pose, tick);
        }
        if !writer.poses.is_empty() {
            datagrams.push(self.close(&mut writer));
        }
        datagrams
    }

    /// Stops sending about an avatar that vanished.
    pub fn forget(&mut self, avatar: AvatarId) {
        self.avatars.remove(&avatar);
    }

    /// Processes an acknowledgement of the client. One of a datagram that was never sent is
    /// ignored.
    pub fn acknowledge(&mut self, ack: Ack) {
        if ack.newest > self.sequence {
            return;
        }
        let avatars = &mut self.avatars;
        let mut poses_left = 0;
        self.sent.retain(|sent| {
            if !ack.covers(sent.sequence) {
                poses_left += sent.poses.len();
                return true;
            }
            for (avatar, pose) in &sent.poses {
                if let Some(record) = avatars.get_mut(avatar)
                    && record.acknowledged.is_none_or(|(sequence, _)| sequence < sent.sequence)
                {
                    record.acknowledged = Some((sent.sequence, *pose));
                }
            }
            false
        });
        self.sent_poses = poses_left;
    }

    /// The poses to send: changed ones and overdue ones, in ascending order of id.
    fn due(&self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<(AvatarId, WirePose)> {
        let mut due: BTreeMap<AvatarId, WirePose> = self
            .avatars
            .iter()
            .filter(|(_, record)| !record.is_settled() && record.is_overdue(tick))
            .map(|(avatar, record)| (*avatar, record.newest))
            .collect();
        for (avatar, pose) in poses {
            let pose = WirePose::from(pose);
            if self.avatars.get(avatar).is_none_or(|record| record.newest != pose) {
                due.insert(*avatar, pose);
            }
        }
        due.into_iter().collect()
    }

    /// The baseline for an avatar in a datagram: the newest acknowledged pose, if it is recent
    /// enough.
    fn baseline(&self, avatar: AvatarId, sequence: u32) -> Option<Baseline> {
        let (acknowledged, pose) = self.avatars.get(&avatar)?.acknowledged?;
        let distance = sequence.saturating_sub(acknowledged);
        (distance <= BASELINE_DISTANCE_MAX).then_some(Baseline { distance, pose })
    }

    /// Records that a pose is sent.
    fn note(&mut self, avatar: AvatarId, pose: WirePose, tick: u32) {
        let before = self.avatars.get(&avatar);
        let acknowledged = before.and_then(|record| record.acknowledged);
        // A round trip may take longer than a resend. An acknowledgement of any of the datagrams
        // counts.
        let newest_sequence = match before {
            Some(record) if record.newest == pose => record.newest_sequence,
            _ => self.next_sequence(),
        };
        let record =
            AvatarRecord { newest: pose, newest_sequence, newest_tick: tick, acknowledged };
        self.avatars.insert(avatar, record);
    }

    /// Ends a datagram and remembers its poses.
    fn close(&mut self, writer: &mut DatagramWriter) -> Vec<u8> {
        self.sequence = self.next_sequence();
        let DatagramWriter { bytes, poses, .. } = std::mem::take(writer);
        self.sent_poses += poses.len();
        self.sent.push_back(SentDatagram { sequence: self.sequence, poses });
        while self.sent.len() > BASELINE_DISTANCE_MAX as usize || self.sent_poses > SENT_POSES_MAX {
            let Some(oldest) = self.sent.pop_front() else { break };
            self.sent_poses -= oldest.poses.len();
        }
        debug_assert!(bytes.len() <= DATAGRAM_BYTES_MAX, "a datagram of {} bytes", bytes.len());
        bytes
    }
}

impl AvatarRecord {
    /// Whether the client has acknowledged the newest pose.
    fn is_settled(&self) -> bool {
        self.acknowledged.is_some_and(|(sequence, _)| sequence >= self.newest_sequence)
    }

    /// Whether it is time to send the newest pose again.
    fn is_overdue(&self, tick: u32) -> bool {
        tick.saturating_sub(self.newest_tick) >= RESEND_TICKS
    }
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
