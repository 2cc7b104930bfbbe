//! The client's end of a pose stream.

use std::{collections::VecDeque, time::Duration};

use sightline_world::motion::AvatarId;

use super::{
    Ack, BASELINE_DISTANCE_MAX, ENTRIES_MAX, RESEND_TICKS, check_length,
    entry::{self, BASELINE},
};
use crate::{DecodeError, quantise::WirePose, varint};

/// The number of datagrams remembered as baselines. It exceeds [`BASELINE_DISTANCE_MAX`], because
/// datagrams overtake one another.
const REMEMBERED_MAX: u32 = BASELINE_DISTANCE_MAX + 32;
/// The server has sent lost poses again after this number of ticks.
const CLOSED_TICKS: u32 = RESEND_TICKS + 4;

/// The client's end of its pose stream: it decodes datagrams.
#[derive(Clone, Debug)]
pub struct PoseDecoder {
    /// The time from tick to tick.
    interval: Duration,
    /// The remembered datagrams in ascending order of sequence. All are within [`REMEMBERED_MAX`]
    /// of the newest.
    pub(super) received: VecDeque<PoseUpdate>,
    /// How many datagrams have arrived, duplicates and those that came too late apart.
    count: u32,
}

/// The content of a datagram: the newest poses of some avatars at a tick of the server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PoseUpdate {
    /// The sequence number of the datagram.
    pub sequence: u32,
    /// The tick of the poses.
    pub tick: u32,
    /// The poses in ascending order of id.
    pub poses: Vec<(AvatarId, WirePose)>,
}

impl PoseUpdate {
    /// The pose of an avatar, if the datagram has it.
    pub fn pose(&self, avatar: AvatarId) -> Option<WirePose> {
        let found = self.poses.binary_search_by_key(&avatar, |(id, _)| *id).ok()?;
        self.poses.get(found).map(|(_, pose)| *pose)
    }
}

impl PoseDecoder {
    /// A decoder for a server with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        Self { interval, received: VecDeque::new(), count: 0 }
    }

    /// Decodes a datagram. `None` when it is a duplicate or too old. After an error the decoder is
    /// as if the datagram had been lost.
    pub fn decode(&mut self, datagram: &[u8]) -> Result<Option<&PoseUpdate>, DecodeError> {
        check_length(datagram)?;
        let mut bytes = datagram;
        let sequence = varint::read(&mut bytes)?;
        if sequence == 0 {
            return Err(DecodeError::Malformed);
        }
        let newest = self.received.back().map_or(0, |update| update.sequence);
        if newest.saturating_sub(sequence) >= REMEMBERED_MAX {
            return Ok(None);
        }
        let Err(place) = self.find(sequence) else { return Ok(None) };
        let tick = varint::read(&mut bytes)?;
        let poses = self.read_entries(bytes, sequence, tick)?;
        self.received.insert(place, PoseUpdate { sequence, tick, poses });
        self.count += 1;
        let newest = newest.max(sequence);
        while self.received.front().is_some_and(|u| newest - u.sequence >= REMEMBERED_MAX) {
            self.received.pop_front();
        }
        debug_assert!(self.received.len() <= REMEMBERED_MAX as usize);
        let place = self.find(sequence).ok();
        Ok(place.and_then(|place| self.received.get(place)))
    }

    /// How many datagrams have arrived, and how many the server has sent by then.
    pub fn delivered(&self) -> [u32; 2] {
        [self.count, self.received.back().map_or(0, |update| update.sequence)]
    }

    /// The acknowledgement of all datagrams received so far.
    pub fn ack(&self) -> Ack {
        let Some(newest) = self.received.back().map(|update| update.sequence) else {
            return Ack::default();
        };
        let earlier = self
            .received
            .iter()
            .filter_map(|update| (newest - update.sequence).checked_sub(1))
            .filter(|back| *back < 32)
            .fold(0, |bits, back| bits | 1 << back);
        Ack { newest, earlier }
    }

    /// The tick up to which nothing is missing of what the server sent; `None` before the first
    /// datagram. Lost poses have come again some ticks later.
    pub fn complete_tick(&self) -> Option<u32> {
        let newest = self.received.back()?.tick;
        let updates = self.received.iter().zip(self.received.iter().skip(1));
        let is_gap = |(before, after): &(&PoseUpdate, &PoseUpdate)| {
            before.sequence + 1 < after.sequence && after.tick + CLOSED_TICKS > newest
        };
        let before_gap = { updates }.find(is_gap).map(|(before, _)| before.tick);
        Some(before_gap.unwrap_or(newest))
    }

    /// The sequence number, tick and pose of the newest entry for an avatar in the remembered
    /// datagrams from `since` on. It finds poses that overtook the message that their avatar
    /// appears.
    pub fn newest(&self, avatar: AvatarId, since: u32) -> Option<(u32, u32, WirePose)> {
        self.received
            .iter()
            .rev()
            .take_while(|update| update.sequence >= since)
            .find_map(|update| update.pose(avatar).map(|pose| (update.sequence, update.tick, pose)))
    }

    /// The index of a remembered datagram, or where it would be inserted.
    fn find(&self, sequence: u32) -> Result<usize, usize> {
        self.received.binary_search_by_key(&sequence, |update| update.sequence)
    }

    fn read_entries(
        &self,
        mut bytes: &[u8],
        sequence: u32,
        tick: u32,
    ) -> Result<Vec<(AvatarId, WirePose)>, DecodeError> {
        let mut poses = Vec::new();
        let mut next_id = Some(0u32);
        let mut distance = 0;
        while !bytes.is_empty() {
            let flags = varint::read_byte(&mut bytes)?;
            let step = varint::read(&mut bytes)?;
            let id = next_id.and_then(|next| next.checked_add(step));
            let avatar = AvatarId(id.ok_or(DecodeError::Malformed)?);
            if flags & BASELINE != 0 {
                distance = varint::read(&mut bytes)?;
            }
            let base = self.baseline(avatar, sequence, distance, tick)?;
            poses.push((avatar, entry::read_difference(&mut bytes, flags & !BASELINE, &base)?));
            if poses.len() > ENTRIES_MAX {
                return Err(DecodeError::Malformed);
            }
            next_id = avatar.0.checked_add(1);
        }
        debug_assert!(poses.is_sorted_by(|(a, _), (b, _)| a < b), "ids ascend by construction");
        Ok(poses)
    }

    fn baseline(
        &self,
        avatar: AvatarId,
        sequence: u32,
        distance: u32,
        tick: u32,
    ) -> Result<WirePose, DecodeError> {
        if distance == 0 {
            return Ok(WirePose::default());
        }
        let from = sequence.checked_sub(distance).ok_or(DecodeError::Malformed)?;
        let place = self.find(from).map_err(|_| DecodeError::NoBaseline)?;
        let update = self.received.get(place).ok_or(DecodeError::NoBaseline)?;
        let pose = update.pose(avatar).ok_or(DecodeError::NoBaseline)?;
        Ok(pose.straight_on(self.interval * tick.saturating_sub(update.tick)))
    }
}
