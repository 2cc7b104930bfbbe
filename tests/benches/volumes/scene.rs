//! A generated building, and volumes around avatars that walk in it.

use std::{fmt, ops::ControlFlow};

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::Serialize;
use sightline_compiler::{CompileOptions, compile, import::glb};
use sightline_demo_building::Plan;
use sightline_world::{CellId, Space, World, geometry::Aabb};

use crate::{
    crowd::{Floors, Pedestrians},
    spaces::SpaceSet,
};

/// The time between two moves of a volume, in seconds.
const STEP_S: f32 = 0.25;
/// Steps before volumes are placed, so that avatars are on their way.
const FIRST_STEPS: usize = 40;
/// Steps in which volumes move.
pub const STEPS: usize = 9;
/// The narrowest and the widest volume, in metres.
const WIDTHS: [f32; 2] = [0.8, 4.0];
/// The widths of the two kinds of regions, in metres.
pub const REGION_WIDTHS: [f32; 2] = [1.0, 6.0];
/// The number of regions of each kind.
const REGIONS: usize = 100;
/// The top and the bottom of a volume or region above the avatar's eye, in metres.
const ENDS: [f32; 2] = [0.4, -1.6];

/// A compiled building, and which of its spaces may see each other.
pub struct Building {
    pub world: World,
    plan: Plan,
    /// For each space, the spaces of which a cell may be visible from one of its cells.
    visible: Vec<SpaceSet>,
}

impl Building {
    pub fn generate(rooms: usize, seed: u64) -> anyhow::Result<Self> {
        let building = sightline_demo_building::build(rooms, seed);
        let model = glb::read_slice(&building.glb, None, "generated")?;
        // It is never drawn, so coarse voxels do.
        let options = CompileOptions { voxel: Some(1.0), ..Default::default() };
        let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
        let cells = &world.cells;
        let mut visible = vec![SpaceSet::new(cells.spaces.len()); cells.spaces.len()];
        for (cell, row) in cells.cells.iter().zip(&cells.pvs) {
            let seen = &mut visible[cell.space as usize];
            row.iter().for_each(|other| seen.insert(cells.cells[other as usize].space));
        }
        Ok(Self { world, plan: building.plan, visible })
    }

    pub fn spaces(&self) -> &[Space] {
        &self.world.cells.spaces
    }

    /// The cells that a box overlaps.
    pub fn cells_of(&self, region: &Aabb) -> Vec<CellId> {
        let mut cells = Vec::new();
        self.world.cells.overlapping(region, &mut cells);
        cells
    }

    /// The spaces that a box overlaps, ascending.
    pub fn spaces_of(&self, region: &Aabb) -> Vec<u32> {
        let space = |cell: &CellId| self.world.cells.cells[cell.0 as usize].space;
        let mut spaces: Vec<u32> = self.cells_of(region).iter().map(space).collect();
        debug_assert!(spaces.is_sorted(), "the cells of a space are contiguous");
        spaces.dedup();
        spaces
    }

    /// The spaces that some of these spaces may see.
    pub fn visible_from(&self, spaces: &[u32]) -> SpaceSet {
        let mut all = SpaceSet::new(self.visible.len());
        spaces.iter().for_each(|space| all.unite(&self.visible[*space as usize]));
        all
    }

    /// The box around some spaces.
    pub fn bounds_of(&self, spaces: &SpaceSet) -> Aabb {
        let bounds = spaces.shared(spaces).map(|space| self.spaces()[space as usize].bounds);
        bounds.reduce(|all, one| all.union(&one)).expect("a space sees itself")
    }

    /// The least corner and the edge of a cube that holds every volume.
    pub fn cube(&self) -> (Vec3, f32) {
        let bounds = self.world.cells.bounds.grown(WIDTHS[1]);
        let edge = bounds.size().max_element();
        (bounds.centre() - edge * 0.5, edge)
    }
}

/// Which volumes move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    Rest,
    Half,
    All,
}

impl Motion {
    fn moves(self, volume: usize) -> bool {
        match self {
            Self::Rest => false,
            Self::Half => volume.is_multiple_of(2),
            Self::All => true,
        }
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Rest => "at rest",
            Self::Half => "half moving",
            Self::All => "moving",
        })
    }
}

/// A volume's number and its new box.
#[derive(Clone, Copy)]
pub struct Move {
    pub volume: u32,
    pub bounds: Aabb,
}

/// Volumes, their moves, and regions to ask for. All boxes are along the building's own axes.
pub struct Scene {
    pub volumes: Vec<Aabb>,
    /// The moves of each step. Avatars that stand still have none.
    pub steps: Vec<Vec<Move>>,
    /// Regions of each width, around avatars drawn at random.
    pub regions: [Vec<Aabb>; 2],
}

impl Scene {
    pub fn new(building: &Building, count: usize, motion: Motion, seed: u64) -> Self {
        let mut seeds = SmallRng::seed_from_u64(seed);
        let widths: Vec<f32> =
            (0..count).map(|_| seeds.random_range(WIDTHS[0]..=WIDTHS[1])).collect();
        let asking: Vec<usize> = (0..REGIONS).map(|_| seeds.random_range(0..count)).collect();
        let mut rng = || SmallRng::seed_from_u64(seeds.random());
        let floors = Floors::new(&building.plan);
        let mut crowd = Pedestrians::new(floors, count, &[], &mut rng);
        (0..FIRST_STEPS).for_each(|_| crowd.step(&building.world, STEP_S));
        let around = |crowd: &Pedestrians, avatar: usize, width: f32| {
            let eye = building.world.cells.axes.own(crowd.walkers[avatar].pose().eye);
            let [above, below] = ENDS;
            let aside = Vec3::new(1.0, 0.0, 1.0) * width * 0.5;
            Aabb::new(eye - aside + Vec3::Y * below, eye + aside + Vec3::Y * above)
        };
        let volumes: Vec<Aabb> = (0..count).map(|i| around(&crowd, i, widths[i])).collect();
        let regions =
            REGION_WIDTHS.map(|width| asking.iter().map(|i| around(&crowd, *i, width)).collect());
        let mut now = volumes.clone();
        let mut step = || {
            crowd.step(&building.world, STEP_S);
            let moves = (0..count).filter(|i| motion.moves(*i)).filter_map(|i| {
                let bounds = around(&crowd, i, widths[i]);
                let before = std::mem::replace(&mut now[i], bounds);
                (bounds != before).then_some(Move { volume: i as u32, bounds })
            });
            moves.collect()
        };
        let steps = (0..STEPS).map(|_| step()).collect();
        Self { volumes, steps, regions }
    }
}
