//! Indices: which avatars can be where.

use crate::{
    bit_set::BitSet,
    building::{Building, Sectors},
    slot::Member,
};

/// All indices of avatars by place.
#[derive(Clone, Debug)]
pub(crate) struct Indices {
    /// The coarse regions of live avatars, by cell. Sectors would leave many times as many.
    pub(crate) coarse: OccupantIndex,
    /// Where live avatars can be until a hidden avatar that they reveal can be told of, by sector.
    pub(crate) live: OccupantIndex,
    /// The TBVs of quiet and asked avatars, by sector.
    pub(crate) hidden: OccupantIndex,
}

impl Indices {
    pub(crate) fn new(building: &Building) -> Self {
        let by_sector = OccupantIndex::new(building.sectors.len());
        let coarse = OccupantIndex::new(building.cells().cells.len());
        Self { coarse, live: by_sector.clone(), hidden: by_sector }
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

/// The numbered parts of the building in which an avatar can be: its cells or its sectors.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct Occupied {
    /// The parts that the eye can be in, ascending.
    pub(crate) eyes: Vec<u32>,
    /// The parts that a part of the body can be in, ascending.
    pub(crate) bodies: Vec<u32>,
}

/// Which avatars can be where.
#[derive(Clone, Debug)]
pub(crate) struct OccupantIndex {
    eyes: MemberIndex,
    bodies: MemberIndex,
}

impl OccupantIndex {
    fn new(parts: usize) -> Self {
        let empty = MemberIndex::new(parts);
        Self { eyes: empty.clone(), bodies: empty }
    }

    pub(crate) fn insert(&mut self, member: Member, parts: &Occupied) {
        self.eyes.insert(member, &parts.eyes);
        self.bodies.insert(member, &parts.bodies);
    }

    pub(crate) fn remove(&mut self, member: Member, parts: &Occupied) {
        self.eyes.remove(member, &parts.eyes);
        self.bodies.remove(member, &parts.bodies);
    }

    /// Moves an avatar from some parts to others.
    pub(crate) fn replace(&mut self, member: Member, old: &Occupied, new: &Occupied) {
        self.eyes.replace(member, &old.eyes, &new.eyes);
        self.bodies.replace(member, &old.bodies, &new.bodies);
    }

    /// Adds the avatars with a body in parts that an eye sees, and those with an eye in parts that
    /// see a body. They are in no order, and some come twice.
    pub(crate) fn meeting(
        &self,
        seen_by_eyes: &BitSet,
        seeing_bodies: &BitSet,
        found: &mut Vec<Member>,
    ) {
        found.extend(self.bodies.among(seen_by_eyes));
        found.extend(self.eyes.among(seeing_bodies));
    }

    /// Adds the avatars that, by sectors, may be seen from somewhere in these, or see it. The PVS
    /// is symmetric.
    pub(crate) fn meeting_sectors(
        &self,
        sectors: &Sectors,
        here: &Occupied,
        found: &mut Vec<Member>,
    ) {
        let [eyes, bodies] = [&here.eyes, &here.bodies].map(|here| sectors.visible_from(here));
        self.meeting(&eyes, &bodies, found);
    }
}
