//! A world in pieces: the head, and the grades of the octree's branches.
//!
//! | bytes of a head | content |
//! | --- | --- |
//! | 0..4 | magic: `SLH` and a line feed |
//! | 4..8 | version of heads |
//! | then | the sections `WRLD`, `TRNK`, `TABL`, `VIEW` and `PLAN` |
//!
//! `WRLD` is a world file without voxels and without what clients do not need. `TRNK` is the
//! octree's trunk. `TABL` has, for each piece, the first 16 bytes of its BLAKE3 hash, and its
//! length. `VIEW` has the viewpoints and what may be seen from each, in a zstd frame. `PLAN` has the
//! height of the soles, in metres, on each storey of which there is a plan. The pieces are numbered
//! by branch, and within a branch by grade. The plans follow.

use std::{fmt, sync::Arc};

use glam::Vec3;
use roaring::RoaringBitmap;

use super::{
    ReadError,
    cells::{put_tree, read_tree},
    list,
    reader::SectionReader,
    writer::{put_count, put_f32, put_u32, section},
};
use crate::{
    cells::{CellId, Cells, Node},
    geometry::Axes,
    mesh::Mesh,
    octree::{
        Octree,
        pieces::{OctreePieces, PartialOctree},
    },
    packing::{self, Unpacker},
    plan::{self, Plan},
    world::World,
};

const HEAD_MAGIC: [u8; 4] = *b"SLH\n";
/// Greater than the versions of world files whose heads had none of their own.
pub(super) const HEAD_VERSION: u32 = 8;

/// The most bytes of `VIEW` unpacked: 64 MiB. With more, all may be seen from everywhere.
const VIEW_BYTES_MAX: usize = 1 << 26;

/// Higher levels take much longer and gain little.
const ZSTD_LEVEL: i32 = 9;

/// The content id of a piece: the first 16 bytes of its BLAKE3 hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PieceId(pub [u8; 16]);

impl PieceId {
    /// The content id of these bytes.
    pub fn of(piece: &[u8]) -> Self {
        let mut id = [0; 16];
        id.copy_from_slice(&blake3::hash(piece).as_bytes()[..16]);
        Self(id)
    }
}

impl fmt::Display for PieceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The boxes of eyes for which it is known what they see: the spaces of a building.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoints {
    axes: Axes,
    /// As in [`Cells::tree`], with viewpoints in place of cells.
    tree: Vec<Node>,
    /// The space of each viewpoint.
    spaces: Vec<u32>,
}

impl Viewpoints {
    /// The spaces of a building. A space of which parts lie apart in the tree is several
    /// viewpoints.
    pub fn of(cells: &Cells) -> Self {
        // The space that is all of what is below a node; `u32::MAX` where there is none.
        const SOLID: u32 = u32::MAX;
        let mut uniform: Vec<Option<u32>> = vec![None; cells.tree.len()];
        for (index, node) in cells.tree.iter().enumerate().rev() {
            uniform[index] = match *node {
                Node::Leaf(cell) => Some(cells.cells[cell.0 as usize].space),
                Node::Solid => Some(SOLID),
                Node::Axial { sides: [a, b], .. } | Node::Plane { sides: [a, b], .. } => {
                    uniform[a as usize].filter(|_| uniform[a as usize] == uniform[b as usize])
                }
            };
        }
        let (mut tree, mut spaces) = (Vec::new(), Vec::new());
        // A node, and where its number is to be noted.
        let mut waiting = vec![(0, None)];
        while let Some((index, parent)) = waiting.pop() {
            let own = tree.len() as u32;
            if let Some((parent, side)) = parent
                && let Some(Node::Axial { sides, .. } | Node::Plane { sides, .. }) =
                    tree.get_mut::<usize>(parent)
            {
                sides[usize::from(side)] = own;
            }
            let node = cells.tree[index as usize];
            tree.push(match (uniform[index as usize], node) {
                (Some(SOLID), _) => Node::Solid,
                (Some(space), _) => {
                    spaces.push(space);
                    Node::Leaf(CellId(spaces.len() as u32 - 1))
                }
                (None, node) => node,
            });
            if uniform[index as usize].is_none()
                && let Node::Axial { sides, .. } | Node::Plane { sides, .. } = node
            {
                waiting.extend([1, 0].map(|side| (sides[side], Some((own as usize, side == 1)))));
            }
        }
        Self { axes: cells.axes, tree, spaces }
    }

