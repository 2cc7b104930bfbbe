//! Which avatars can be where, and which of them can be visible from where.

use sightline_visibility::rooms::{self, RoomIndex};
use sightline_world::{CellId, Cells, World, geometry::Aabb, motion::AvatarId};

use super::{bits::Bits, parts::Parts, population::Slot, reach::Reach};

/// A building has no more sectors, so that who sees whom takes no more than 32 MiB.
const SECTORS_MAX: usize = 1 << 14;

/// The building, coarser than by cells: a sector is a space, or several that follow one another.
/// Regions overlap many cells but few sectors, and shafts decide what sectors leave open.
#[derive(Clone, Debug)]
pub(super) struct Sectors {
    /// For each cell.
    of: Vec<u32>,
    /// How many spaces are one.
    share: u32,
    /// For each, those that have a cell that is visible from one of its own.
    visible: Vec<Bits>,
}

impl Sectors {
    pub(super) fn new(cells: &Cells) -> Self {
        let share = cells.spaces.len().div_ceil(SECTORS_MAX).max(1) as u32;
        let of: Vec<u32> = cells.cells.iter().map(|cell| cell.space / share).collect();
        let count = of.iter().max().map_or(0, |last| *last as usize + 1);
        let mut visible = vec![Bits::default(); count];
        for (sector, row) in of.iter().zip(&cells.pvs) {
            row.iter().for_each(|cell| visible[*sector as usize].insert(of[cell as usize]));
        }
        Self { of, share, visible }
    }

    pub(super) fn len(&self) -> usize {
        self.visible.len()
    }

    /// Those of some cells, ascending.
    pub(super) fn of(&self, cells: &[CellId]) -> Vec<u32> {
        let mut sectors: Vec<u32> = cells.iter().map(|cell| self.of[cell.0 as usize]).collect();
        sectors.sort_unstable();
        sectors.dedup();
        sectors
    }

    /// Whether a space may see another.
    pub(super) fn sees(&self, space: u32, other: u32) -> bool {
        self.visible[(space / self.share) as usize].contains(other / self.share)
    }

    /// All that are visible from some.
    pub(super) fn visible_from(&self, sectors: &[u32]) -> Bits {
        let mut all = Bits::default();
        sectors.iter().for_each(|sector| all.unite(&self.visible[*sector as usize]));
        all
    }
}

/// Where a region is in the building.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    /// A box around it, in own axes.
    pub(super) around: Aabb,
    /// The spaces that it has a part in, ascending; and where the cells of each end.
    pub(super) spaces: Vec<u32>,
    ends: Vec<u32>,
    /// The cells, ascending: those of a space follow one another.
    cells: Vec<CellId>,
    /// What of it is in which rooms; empty where rooms rule nothing out.
    rooms: rooms::RoomOverlap,
}

