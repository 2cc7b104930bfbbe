//! Which avatars can be in which cells, and which of them can be visible from where.

use roaring::RoaringBitmap;
use sightline_shared::{
    motion::AvatarId,
    world::{CellId, Cells, World},
};

use super::{population::Slot, reach::Reach};

/// The cells that an avatar can be in during some time.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Zone {
    /// With its eye, ascending.
    pub(super) eyes: Vec<CellId>,
    /// With any part of its body, ascending.
    pub(super) bodies: Vec<CellId>,
}

impl Zone {
    /// The zone of an avatar that stays within reach.
    pub(super) fn of(reach: &Reach, world: &World) -> Self {
        Self { eyes: reach.eyes(), bodies: reach.bodies(&world.cells, &world.body) }
    }
}

/// An avatar, and where it is kept. Ordered by id.
pub(super) type Member = (AvatarId, Slot);

/// For each cell, who can be in it.
#[derive(Clone, Debug)]
pub(super) struct CellIndex {
    members: Vec<Vec<Member>>,
    occupied: RoaringBitmap,
}

impl CellIndex {
    pub(super) fn new(cells: usize) -> Self {
        Self { members: vec![Vec::new(); cells], occupied: RoaringBitmap::new() }
    }

    /// The cells that have anybody.
    pub(super) fn occupied(&self) -> &RoaringBitmap {
        &self.occupied
    }

    /// Who can be in a cell.
    pub(super) fn of(&self, cell: u32) -> &[Member] {
        &self.members[cell as usize]
    }

    pub(super) fn insert(&mut self, member: Member, cells: &[CellId]) {
        for cell in cells {
            let members = &mut self.members[cell.0 as usize];
            if members.is_empty() {
                self.occupied.insert(cell.0);
            }
            members.push(member);
        }
    }

    pub(super) fn remove(&mut self, member: Member, cells: &[CellId]) {
        for cell in cells {
            let members = &mut self.members[cell.0 as usize];
            if let Some(place) = members.iter().position(|m| *m == member) {
                members.swap_remove(place);
            }
            if members.is_empty() {
                self.occupied.remove(cell.0);
            }
        }
    }
}

/// The zones of many avatars.
#[derive(Clone, Debug)]
pub(super) struct ZoneIndex {
    eyes: CellIndex,
    bodies: CellIndex,
}

impl ZoneIndex {
    pub(super) fn new(cells: usize) -> Self {
        Self { eyes: CellIndex::new(cells), bodies: CellIndex::new(cells) }
    }

    pub(super) fn insert(&mut self, member: Member, zone: &Zone) {
        self.eyes.insert(member, &zone.eyes);
        self.bodies.insert(member, &zone.bodies);
    }

    pub(super) fn remove(&mut self, member: Member, zone: &Zone) {
        self.eyes.remove(member, &zone.eyes);
        self.bodies.remove(member, &zone.bodies);
    }

    /// Whether somebody here can be seen from a zone, or can see into it.
    pub(super) fn meets(&self, cells: &Cells, zone: &Zone) -> bool {
        self.sides(zone).any(|(from, index)| {
            from.iter().any(|cell| !cells.pvs[cell.0 as usize].is_disjoint(&index.occupied))
        })
    }

    /// Everybody here who can be seen from a zone, or can see into it; in no order, some twice.
    pub(super) fn meeting(&self, cells: &Cells, zone: &Zone, found: &mut Vec<Member>) {
        for (from, index) in self.sides(zone) {
            for cell in from {
                let visible = &cells.pvs[cell.0 as usize];
                if visible.is_disjoint(&index.occupied) {
                    continue;
                }
                for seen in visible & &index.occupied {
                    found.extend_from_slice(index.of(seen));
                }
            }
        }
    }

    /// An eye there sees a body here; an eye here sees a body there. The PVS is symmetric.
    fn sides<'a>(&'a self, zone: &'a Zone) -> impl Iterator<Item = (&'a [CellId], &'a CellIndex)> {
        [(&zone.eyes[..], &self.bodies), (&zone.bodies[..], &self.eyes)].into_iter()
    }
}
