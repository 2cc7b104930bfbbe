//! The immutable building: what the engine derives from a world when it is made.

mod adjacency;
mod box_cells;
mod cell_rows;
mod sectors;

use std::sync::Arc;

use glam::Vec3;
use sightline_visibility::{box_visibility::Occluders, rooms::RoomIndex};
use sightline_world::{
    CellId, Cells, World,
    geometry::Axes,
    motion::{Agility, Body},
};

use crate::{
    baselines::Partition,
    claims::{ClaimLimits, Clearance, WalkState, Walkways},
    config::Config,
};

pub(crate) use adjacency::{Adjacency, Beside, Exit, ExitSide};
pub(crate) use box_cells::BoxCells;
pub(crate) use cell_rows::CellRows;
pub(crate) use sectors::Sectors;

/// The world, and what is derived from it once.
#[derive(Clone, Debug)]
pub(crate) struct Building {
    pub(crate) world: Arc<World>,
    /// What is accepted from clients.
    pub(crate) limits: ClaimLimits,
    /// What every body can do.
    pub(crate) agility: Agility,
    /// The box of every body, in own axes.
    pub(crate) body: Body,
    /// What the building's author says about who may see whom.
    pub(crate) rooms: RoomIndex,
    /// What is beside each space.
    pub(crate) adjacency: Adjacency,
    /// Which cells are boxes.
    pub(crate) box_cells: BoxCells,
    /// Which cells see which.
    pub(crate) cell_rows: CellRows,
    pub(crate) sectors: Sectors,
    /// What blocks sight.
    pub(crate) occluders: Arc<Occluders>,
    /// What bounds ways on foot.
    pub(crate) walkways: Walkways,
    /// How a policy for comparison divides the world.
    pub(crate) partition: Partition,
}

impl Building {
    /// Derives all of it; that takes up to some seconds for a large world.
    pub(crate) fn new(world: Arc<World>, config: &Config) -> Self {
        let speed_max = config.speed_max.unwrap_or(world.speed_max);
        let agility = Agility::of(&world.body, speed_max);
        Self {
            limits: ClaimLimits {
                confines: world.confines(),
                speed_max,
                fall_max: agility.fall_max,
                refusals_max: config.refusals_max,
                refusal_window: config.refusal_window,
            },
            agility,
            body: world.body.in_axes(&world.cells.axes),
            rooms: RoomIndex::new(&world),
            adjacency: Adjacency::new(&world.cells),
            box_cells: BoxCells::new(&world.cells),
            cell_rows: CellRows::new(&world.cells),
            sectors: Sectors::new(&world.cells),
            occluders: Arc::new(Occluders::new(&world)),
            walkways: Walkways::new(&world, agility.fall_max / speed_max),
            partition: Partition::new(config.policy, &world),
            world,
        }
    }

    pub(crate) fn cells(&self) -> &Cells {
        &self.world.cells
    }

    /// Whether some point of one cell may be visible from some point of the other.
    pub(crate) fn sees(&self, from: CellId, to: CellId) -> bool {
        self.cell_rows.sees(self.cells(), from, to)
    }

    /// The cell of a point in own axes, which is probably near a certain cell; `None` in something
    /// solid.
    pub(crate) fn cell_at(&self, point: Vec3, likely: Option<CellId>) -> Option<CellId> {
        self.box_cells.at(self.cells(), point, likely)
    }

    /// The axes along which cells and regions lie.
    pub(crate) fn axes(&self) -> &Axes {
        &self.world.cells.axes
    }

    /// The gates that a body fits through; `None` while it is stuck and may go through any.
    pub(crate) fn clearance_of(&self, walk: WalkState) -> Option<&Clearance> {
        self.walkways.clearance_of(walk)
    }
}