    /// The number of viewpoints.
    pub fn len(&self) -> usize {
        self.spaces.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.spaces.is_empty()
    }

    /// The space that each viewpoint is, as an index into [`Cells::spaces`].
    pub fn spaces(&self) -> &[u32] {
        &self.spaces
    }

    /// The viewpoint that an eye is in, given in the world's axes. `None` in what is solid.
    pub fn at(&self, eye: Vec3) -> Option<usize> {
        let eye = self.axes.own(eye);
        let mut node = 0;
        loop {
            let (is_greater, sides) = match *self.tree.get(node)? {
                Node::Leaf(viewpoint) => return Some(viewpoint.0 as usize),
                Node::Solid => return None,
                Node::Axial { axis, at, sides } => (eye[usize::from(axis)] >= at, sides),
                Node::Plane { normal, distance, sides } => {
                    (normal.dot(eye.as_dvec3()) >= distance, sides)
                }
            };
            node = sides[usize::from(is_greater)] as usize;
        }
    }
}

/// A world in pieces, as a server hands them out.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldPieces {
    /// The head.
    pub head: Vec<u8>,
    /// All other pieces, by number.
    pub pieces: Vec<Vec<u8>>,
}

impl WorldPieces {
    /// Puts the pieces of a world together. `seen` has, for each viewpoint, the branches of the
    /// octree that may be seen from it. `plans` are those of the storeys that clients can have.
    pub fn new(
        world: &World,
        octree: OctreePieces,
        viewpoints: &Viewpoints,
        seen: &[RoaringBitmap],
        plans: &[Plan],
    ) -> Self {
        debug_assert_eq!(viewpoints.len(), seen.len(), "a set for each viewpoint");
        let branches = octree.branches.len();
        let mut pieces: Vec<Vec<u8>> = octree.branches.into_iter().flatten().collect();
        pieces.extend(plans.iter().map(Plan::to_bytes));
        let mut table = Vec::new();
        put_count(&mut table, pieces.len());
        for piece in &pieces {
            table.extend_from_slice(&PieceId::of(piece).0);
            put_u32(&mut table, u32::try_from(piece.len()).unwrap_or(u32::MAX));
        }
        let mut head = HEAD_MAGIC.to_vec();
        put_u32(&mut head, HEAD_VERSION);
        section(&mut head, b"WRLD", &without_voxels(world).to_bytes());
        section(&mut head, b"TRNK", &octree.trunk);
        section(&mut head, b"TABL", &table);
        let view = packing::pack(&view_bytes(viewpoints, seen, branches), ZSTD_LEVEL);
        section(&mut head, b"VIEW", &view);
        let mut storeys = Vec::new();
        put_count(&mut storeys, plans.len());
        plans.iter().for_each(|plan| put_f32(&mut storeys, plan.soles()));
        section(&mut head, b"PLAN", &storeys);
        Self { head, pieces }
    }
}

/// What a client needs of a world beside its voxels. Without rooms the cells say nothing to it.
fn without_voxels(world: &World) -> World {
    let bounds = world.cells.bounds;
    let cells = match world.rooms.list().is_empty() {
        true => Cells { axes: world.cells.axes, ..Cells::whole(bounds) },
        false => world.cells.clone(),
    };
    let Octree { origin, edge, depth, .. } = world.octree;
    World {
        octree: Octree::empty(origin, edge, depth),
        cells,
        mesh: Mesh::default(),
        origin: None,
        title: world.title.clone(),
        movers: world.movers.clone(),
        rooms: world.rooms.clone(),
        light: world.light.clone(),
        spawns: world.spawns.clone(),
        ..*world
    }
}

