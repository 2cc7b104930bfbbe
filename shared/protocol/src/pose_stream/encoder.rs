//! The server's end.

use std::collections::{BTreeMap, VecDeque};

use super::{
    Ack, BASELINE_DISTANCE_MAX, DATAGRAM_BYTES_MAX, ENTRIES_MAX,
    entry::{self, BASELINE},
};
use crate::{quantise::WirePose, varint};
use sightline_world::motion::{AvatarId, Pose};

/// A pose whose datagram is not acknowledged is sent again after so many ticks.
const RESEND_TICKS: u32 = 4;
/// Poses remembered in case that they are acknowledged: at 28 bytes each, 112 KiB at the most.
const SENT_POSES_MAX: usize = 4_096;

/// The server's end of one client's pose stream.
#[derive(Clone, Debug)]
pub struct PoseEncoder {
    /// The number of the newest datagram; 0 before the first.
    sequence: u32,
    datagram_bytes_max: usize,
    /// What the client holds or is about to. The caller bounds it by [`PoseEncoder::forget`].
    pub(super) told: BTreeMap<AvatarId, Told>,
    /// The datagrams that are not acknowledged, oldest first: at most [`BASELINE_DISTANCE_MAX`],
    /// and at most [`SENT_POSES_MAX`] poses.
    pub(super) sent: VecDeque<Sent>,
    pub(super) sent_poses: usize,
}

/// What a client was told of an avatar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Told {
    newest: WirePose,
    /// The first datagram with it; all later ones have it too.
    newest_sequence: u32,
    /// When it was sent the last time.
    newest_tick: u32,
    /// The newest that the client is known to hold, and its datagram.
    acknowledged: Option<(u32, WirePose)>,
}

#[derive(Clone, Debug)]
pub(super) struct Sent {
    sequence: u32,
    pub(super) poses: Vec<(AvatarId, WirePose)>,
}

impl Default for PoseEncoder {
    fn default() -> Self {
        Self {
            sequence: 0,
            datagram_bytes_max: DATAGRAM_BYTES_MAX,
            told: BTreeMap::new(),
            sent: VecDeque::new(),
            sent_poses: 0,
        }
    }
}

impl PoseEncoder {
    /// Writes no longer datagrams than this from now on, for a path that lets nothing longer
    /// through; at least 128 and at most [`DATAGRAM_BYTES_MAX`] bytes.
    pub fn set_datagram_bytes_max(&mut self, bytes_max: usize) {
        self.datagram_bytes_max = bytes_max.clamp(128, DATAGRAM_BYTES_MAX);
    }

    /// The number that the next datagram will have.
    pub fn next_sequence(&self) -> u32 {
        self.sequence.saturating_add(1)
    }

