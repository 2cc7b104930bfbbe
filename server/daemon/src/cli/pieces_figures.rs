//! The pieces in which clients fetch a world, for `inspect --pieces`.

use serde::Serialize;
use sightline_compiler::storeys;
use sightline_visibility::streaming;
use sightline_world::{ReadError, World, WorldHead};

/// The pieces of a world, and what may be seen of them from where.
#[derive(Serialize)]
pub struct PiecesFigures {
    head_bytes: usize,
    pieces: usize,
    pieces_bytes: usize,
    largest_piece_bytes: usize,
    branches: usize,
    branch_m: f32,
    /// The mean share of the branches that cannot be seen from a space.
    ruled_out: f64,
    /// The mean share of the cells that cannot be seen from a space.
    cells_ruled_out: f64,
    /// The bytes of the head and of all that may be seen from each spawn point.
    spawn_bytes: Vec<usize>,
}

impl PiecesFigures {
    /// Cuts a world into pieces and measures them.
    ///
    /// # Errors
    /// When the pieces cannot be read again.
    pub fn of(world: &World) -> Result<Self, ReadError> {
        let cut = streaming::pieces_of(world, &storeys(world));
        let head = WorldHead::read(&cut.head)?;
        let (branches, grades) = (head.octree.branches(), usize::from(head.octree.grades()));
        let length = |branch: usize| -> usize {
            let own = cut.pieces.iter().skip(branch * grades).take(grades);
            own.map(Vec::len).sum()
        };
        let bytes_of_all: usize = cut.pieces.iter().map(Vec::len).sum();
        let seen_at = |spawn: &sightline_world::Spawn| {
            let seen = head.seen_from(spawn.eye);
            let bytes = seen.map(|seen| seen.iter().map(|branch| length(branch as usize)).sum());
            cut.head.len() + bytes.unwrap_or(bytes_of_all)
        };
        let seen = head.seen().iter().map(|seen| seen.len() as f64).sum::<f64>();
        Ok(Self {
            head_bytes: cut.head.len(),
            pieces: cut.pieces.len(),
            pieces_bytes: bytes_of_all,
            largest_piece_bytes: cut.pieces.iter().map(Vec::len).max().unwrap_or(0),
            branches,
            branch_m: head.octree.edge_after(0),
            ruled_out: 1.0 - seen / (head.seen().len() * branches).max(1) as f64,
            cells_ruled_out: cells_ruled_out(world),
            spawn_bytes: world.spawns.iter().map(seen_at).collect(),
        })
    }

    /// The figures as a table.
    pub fn table(&self) -> String {
        let mut spawns = self.spawn_bytes.clone();
        spawns.sort_unstable();
        let [least, median, most] = [0, spawns.len() / 2, spawns.len().saturating_sub(1)]
            .map(|at| spawns.get(at).copied().unwrap_or(0));
        let rows = [
            ("head", format!("{} bytes", self.head_bytes)),
            (
                "pieces",
                format!(
                    "{} of {} bytes, the largest of {}",
                    self.pieces, self.pieces_bytes, self.largest_piece_bytes
                ),
            ),
            ("branches", format!("{} of {:.2} m", self.branches, self.branch_m)),
            (
                "  ruled out",
                format!(
                    "{:.1} % from a space; {:.1} % of cells",
                    self.ruled_out * 100.0,
                    self.cells_ruled_out * 100.0
                ),
            ),
            ("seen at a spawn", format!("{least} to {most} bytes, median {median}")),
        ];
        rows.iter().map(|(name, value)| format!("{name:<18} {value}\n")).collect()
    }
}

/// The mean share of the cells that the PVS rules out from a space.
fn cells_ruled_out(world: &World) -> f64 {
    let cells = &world.cells;
    let seen = |space: &sightline_world::Space| {
        let rows = space.cells.clone().filter_map(|cell| cells.pvs.get(cell as usize));
        rows.cloned().reduce(|all, row| all | row).map_or(0.0, |all| all.len() as f64)
    };
    let seen: f64 = cells.spaces.iter().map(seen).sum();
    1.0 - seen / (cells.spaces.len() * cells.cells.len()).max(1) as f64
}