/// The viewpoints, and a bit for each branch that may be seen from each.
fn view_bytes(viewpoints: &Viewpoints, seen: &[RoaringBitmap], branches: usize) -> Vec<u8> {
    let mut out = Vec::new();
    put_count(&mut out, viewpoints.len());
    put_tree(&mut out, &viewpoints.tree);
    let row_bytes = branches.div_ceil(8);
    if out.len() + row_bytes * seen.len() > VIEW_BYTES_MAX {
        return Vec::new();
    }
    for set in seen {
        let mut row = vec![0u8; row_bytes];
        for branch in set {
            if let Some(byte) = row.get_mut(branch as usize / 8) {
                *byte |= 1 << (branch % 8);
            }
        }
        out.extend(row);
    }
    out
}

/// The head of a world: what a client has before it has any other piece.
#[derive(Clone, Debug)]
pub struct WorldHead {
    /// The world without mesh. Its octree is empty: see [`WorldHead::octree`].
    pub world: Arc<World>,
    /// The octree, of which the trunk is here.
    pub octree: PartialOctree,
    /// The ids and lengths of the pieces.
    table: Vec<(PieceId, u32)>,
    viewpoints: Viewpoints,
    seen: Vec<RoaringBitmap>,
    /// The height of the soles on each storey with a plan, in metres.
    storeys: Vec<f32>,
}

impl WorldHead {
    /// Reads a head. Any bytes give a valid head or an error.
    ///
    /// # Errors
    /// When the bytes are not exactly one head.
    pub fn read(head: &[u8]) -> Result<Self, ReadError> {
        let mut input = SectionReader::new(head);
        if input.take(4).ok() != Some(&HEAD_MAGIC) {
            return Err(ReadError::NotAWorld);
        }
        let found = input.u32()?;
        if found != HEAD_VERSION {
            return Err(ReadError::HeadVersion { found });
        }
        let world = World::from_bytes(input.section(b"WRLD")?.rest())?;
        let octree = PartialOctree::new(input.section(b"TRNK")?.rest())?;
        let mut rows = input.section(b"TABL")?;
        let mut table = list(rows.count(20)?)?;
        for _ in 0..table.capacity() {
            let mut id = [0; 16];
            id.copy_from_slice(rows.take(16)?);
            table.push((PieceId(id), rows.u32()?));
        }
        let view = unpack(input.section(b"VIEW")?.rest())?;
        let (viewpoints, seen) = read_view(&view, world.cells.axes, octree.branches())?;
        let storeys = read_storeys(&mut input.section(b"PLAN")?)?;
        let grades = usize::from(octree.grades());
        if !rows.is_empty() || table.len() != octree.branches() * grades + storeys.len() {
            return Err(ReadError::Malformed("the table of pieces"));
        }
        if !input.is_empty() {
            return Err(ReadError::Malformed("bytes after the last section"));
        }
        Ok(Self { world: Arc::new(world), octree, table, viewpoints, seen, storeys })
    }

    /// The id and the length in bytes of a piece, if there is one of this number.
    pub fn piece(&self, number: usize) -> Option<(PieceId, u32)> {
        self.table.get(number).copied()
    }

    /// The number of pieces.
    pub fn pieces(&self) -> usize {
        self.table.len()
    }

    /// The number of the piece that is the plan of the storey of a body with its soles at this
    /// height, in metres, if there is one.
    pub fn plan_at(&self, soles: f32) -> Option<usize> {
        let off = |storey: f32| (storey - soles).abs();
        let nearest =
            self.storeys.iter().enumerate().min_by(|a, b| off(*a.1).total_cmp(&off(*b.1)));
        let (index, _) = nearest.filter(|(_, storey)| plan::is_on_storey(**storey, soles))?;
        Some(self.first_plan() + index)
    }

    /// The number of the first piece that is a plan. Those before are of the octree.
    pub fn first_plan(&self) -> usize {
        self.table.len() - self.storeys.len()
    }

    /// The branches that may be seen, for each space; empty where nothing is known.
    pub fn seen(&self) -> &[RoaringBitmap] {
        &self.seen
    }