    /// Writes the datagrams, each at most [`DATAGRAM_BYTES_MAX`] long, that tell the client these
    /// poses as they were at a tick, and again those of which no word came back. Call it at every
    /// tick, even without news. The poses are in ascending order of id.
    pub fn encode(&mut self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<Vec<u8>> {
        let mut writer = Writer::default();
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

    /// The avatar vanished: nothing about it is sent any more.
    pub fn forget(&mut self, avatar: AvatarId) {
        self.told.remove(&avatar);
    }

    /// Takes in what the client says it has received; nonsense is ignored.
    pub fn acknowledge(&mut self, ack: Ack) {
        if ack.newest > self.sequence {
            return;
        }
        let told = &mut self.told;
        let mut poses_left = 0;
        self.sent.retain(|sent| {
            if !ack.covers(sent.sequence) {
                poses_left += sent.poses.len();
                return true;
            }
            for (avatar, pose) in &sent.poses {
                if let Some(told) = told.get_mut(avatar)
                    && told.acknowledged.is_none_or(|(sequence, _)| sequence < sent.sequence)
                {
                    told.acknowledged = Some((sent.sequence, *pose));
                }
            }
            false
        });
        self.sent_poses = poses_left;
    }

    /// What there is to tell: news, and old news of which no word came back; ascending.
    fn due(&self, tick: u32, poses: &[(AvatarId, Pose)]) -> Vec<(AvatarId, WirePose)> {
        let mut due: BTreeMap<AvatarId, WirePose> = self
            .told
            .iter()
            .filter(|(_, told)| !told.is_settled() && told.is_overdue(tick))
            .map(|(avatar, told)| (*avatar, told.newest))
            .collect();
        for (avatar, pose) in poses {
            let pose = WirePose::from(pose);
            if self.told.get(avatar).is_none_or(|told| told.newest != pose) {
                due.insert(*avatar, pose);
            }
        }
        due.into_iter().collect()
    }

    /// What the client is known to hold of an avatar and may take as the baseline in a datagram.
    fn baseline(&self, avatar: AvatarId, sequence: u32) -> Option<(u32, WirePose)> {
        let (acknowledged, pose) = self.told.get(&avatar)?.acknowledged?;
        let distance = sequence.saturating_sub(acknowledged);
        (distance <= BASELINE_DISTANCE_MAX).then_some((distance, pose))
    }

    fn note(&mut self, avatar: AvatarId, pose: WirePose, tick: u32) {
        let before = self.told.get(&avatar);
        let acknowledged = before.and_then(|told| told.acknowledged);
        // A round trip may take longer than to the next time: word of any of them will do.
        let newest_sequence = match before {
            Some(told) if told.newest == pose => told.newest_sequence,
            _ => self.next_sequence(),
        };
        let told = Told { newest: pose, newest_sequence, newest_tick: tick, acknowledged };
        self.told.insert(avatar, told);
    }

    /// Ends a datagram and remembers it.
    fn close(&mut self, writer: &mut Writer) -> Vec<u8> {
        self.sequence = self.next_sequence();
        let Writer { bytes, poses, .. } = std::mem::take(writer);
        self.sent_poses += poses.len();
        self.sent.push_back(Sent { sequence: self.sequence, poses });
        while self.sent.len() > BASELINE_DISTANCE_MAX as usize || self.sent_poses > SENT_POSES_MAX {
            let Some(oldest) = self.sent.pop_front() else { break };
            self.sent_poses -= oldest.poses.len();
        }
        bytes
    }
}

impl Told {
    /// Whether the client is known to hold the newest.
    fn is_settled(&self) -> bool {
        self.acknowledged.is_some_and(|(sequence, _)| sequence >= self.newest_sequence)
    }

    fn is_overdue(&self, tick: u32) -> bool {
        tick.saturating_sub(self.newest_tick) >= RESEND_TICKS
    }
}

/// A datagram being written.
#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    poses: Vec<(AvatarId, WirePose)>,
    /// The baseline distance of the preceding entry; 0 is none.
    distance: u32,
}

impl Writer {
    fn open(&mut self, sequence: u32, tick: u32) {
        varint::write(&mut self.bytes, sequence);
        varint::write(&mut self.bytes, tick);
    }

    fn entry(&self, avatar: AvatarId, base: Option<(u32, WirePose)>, pose: &WirePose) -> Vec<u8> {
        let (distance, base) = base.unwrap_or_default();
        let follows = distance != self.distance;
        let flags = entry::flags(&base, pose);
        let mut out = Vec::with_capacity(40);
        out.push(flags | if follows { BASELINE } else { 0 });
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

    /// Whether an entry more would be one too many.
    fn is_full(&self, entry_bytes: usize, bytes_max: usize) -> bool {
        !self.poses.is_empty()
            && (self.poses.len() >= ENTRIES_MAX || self.bytes.len() + entry_bytes > bytes_max)
    }

    fn push(
        &mut self,
        avatar: AvatarId,
        base: Option<(u32, WirePose)>,
        pose: WirePose,
        entry: &[u8],
    ) {
        self.bytes.extend_from_slice(entry);
        self.poses.push((avatar, pose));
        self.distance = base.map_or(0, |(distance, _)| distance);
    }
}
