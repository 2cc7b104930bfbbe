//! Indices: which avatars can be where.

use super::{CoarseCells, CoarseRegion, HiddenFootprint};
use crate::{
    bit_set::BitSet,
    building::{Building, Sectors},
    slot::Member,
};

/// All indices of avatars by place.
#[derive(Clone, Debug)]
pub(crate) struct Indices {
    /// The coarse regions of live avatars, by cell.
    pub(crate) coarse: CoarseIndex,
    /// Where live avatars can be until a hidden avatar that they reveal can be told of.
    pub(crate) live: FootprintIndex,
    /// The TBVs of quiet and asked avatars.
    pub(crate) hidden: FootprintIndex,
}

impl Indices {
    pub(crate) fn new(building: &Building) -> Self {
        Self {
            coarse: CoarseIndex::new(building.cells().cells.len()),
            live: FootprintIndex::new(building.sectors.len()),
            hidden: FootprintIndex::new(building.sectors.len()),
        }
    }
}

/// For each of some numbered parts of the building, the avatars that can be in it.
#[derive(Clone, Debug)]
struct MemberIndex {
    members: Vec<Vec<Member>>,
    occupied: BitSet,
}

impl MemberIndex {
    fn new(parts: usize) -> Self {
        Self { members: vec![Vec::new(); parts], occupied: BitSet::default() }
    }

    /// The avatars that can be in some of these parts. An avatar comes once for each of its parts.
    fn among<'a>(&'a self, parts: &'a BitSet) -> impl Iterator<Item = &'a Member> {
        parts.shared(&self.occupied).flat_map(|part| &self.members[part as usize])
    }

    fn insert(&mut self, member: Member, parts: &[u32]) {
        for &part in parts {
            let members = &mut self.members[part as usize];
            debug_assert!(!members.contains(&member), "an avatar is inserted into a part once");
            if members.is_empty() {
                self.occupied.insert(part);
            }
            members.push(member);
        }
    }

    fn remove(&mut self, member: Member, parts: &[u32]) {
        for &part in parts {
            let members = &mut self.members[part as usize];
            let index = members.iter().position(|known| *known == member);
            debug_assert!(index.is_some(), "the avatar is in each part that it is removed from");
            if let Some(index) = index {
                members.swap_remove(index);
            }
            if members.is_empty() {
                self.occupied.remove(part);
            }
        }
    }

    /// Moves an avatar from some parts to others. Both are ascending.
    fn replace(&mut self, member: Member, old: &[u32], new: &[u32]) {
        let missing = |these: &[u32], those: &[u32]| -> Vec<u32> {
            these.iter().filter(|part| those.binary_search(part).is_err()).copied().collect()
        };
        self.remove(member, &missing(old, new));
        self.insert(member, &missing(new, old));
    }
}

/// The coarse regions of live avatars, by cell.
#[derive(Clone, Debug)]
pub(crate) struct CoarseIndex {
    eyes: MemberIndex,
    bodies: MemberIndex,
}

impl CoarseIndex {
    fn new(cells: usize) -> Self {
        Self { eyes: MemberIndex::new(cells), bodies: MemberIndex::new(cells) }
    }

    /// Moves an avatar from the cells of its last coarse region to those of its new one.
    pub(crate) fn replace(&mut self, member: Member, old: &CoarseCells, new: &CoarseCells) {
        self.eyes.replace(member, &old.eyes, &new.eyes);
        self.bodies.replace(member, &old.bodies, &new.bodies);
    }

    /// Removes an avatar with its coarse region.
    pub(crate) fn remove(&mut self, member: Member, region: &CoarseRegion) {
        self.eyes.remove(member, &region.cells.eyes);
        self.bodies.remove(member, &region.cells.bodies);
    }

    /// The avatars with a body in the first set of cells, then those with an eye in the second.
    /// Some come more than once.
    pub(crate) fn meeting<'a>(
        &'a self,
        seen_by_eyes: &'a BitSet,
        seeing_bodies: &'a BitSet,
    ) -> impl Iterator<Item = &'a Member> {
        self.bodies.among(seen_by_eyes).chain(self.eyes.among(seeing_bodies))
    }
}

/// The hidden footprints of many avatars, by sector.
#[derive(Clone, Debug)]
pub(crate) struct FootprintIndex {
    eyes: MemberIndex,
    bodies: MemberIndex,
}

impl FootprintIndex {
    fn new(sectors: usize) -> Self {
        Self { eyes: MemberIndex::new(sectors), bodies: MemberIndex::new(sectors) }
    }

    pub(crate) fn insert(&mut self, member: Member, footprint: &HiddenFootprint) {
        self.eyes.insert(member, &footprint.eye_sectors);
        self.bodies.insert(member, &footprint.body_sectors);
    }

    pub(crate) fn remove(&mut self, member: Member, footprint: &HiddenFootprint) {
        self.eyes.remove(member, &footprint.eye_sectors);
        self.bodies.remove(member, &footprint.body_sectors);
    }

    /// Adds the avatars that, by sectors, can be seen from a footprint or can see into it. They are
    /// in no order, and some come twice. An eye in the footprint sees a body here, or an eye here
    /// sees a body there; the PVS is symmetric.
    pub(crate) fn meeting(
        &self,
        sectors: &Sectors,
        footprint: &HiddenFootprint,
        found: &mut Vec<Member>,
    ) {
        found.extend(self.bodies.among(&sectors.visible_from(&footprint.eye_sectors)));
        found.extend(self.eyes.among(&sectors.visible_from(&footprint.body_sectors)));
    }
}
