//! Which avatars can be where, and which of them can be visible from where.

use sightline_visibility::rooms::{self, RoomIndex};
use sightline_world::{CellId, Cells, World, geometry::Aabb, motion::AvatarId};

use crate::{
    bit_set::BitSet, population::Slot, regions::cover_boxes::CoverBoxes, regions::reach::Reach,
};

/// A building has no more sectors, so that who sees whom takes no more than 32 MiB.
const SECTORS_MAX: usize = 1 << 14;

/// The building, coarser than by cells: a sector is a space, or several that follow one another.
/// Regions overlap many cells but few sectors, and shafts decide what sectors leave open.
#[derive(Clone, Debug)]
pub(crate) struct Sectors {
    /// For each cell.
    of: Vec<u32>,
    /// How many spaces are one.
    share: u32,
    /// For each, those that have a cell that is visible from one of its own.
    visible: Vec<BitSet>,
}

impl Sectors {
    pub(crate) fn new(cells: &Cells) -> Self {
        let share = cells.spaces.len().div_ceil(SECTORS_MAX).max(1) as u32;
        let of: Vec<u32> = cells.cells.iter().map(|cell| cell.space / share).collect();
        let count = of.iter().max().map_or(0, |last| *last as usize + 1);
        let mut visible = vec![BitSet::default(); count];
        for (sector, row) in of.iter().zip(&cells.pvs) {
            row.iter().for_each(|cell| visible[*sector as usize].insert(of[cell as usize]));
        }
        Self { of, share, visible }
    }

    pub(crate) fn len(&self) -> usize {
        self.visible.len()
    }

    /// Those of some cells, ascending.
    pub(crate) fn of(&self, cells: &[CellId]) -> Vec<u32> {
        let mut sectors: Vec<u32> = cells.iter().map(|cell| self.of[cell.0 as usize]).collect();
        sectors.sort_unstable();
        sectors.dedup();
        sectors
    }

    /// Whether a space may see another.
    pub(crate) fn sees(&self, space: u32, other: u32) -> bool {
        self.visible[(space / self.share) as usize].contains(other / self.share)
    }

    /// All that are visible from some.
    pub(crate) fn visible_from(&self, sectors: &[u32]) -> BitSet {
        let mut all = BitSet::default();
        sectors.iter().for_each(|sector| all.unite(&self.visible[*sector as usize]));
        all
    }
}

/// Where a region is in the building.
#[derive(Clone, Debug)]
pub(crate) struct RegionFootprint {
    /// A box around it, in own axes.
    pub(crate) around: Aabb,
    /// The spaces that it has a part in, ascending; and where the cells of each end.
    pub(crate) spaces: Vec<u32>,
    ends: Vec<u32>,
    /// The cells, ascending: those of a space follow one another.
    cells: Vec<CellId>,
    /// What of it is in which rooms; empty where rooms rule nothing out.
    rooms: rooms::RoomOverlap,
}