impl Ground {
    /// Of boxes in some cells, which are ascending.
    pub(super) fn of(cells: &Cells, rooms: &RoomIndex, found: Vec<CellId>, parts: &Parts) -> Self {
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
    pub(super) fn cells(&self) -> &[CellId] {
        &self.cells
    }

    /// Whether rooms let somebody with an eye here see somebody whose body is in another.
    pub(super) fn shows(&self, bodies: &Self, rooms: &RoomIndex) -> bool {
        !rooms.rules() || rooms.may_see(&self.rooms, &bodies.rooms)
    }

    /// Adds what can be seen from some of its cells.
    pub(super) fn see(&self, world: &Cells, of: impl Fn(CellId) -> bool, seen: &mut Bits) {
        for cell in self.cells.iter().filter(|cell| of(**cell)) {
            let mut row = world.pvs[cell.0 as usize].iter();
            while let Some(range) = row.next_range() {
                seen.insert_range(range);
            }
        }
    }

    /// Whether it has some of these cells.
    pub(super) fn is_among(&self, seen: &Bits) -> bool {
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
    pub(super) fn sees(&self, other: &Self, world: &Cells, sectors: &Sectors) -> bool {
        self.by_space().any(|(here, some)| {
            other.by_space().any(|(there, others)| {
                let sees = |from: &CellId| others.iter().any(|to| world.sees(*from, *to));
                sectors.sees(here, there) && some.iter().any(sees)
            })
        })
    }
}

/// The rooms of a region's boxes in some cells, which are ascending, where rooms rule anything out.
fn place(rooms: &RoomIndex, cells: &Cells, parts: &Parts, found: &[CellId]) -> rooms::RoomOverlap {
    if rooms.rules() {
        rooms.overlap_in_cells(cells, parts.boxes(), found)
    } else {
        rooms::RoomOverlap::default()
    }
}

/// Where an avatar can be during some time.
#[derive(Clone, Debug, PartialEq, Default)]
pub(super) struct Zone {
    /// The sectors that its eye can be in, ascending.
    eyes: Vec<u32>,
    /// The sectors that any part of its body can be in, ascending.
    bodies: Vec<u32>,
    /// Around all places of its eye, and around all of its body.
    pub(super) parts: [Parts; 2],
    /// The rooms of both.
    rooms: [rooms::RoomOverlap; 2],
}

impl Zone {
    /// The zone of an avatar that stays within reach.
    pub(super) fn of(reach: &Reach, world: &World, rooms: &RoomIndex, sectors: &Sectors) -> Self {
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
    pub(super) fn of_box(eyes: &Aabb, world: &World, rooms: &RoomIndex, sectors: &Sectors) -> Self {
        let boxes = [*eyes, world.body.in_axes(&world.cells.axes).around_box(eyes)];
        let cells = boxes.map(|region| {
            let mut found = Vec::new();
            world.cells.overlapping(&region, &mut found);
            found.sort_unstable();
            found
        });
        let [eyes, bodies] = [0, 1].map(|at: usize| sectors.of(&cells[at]));
        let parts = boxes.map(|part| Parts::covering([part].into_iter()));
        let rooms = [0, 1].map(|at: usize| place(rooms, &world.cells, &parts[at], &cells[at]));
        Self { eyes, bodies, parts, rooms }
    }

    /// What of it is in a box for the eyes and one for the bodies.
    pub(super) fn within(&self, boxes: [Aabb; 2]) -> Self {
        Self { parts: self.parts_within(boxes), ..self.clone() }
    }

    /// What of its parts is in a box for the eyes and one for the bodies.
    pub(super) fn parts_within(&self, boxes: [Aabb; 2]) -> [Parts; 2] {
        [0, 1].map(|at: usize| self.parts[at].within(&boxes[at]))
    }

    /// Whether rooms let somebody here see somebody there.
    pub(super) fn shows(&self, other: &Self, rooms: &RoomIndex) -> bool {
        !rooms.rules() || rooms.may_see(&self.rooms[0], &other.rooms[1])
    }
}

/// An avatar, and where it is kept. Ordered by id.
pub(super) type Member = (AvatarId, Slot);

/// For each sector, or each cell, who can be in it.
#[derive(Clone, Debug)]
pub(super) struct SectorIndex {
    members: Vec<Vec<Member>>,
    occupied: Bits,
}

impl SectorIndex {
    pub(super) fn new(sectors: usize) -> Self {
        Self { members: vec![Vec::new(); sectors], occupied: Bits::default() }
    }

    /// Everybody who can be in some sectors; those in several more than once.
    pub(super) fn among<'a>(&'a self, sectors: &'a Bits) -> impl Iterator<Item = &'a Member> {
        sectors.shared(&self.occupied).flat_map(|sector| &self.members[sector as usize])
    }

    pub(super) fn insert(&mut self, member: Member, sectors: &[u32]) {
        for &sector in sectors {
            let members = &mut self.members[sector as usize];
            if members.is_empty() {
                self.occupied.insert(sector);
            }
            members.push(member);
        }
    }

    pub(super) fn remove(&mut self, member: Member, sectors: &[u32]) {
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
    pub(super) fn replace(&mut self, member: Member, old: &[u32], new: &[u32]) {
        let others = |these: &[u32], those: &[u32]| -> Vec<u32> {
            these.iter().filter(|at| those.binary_search(at).is_err()).copied().collect()
        };
        self.remove(member, &others(old, new));
        self.insert(member, &others(new, old));
    }
}

/// The zones of many avatars.
#[derive(Clone, Debug)]
pub(super) struct ZoneIndex {
    eyes: SectorIndex,
    bodies: SectorIndex,
}

impl ZoneIndex {
    pub(super) fn new(sectors: usize) -> Self {
        Self { eyes: SectorIndex::new(sectors), bodies: SectorIndex::new(sectors) }
    }

    pub(super) fn insert(&mut self, member: Member, zone: &Zone) {
        self.eyes.insert(member, &zone.eyes);
        self.bodies.insert(member, &zone.bodies);
    }

    pub(super) fn remove(&mut self, member: Member, zone: &Zone) {
        self.eyes.remove(member, &zone.eyes);
        self.bodies.remove(member, &zone.bodies);
    }

    /// Everybody here who, by the sectors, can be seen from a zone or can see into it; in no order,
    /// some twice. An eye there sees a body here; an eye here sees a body there: the PVS is
    /// symmetric.
    pub(super) fn meeting(&self, sectors: &Sectors, zone: &Zone, found: &mut Vec<Member>) {
        for (from, index) in [(&zone.eyes, &self.bodies), (&zone.bodies, &self.eyes)] {
            found.extend(index.among(&sectors.visible_from(from)));
        }
    }
}
