//! Indices: which avatars can be where.

use crate::{
    bit_set::BitSet,
    building::{Building, OccupiedSectors, Sectors},
    slot::Member,
};

/// All indices of avatars by place.
#[derive(Clone, Debug)]
pub(crate) struct Indices {
    /// The coarse regions of live avatars.
    pub(crate) coarse: SectorIndex,
    /// Where live avatars can be until a hidden avatar that they reveal can be told of.
    pub(crate) live: SectorIndex,
    /// The TBVs of quiet and asked avatars.
    pub(crate) hidden: SectorIndex,
}

impl Indices {
    pub(crate) fn new(building: &Building) -> Self {
        let empty = SectorIndex::new(&building.sectors);
        Self { coarse: empty.clone(), live: empty.clone(), hidden: empty }
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

/// Which avatars can be in which sectors.
#[derive(Clone, Debug)]
pub(crate) struct SectorIndex {
    eyes: MemberIndex,
    bodies: MemberIndex,
}

impl SectorIndex {
    fn new(sectors: &Sectors) -> Self {
        let empty = MemberIndex::new(sectors.len());
        Self { eyes: empty.clone(), bodies: empty }
    }

    pub(crate) fn insert(&mut self, member: Member, sectors: &OccupiedSectors) {
        self.eyes.insert(member, &sectors.eyes);
        self.bodies.insert(member, &sectors.bodies);
    }

    pub(crate) fn remove(&mut self, member: Member, sectors: &OccupiedSectors) {
        self.eyes.remove(member, &sectors.eyes);
        self.bodies.remove(member, &sectors.bodies);
    }

    /// Moves an avatar from some sectors to others.
    pub(crate) fn replace(&mut self, member: Member, old: &OccupiedSectors, new: &OccupiedSectors) {
        self.eyes.replace(member, &old.eyes, &new.eyes);
        self.bodies.replace(member, &old.bodies, &new.bodies);
    }

    /// Adds the avatars that may be seen from somewhere in these sectors, or see it. They are in no
    /// order, and some come twice. An eye here sees a body there, or an eye there sees a body here;
    /// the PVS is symmetric.
    pub(crate) fn meeting(
        &self,
        sectors: &Sectors,
        here: &OccupiedSectors,
        found: &mut Vec<Member>,
    ) {
        found.extend(self.bodies.among(&sectors.visible_from(&here.eyes)));
        found.extend(self.eyes.among(&sectors.visible_from(&here.bodies)));
    }
}