impl RegionFootprint {
    /// Of boxes in some cells, which are ascending.
    pub(crate) fn of(
        cells: &Cells,
        rooms: &RoomIndex,
        found: Vec<CellId>,
        parts: &CoverBoxes,
    ) -> Self {
        let around = parts.boxes().iter().fold(Aabb::EMPTY, |all, part| all.union(part));
        let (mut spaces, mut ends): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::new());
        for (end, cell) in (1..).zip(&found) {
            let space = cells.cells[cell.0 as usize].space;
            if spaces.last() == Some(&space) {
                ends.pop();
            } else {
                spaces.push(space);
            }
            ends.push(end);
        }
        let rooms = place(rooms, cells, parts, &found);
        Self { around, spaces, ends, cells: found, rooms }
    }

    /// The cells, ascending.
    pub(crate) fn cells(&self) -> &[CellId] {
        &self.cells
    }

    /// Whether rooms let somebody with an eye here see somebody whose body is in another.
    pub(crate) fn shows(&self, bodies: &Self, rooms: &RoomIndex) -> bool {
        !rooms.can_rule_out() || rooms.may_see(&self.rooms, &bodies.rooms)
    }

    /// Adds what can be seen from some of its cells.
    pub(crate) fn see(&self, world: &Cells, of: impl Fn(CellId) -> bool, seen: &mut BitSet) {
        for cell in self.cells.iter().filter(|cell| of(**cell)) {
            let mut row = world.pvs[cell.0 as usize].iter();
            while let Some(range) = row.next_range() {
                seen.insert_range(range);
            }
        }
    }

    /// Whether it has some of these cells.
    pub(crate) fn is_among(&self, seen: &BitSet) -> bool {
        self.cells.iter().any(|cell| seen.contains(cell.0))
    }

    /// Each space and its cells.
    fn by_space(&self) -> impl Iterator<Item = (u32, &[CellId])> {
        let starts = std::iter::once(&0).chain(&self.ends);
        self.spaces
            .iter()
            .zip(starts.zip(&self.ends))
            .map(|(space, (start, end))| (*space, &self.cells[*start as usize..*end as usize]))
    }

    /// Whether some cell of it may see some cell of another.
    pub(crate) fn sees(&self, other: &Self, world: &Cells, sectors: &Sectors) -> bool {
        self.by_space().any(|(here, some)| {
            other.by_space().any(|(there, others)| {
                let sees = |from: &CellId| others.iter().any(|to| world.sees(*from, *to));
                sectors.sees(here, there) && some.iter().any(sees)
            })
        })
    }
}

/// The rooms of a region's boxes in some cells, which are ascending, where rooms rule anything out.
fn place(
    rooms: &RoomIndex,
    cells: &Cells,
    parts: &CoverBoxes,
    found: &[CellId],
) -> rooms::RoomOverlap {
    if rooms.can_rule_out() {
        rooms.overlap_in_cells(cells, parts.boxes(), found)
    } else {
        rooms::RoomOverlap::default()
    }
}

/// Where an avatar can be during some time.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct HiddenFootprint {
    /// The sectors that its eye can be in, ascending.
    eyes: Vec<u32>,
    /// The sectors that any part of its body can be in, ascending.
    bodies: Vec<u32>,
    /// Around all places of its eye, and around all of its body.
    pub(crate) parts: [CoverBoxes; 2],
    /// The rooms of both.
    rooms: [rooms::RoomOverlap; 2],
}

impl HiddenFootprint {
    /// The zone of an avatar that stays within reach.
    pub(crate) fn of(reach: &Reach, world: &World, rooms: &RoomIndex, sectors: &Sectors) -> Self {
        let (bodies, body_parts) = reach.bodies(&world.cells, &world.body);
        let parts = [reach.eye_parts(&world.cells), body_parts];
        let eyes = reach.eyes();
        let rooms = [
            place(rooms, &world.cells, &parts[0], &eyes),
            place(rooms, &world.cells, &parts[1], &bodies),
        ];
        Self { eyes: sectors.of(&eyes), bodies: sectors.of(&bodies), parts, rooms }
    }

    /// The zone of an avatar whose eye stays in a box in own axes, whatever walls are in it.
    pub(crate) fn of_box(eyes: &Aabb, world: &World, rooms: &RoomIndex, sectors: &Sectors) -> Self {
        let boxes = [*eyes, world.body.in_axes(&world.cells.axes).around_box(eyes)];
        let cells = boxes.map(|region| {
            let mut found = Vec::new();
            world.cells.overlapping(&region, &mut found);
            found.sort_unstable();
            found
        });
        let [eyes, bodies] = [0, 1].map(|at: usize| sectors.of(&cells[at]));
        let parts = boxes.map(|part| CoverBoxes::covering([part].into_iter()));
        let rooms = [0, 1].map(|at: usize| place(rooms, &world.cells, &parts[at], &cells[at]));
        Self { eyes, bodies, parts, rooms }
    }

