//! A datagram that is being put together.

use sightline_world::motion::AvatarId;

use super::{
    ENTRIES_MAX,
    entry::{self, BASELINE},
};
use crate::{quantise::WirePose, varint};

/// The entries of a datagram, each coded already but for what depends on the entry before it.
#[derive(Clone, Debug, Default)]
pub(super) struct Draft {
    entries: Vec<DraftEntry>,
    /// The differences of all entries, one after the other.
    fields: Vec<u8>,
    /// The least that the entries may take, in bytes.
    least_bytes: usize,
}

#[derive(Clone, Copy, Debug)]
struct DraftEntry {
    avatar: AvatarId,
    pose: WirePose,
    baseline: Baseline,
    flags: u8,
    /// Where its differences are.
    fields: [u32; 2],
    /// Its place among the entries as they were added.
    place: u32,
}

/// Where a course that the client knows leads by the tick of an entry, which is coded against it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Baseline {
    /// How many datagrams back the pose was sent; 0 stands for the default pose.
    pub(super) distance: u32,
    pub(super) pose: WirePose,
}

impl Draft {
    /// Forgets all entries, and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.entries.clear();
        self.fields.clear();
        self.least_bytes = 0;
    }

    /// Adds an entry, unless it cannot fit into this number of bytes any more.
    pub(super) fn add(
        &mut self,
        avatar: AvatarId,
        baseline: Baseline,
        pose: WirePose,
        bytes_max: usize,
    ) -> bool {
        let start = self.fields.len();
        let flags = entry::flags(&baseline.pose, &pose);
        entry::write_fields(&mut self.fields, flags, &baseline.pose, &pose);
        // The flags, and at least a byte for the id.
        let bytes = 2 + self.fields.len() - start;
        if self.entries.len() >= ENTRIES_MAX || self.least_bytes + bytes > bytes_max {
            self.fields.truncate(start);
            return false;
        }
        self.least_bytes += bytes;
        let fields = [start as u32, self.fields.len() as u32];
        let place = self.entries.len() as u32;
        self.entries.push(DraftEntry { avatar, pose, baseline, flags, fields, place });
        true
    }

    /// Brings the entries into their order, and removes those that were added last until the rest
    /// fits into this number of bytes. Returns how many are left.
    pub(super) fn shrink(&mut self, bytes_max: usize) -> usize {
        self.entries.sort_unstable_by_key(|entry| entry.avatar);
        loop {
            let bytes = self.bytes();
            let count = self.entries.len();
            if bytes <= bytes_max || count <= 1 {
                return count;
            }
            // No more than are surely too many.
            let longest = bytes.div_ceil(count) * 2;
            let left = count - ((bytes - bytes_max) / longest).max(1);
            self.entries.retain(|entry| (entry.place as usize) < left);
        }
    }

    /// What the entries take in their order, in bytes.
    fn bytes(&self) -> usize {
        let lengths = self.linked().map(|(entry, step, follows)| {
            let [start, end] = entry.fields;
            let distance = if follows { varint::length(entry.baseline.distance) } else { 0 };
            1 + varint::length(step) + distance + (end - start) as usize
        });
        lengths.sum()
    }

    /// Each entry with the step from the id before, and whether its distance to the baseline
    /// follows.
    fn linked(&self) -> impl Iterator<Item = (&DraftEntry, u32, bool)> {
        let (mut next, mut distance) = (0, 0);
        self.entries.iter().map(move |entry| {
            debug_assert!(next <= entry.avatar.0, "each avatar has one entry");
            let (step, follows) = (entry.avatar.0 - next, entry.baseline.distance != distance);
            (next, distance) = (entry.avatar.0.saturating_add(1), entry.baseline.distance);
            (entry, step, follows)
        })
    }

    /// Appends the entries in their order.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        for (entry, step, follows) in self.linked() {
            out.push(entry.flags | if follows { BASELINE } else { 0 });
            varint::write(out, step);
            if follows {
                varint::write(out, entry.baseline.distance);
            }
            let [start, end] = entry.fields.map(|at| at as usize);
            out.extend_from_slice(&self.fields[start..end]);
        }
    }

    /// The poses in their order.
    pub(super) fn poses(&self) -> Vec<(AvatarId, WirePose)> {
        self.entries.iter().map(|entry| (entry.avatar, entry.pose)).collect()
    }
}