    /// The branches that may be seen from where an eye is. `None` where nothing is known of it:
    /// then all may be seen.
    pub fn seen_from(&self, eye: Vec3) -> Option<&RoaringBitmap> {
        self.seen.get(self.viewpoints.at(eye)?)
    }
}

fn read_storeys(input: &mut SectionReader<'_>) -> Result<Vec<f32>, ReadError> {
    let mut storeys = list(input.count(4)?)?;
    for _ in 0..storeys.capacity() {
        storeys.push(input.f32()?);
    }
    if input.is_empty() { Ok(storeys) } else { Err(ReadError::Malformed("the storeys")) }
}

fn unpack(packed: &[u8]) -> Result<Vec<u8>, ReadError> {
    use std::io::Read as _;
    let bad = |_| ReadError::Malformed("the viewpoints");
    let mut bytes = Vec::new();
    let limited = Unpacker::new(packed).map_err(bad)?;
    limited.take(VIEW_BYTES_MAX as u64 + 1).read_to_end(&mut bytes).map_err(bad)?;
    if bytes.len() > VIEW_BYTES_MAX {
        return Err(ReadError::Malformed("the viewpoints"));
    }
    Ok(bytes)
}

fn read_view(
    bytes: &[u8],
    axes: Axes,
    branches: usize,
) -> Result<(Viewpoints, Vec<RoaringBitmap>), ReadError> {
    let none = Viewpoints { axes, tree: Vec::new(), spaces: Vec::new() };
    if bytes.is_empty() {
        return Ok((none, Vec::new()));
    }
    let mut input = SectionReader::new(bytes);
    let count = input.count(1)?;
    let tree = read_tree(&mut input, count)?;
    let row_bytes = branches.div_ceil(8);
    if input.len() != row_bytes.saturating_mul(count) {
        return Err(ReadError::Malformed("the viewpoints"));
    }
    let mut seen = list(count)?;
    for _ in 0..count {
        let row = input.take(row_bytes)?;
        let is_set = |branch: &u32| {
            row.get(*branch as usize / 8).is_some_and(|byte| byte >> (branch % 8) & 1 == 1)
        };
        seen.push((0..branches as u32).filter(is_set).collect());
    }
    // A client does not ask which space a viewpoint is.
    let spaces = (0..count as u32).collect();
    Ok((Viewpoints { spaces, tree, ..none }, seen))
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::{
        Spawn,
        cells::{Cell, Space},
        geometry::Aabb,
        motion::Body,
        octree::{Voxel, morton},
        rooms::Rooms,
    };

    /// A hall that is cut into two spaces at x = 8, the second one into two cells at z = 8, above
    /// a floor of voxels.
    fn world() -> World {
        let part = |x: [f32; 2], z: [f32; 2]| {
            Aabb::new(Vec3::new(x[0], 0.0, z[0]), Vec3::new(x[1], 4.0, z[1]))
        };
        let cells = [
            part([0.0, 8.0], [0.0, 16.0]),
            part([8.0, 16.0], [0.0, 8.0]),
            part([8.0, 16.0], [8.0, 16.0]),
        ];
        let cell = |(i, bounds): (usize, &Aabb)| Cell {
            bounds: *bounds,
            space: i.min(1) as u32,
            portals: Vec::new(),
        };
        let voxels = (0..128 * 128).map(|i| Voxel {
            key: morton(UVec3::new(i % 128, 0, i / 128)),
            colour: [(i % 128) as u8, 9, 9],
            ..Voxel::default()
        });
        World {
            title: "a hall".to_owned(),
            octree: Octree::from_voxels(Vec3::ZERO, 0.125, 7, voxels.collect()).expect("small"),
            cells: Cells {
                axes: Axes::WORLD,
                bounds: part([0.0, 16.0], [0.0, 16.0]),
                tree: vec![
                    Node::Axial { axis: 0, at: 8.0, sides: [1, 2] },
                    Node::Leaf(CellId(0)),
                    Node::Axial { axis: 2, at: 8.0, sides: [3, 4] },
                    Node::Leaf(CellId(1)),
                    Node::Leaf(CellId(2)),
                ],
                cells: cells.iter().enumerate().map(cell).collect(),
                portals: Vec::new(),
                spaces: vec![
                    Space { bounds: cells[0], cells: 0..1, gates: Vec::new() },
                    Space {
                        bounds: part([8.0, 16.0], [0.0, 16.0]),
                        cells: 1..3,
                        gates: Vec::new(),
                    },
                ],
                gates: Vec::new(),
                pvs: vec![RoaringBitmap::from_iter(0..3); 3],
            },
            mesh: Mesh::default(),
            movers: Vec::new(),
            rooms: Rooms::default(),
            light: None,
            spawns: vec![Spawn { eye: Vec3::new(4.0, 1.6, 4.0), yaw: 0.0 }],
            body: Body::PERSON,
            speed_max: 3.0,
            origin: None,
        }
    }

    fn pieces() -> WorldPieces {
        let world = world();
        let (octree, viewpoints) = (world.octree.to_pieces(), Viewpoints::of(&world.cells));
        let seen = [RoaringBitmap::from_iter([0, 2]), RoaringBitmap::from_iter([1, 3, 9])];
        WorldPieces::new(&world, octree, &viewpoints, &seen, &plans(&world))
    }

    fn plans(world: &World) -> [Plan; 2] {
        [0.125, 8.0].map(|soles| Plan::new(world, soles))
    }

    #[test]
    fn a_head_says_what_a_space_sees_and_what_the_pieces_are() {
        let (world, pieces) = (world(), pieces());
        let mut head = WorldHead::read(&pieces.head).unwrap();
        assert_eq!(head.world.spawns, world.spawns);
        assert_eq!(head.world.bounds(), world.bounds());
        let seen = |x: f32, z: f32| head.seen_from(Vec3::new(x, 1.0, z)).map(RoaringBitmap::len);
        assert_eq!([seen(1.0, 9.0), seen(9.0, 1.0), seen(9.0, 15.0)], [Some(2), Some(3), Some(3)]);
        assert_eq!(head.pieces(), pieces.pieces.len());
        let grades = usize::from(head.octree.grades());
        for (number, piece) in pieces.pieces.iter().enumerate() {
            assert_eq!(head.piece(number), Some((PieceId::of(piece), piece.len() as u32)));
            if number < head.first_plan() {
                head.octree.grow(number / grades, piece).unwrap();
            }
        }
        for (plan, soles) in plans(&world).iter().zip([0.5, 7.5]) {
            let number = head.plan_at(soles).expect("its storey");
            assert_eq!(&Plan::from_bytes(&pieces.pieces[number]).unwrap(), plan);
        }
        assert_eq!(head.plan_at(3.0), None, "between storeys");
        assert!(head.octree.is_complete() && head.piece(pieces.pieces.len()).is_none());
        assert_eq!(PieceId::of(b"").to_string(), "af1349b9f5f9a1a6a0404dea36dcc949");
    }

    #[test]
    fn spaces_are_the_leaves_of_the_viewpoints() {
        let viewpoints = Viewpoints::of(&world().cells);
        assert_eq!((viewpoints.len(), viewpoints.spaces()), (2, [0, 1].as_slice()));
        assert_eq!(viewpoints.tree.len(), 3);
    }

    proptest! {
        #[test]
        fn a_damaged_head_is_refused_or_sound(
            at in any::<prop::sample::Index>(),
            flip in 1u8..,
            eye in prop::array::uniform3(-99f32..99.0),
        ) {
            let mut head = pieces().head;
            prop_assert!(WorldHead::read(&head[..at.index(head.len())]).is_err());
            let at = at.index(head.len());
            head[at] ^= flip;
            if let Ok(head) = WorldHead::read(&head) {
                let seen = head.seen_from(eye.into());
                prop_assert!(seen.is_none_or(|seen| seen.max() < Some(head.octree.branches() as u32)));
            }
        }
    }
}