    /// What of it is in a box for the eyes and one for the bodies.
    pub(crate) fn within(&self, boxes: [Aabb; 2]) -> Self {
        Self { parts: self.parts_within(boxes), ..self.clone() }
    }

    /// What of its parts is in a box for the eyes and one for the bodies.
    pub(crate) fn parts_within(&self, boxes: [Aabb; 2]) -> [CoverBoxes; 2] {
        [0, 1].map(|at: usize| self.parts[at].within(&boxes[at]))
    }

    /// Whether rooms let somebody here see somebody there.
    pub(crate) fn shows(&self, other: &Self, rooms: &RoomIndex) -> bool {
        !rooms.can_rule_out() || rooms.may_see(&self.rooms[0], &other.rooms[1])
    }
}

/// An avatar, and where it is kept. Ordered by id.
pub(crate) type Member = (AvatarId, Slot);

/// For each sector, or each cell, who can be in it.
#[derive(Clone, Debug)]
pub(crate) struct SectorIndex {
    members: Vec<Vec<Member>>,
    occupied: BitSet,
}

impl SectorIndex {
    pub(crate) fn new(sectors: usize) -> Self {
        Self { members: vec![Vec::new(); sectors], occupied: BitSet::default() }
    }

    /// Everybody who can be in some sectors; those in several more than once.
    pub(crate) fn among<'a>(&'a self, sectors: &'a BitSet) -> impl Iterator<Item = &'a Member> {
        sectors.shared(&self.occupied).flat_map(|sector| &self.members[sector as usize])
    }

    pub(crate) fn insert(&mut self, member: Member, sectors: &[u32]) {
        for &sector in sectors {
            let members = &mut self.members[sector as usize];
            if members.is_empty() {
                self.occupied.insert(sector);
            }
            members.push(member);
        }
    }

    pub(crate) fn remove(&mut self, member: Member, sectors: &[u32]) {
        for &sector in sectors {
            let members = &mut self.members[sector as usize];
            if let Some(at) = members.iter().position(|m| *m == member) {
                members.swap_remove(at);
            }
            if members.is_empty() {
                self.occupied.remove(sector);
            }
        }
    }

    /// Moves a member from some sectors to others, both ascending.
    pub(crate) fn replace(&mut self, member: Member, old: &[u32], new: &[u32]) {
        let others = |these: &[u32], those: &[u32]| -> Vec<u32> {
            these.iter().filter(|at| those.binary_search(at).is_err()).copied().collect()
        };
        self.remove(member, &others(old, new));
        self.insert(member, &others(new, old));
    }
}

/// The zones of many avatars.
#[derive(Clone, Debug)]
pub(crate) struct FootprintIndex {
    eyes: SectorIndex,
    bodies: SectorIndex,
}

impl FootprintIndex {
    pub(crate) fn new(sectors: usize) -> Self {
        Self { eyes: SectorIndex::new(sectors), bodies: SectorIndex::new(sectors) }
    }

    pub(crate) fn insert(&mut self, member: Member, zone: &HiddenFootprint) {
        self.eyes.insert(member, &zone.eyes);
        self.bodies.insert(member, &zone.bodies);
    }

    pub(crate) fn remove(&mut self, member: Member, zone: &HiddenFootprint) {
        self.eyes.remove(member, &zone.eyes);
        self.bodies.remove(member, &zone.bodies);
    }

    /// Everybody here who, by the sectors, can be seen from a zone or can see into it; in no order,
    /// some twice. An eye there sees a body here; an eye here sees a body there: the PVS is
    /// symmetric.
    pub(crate) fn meeting(
        &self,
        sectors: &Sectors,
        zone: &HiddenFootprint,
        found: &mut Vec<Member>,
    ) {
        for (from, index) in [(&zone.eyes, &self.bodies), (&zone.bodies, &self.eyes)] {
            found.extend(index.among(&sectors.visible_from(from)));
        }
    }
}
