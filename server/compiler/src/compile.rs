//! The stages of a compilation, in order.

use std::{collections::HashMap, ops::ControlFlow};

use glam::Vec3;
use sightline_oracle::Oracle;
use sightline_world::{
    Cells, Mesh, Pvs, World,
    geometry::{Aabb, Axes},
    light::BakedLight,
};

use crate::{
    carve::{self, CarveOptions, CarvedModel},
    error::CompileError,
    light::{Light, LightFigures, LightMethod, LightQuality},
    model::Model,
    occluders,
    octree_statistics::OctreeStatistics,
    progress::{ProgressRelay, Stage, StageTimer},
    pvs::{self, SpacesSeen},
    report::CompileReport,
    rooms::{self, RoomScope},
    spawn::{self, SpawnPoints},
    subdivide::{self, CellGrain, CellSize, Spaces, SubdivisionInput},
    voxelise,
};

/// The margin around the building in which an eye can be, in metres.
const MARGIN: Vec3 = Vec3::new(4.0, 3.0, 4.0);

/// The cell size is chosen so that about this many pairs of cells see each other. Two cores find
/// them in about ten seconds, and they take about ten megabytes.
const PAIRS_ABOUT: f64 = 2.5e7;
/// `--cell` may ask for about this many pairs: some gigabytes and some minutes.
const PAIRS_MAX: f64 = 1.0e9;
/// Each space adds this many pairs to [`PAIRS_ABOUT`], so that large buildings get no coarser
/// cells.
const PAIRS_PER_SPACE: f64 = 2_000.0;

/// A quick compilation has voxels that are wider by this factor, unless the author chose their
/// size.
const QUICK_VOXEL: f32 = 2.0;

/// How much time a compilation takes for a good world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// A world to keep.
    #[default]
    Fine,
    /// A world to begin with, in a small part of the time: a cell is a whole space, voxels are
    /// twice as wide, and surfaces are not lit. Nobody is missed in it, but more people are told of
    /// each other than in the fine world.
    Quick,
}

/// What the author of a world chooses.
#[derive(Clone, Copy, Debug, Default)]
pub struct CompileOptions {
    /// The edge of a voxel, in metres. When absent, it follows from the building's size.
    pub voxel: Option<f32>,
    /// The width of the widest cell, in metres. When absent, it follows from how much there is to
    /// see.
    pub cell: Option<f32>,
    /// How the model is carved.
    pub carving: CarveOptions,
    /// How a model is lit that brings no light of its own.
    pub light: LightMethod,
    /// How much time radiosity takes.
    pub light_quality: LightQuality,
    /// How much time it takes. What the author chooses above holds for both.
    pub quality: Quality,
}

/// Compiles a model to a world. The same model and options give the same world, on any number of
/// threads.
///
/// `progress` hears the stage and the share of it that is done, from 0 to 1, from any thread. When
/// it breaks, the compilation ends soon.
///
/// # Errors
/// When the model is empty, needs more voxels than fit or has faulty rooms, and when `progress`
/// breaks.
pub fn compile(
    model: &Model,
    options: &CompileOptions,
    progress: &(dyn Fn(Stage, f32) -> ControlFlow<()> + Sync),
) -> Result<(World, CompileReport), CompileError> {
    let relay = ProgressRelay::new(progress);
    let bounds = model.bounds().ok_or(CompileError::Empty)?;
    // What cannot be done is refused before anything is.
    let is_quick = options.quality == Quality::Quick;
    let voxel = options.voxel.unwrap_or_else(|| {
        let fine = voxelise::default_voxel(&model.surfaces, &bounds);
        if is_quick { fine * QUICK_VOXEL } else { fine }
    });
    voxelise::check(&model.surfaces, &bounds, voxel)?;
    let mut timer = StageTimer::default();

    relay.begin(Stage::Carving)?;
    // A model of solids is neither turned nor carved: it was built along the world's axes.
    let has_solids = !model.solids.is_empty();
    let turn = if has_solids { 0.0 } else { carve::dominant_orientation(&model.opaque) };
    let axes = Axes::turned(turn);
    let carved = timer.time(Stage::Carving, || {
        let opaque = if has_solids { &[] } else { model.opaque.as_slice() };
        carved(opaque, &axes, &options.carving, &relay)
    })?;
    relay.begin(Stage::Cells)?;
    let spaces = timer.time(Stage::Cells, || spaces(model, axes, &carved));
    let (mut cells, seen) = timer.time(Stage::Pvs, || cells(&spaces, options, &relay))?;
    // Faults in what the author wrote are told before the long work.
    let scope = RoomScope { cells: &cells, movers: &model.movers, nodes: &model.nodes };
    let rooms = rooms::resolve(&model.rooms, &scope)?;
    cells.pvs = timer.time(Stage::Pvs, || pvs(&cells, &seen, &relay))?;
    let mesh = mesh(&model.opaque);
    let room_warnings =
        rooms::checks::warnings(&model.rooms, &rooms, &cells, &|| Oracle::new(&mesh));
    let method = if model.is_lit || is_quick { LightMethod::None } else { options.light };
    let (light, baked, light_figures) = match method {
        LightMethod::None => (None, None, None),
        LightMethod::Ambient => {
            (Some(timer.time(Stage::Light, || ambient(model, &axes, voxel, &relay))?), None, None)
        }
        LightMethod::Radiosity => {
            let quality = options.light_quality;
            let lit = || radiosity(model, &axes, voxel, quality, &relay);
            let (light, baked, figures) = timer.time(Stage::Light, lit)?;
            (Some(light), Some(baked), Some(figures))
        }
    };
    relay.begin(Stage::Voxels)?;
    let octree = timer.time(Stage::Voxels, || {
        let report = |share| relay.report(Stage::Voxels, share);
        voxelise::voxelise_lit(&model.surfaces, light.as_ref(), &bounds, voxel, &report)
    })?;
    assert_eq!(cells.pvs.len(), cells.cells.len(), "each cell has a row of the PVS");
    assert_eq!(mesh.triangles.len(), model.opaque.len(), "the oracle gets every opaque triangle");
    assert_eq!(rooms.list().len(), model.rooms.len(), "each declared room is resolved");

    let mut world = World {
        title: model.title.clone(),
        spawns: Vec::new(),
        octree,
        cells,
        mesh,
        body: model.body,
        speed_max: model.speed_max,
        movers: model.movers.clone(),
        rooms,
        light: baked,
        origin: model.origin.clone(),
    };
    relay.begin(Stage::Spawns)?;
    let report_spawns = |share| relay.report(Stage::Spawns, share);
    let found = timer
        .time(Stage::Spawns, || spawn::spawn_points(model, &world, &bounds, &report_spawns))
        .ok_or(CompileError::Cancelled)?;
    let SpawnPoints { spawns, warnings } = found;
    world.spawns = spawns;
    let report = CompileReport {
        size_m: bounds.size().to_array(),
        triangles: model.surfaces.iter().map(|s| s.triangles.len()).sum(),
        opaque: model.opaque.len(),
        turn,
        carving: carved.report,
        spaces: world.cells.spaces.len(),
        gates: world.cells.gates.len(),
        cells: world.cells.cells.len(),
        portals: world.cells.portals.len(),
        pvs_density: world.cells.density(),
        movers: model.movers.len(),
        rooms: world.rooms.list().len(),
        windows: world.rooms.list().iter().map(|room| room.windows.len()).sum(),
        spawns: world.spawns.len(),
        warnings,
        room_warnings,
        light: light_figures,
        octree: OctreeStatistics::of(&world.octree),
        seconds: timer.seconds,
        cpu_seconds: timer.cpu_seconds,
    };
    Ok((world, report))
}

/// Carves opaque triangles in the building's own axes.
fn carved(
    opaque: &[[Vec3; 3]],
    axes: &Axes,
    options: &CarveOptions,
    relay: &ProgressRelay<'_>,
) -> Result<CarvedModel, CompileError> {
    let own = |corner: Vec3| axes.own_exact(corner.as_dvec3());
    let triangles: Vec<_> = opaque.iter().map(|corners| corners.map(own)).collect();
    let report = &mut |share| relay.report(Stage::Carving, share);
    let carved = carve::carve_with_progress(&triangles, &[], options, report);
    carved.ok_or(CompileError::Cancelled)
}

/// Splits the space around a carved model along its occluders.
fn spaces(model: &Model, axes: Axes, carved: &CarvedModel) -> Spaces {
    let in_rooms = model.rooms.iter().filter_map(|room| room.spawn);
    let spawns = model.spawns.iter().copied().chain(in_rooms).map(|spawn| spawn.eye);
    let places = spawns.chain(model.places.iter().copied());
    let eyes: Vec<Vec3> = places.map(|place| axes.own(place)).collect();
    let planes = occluders::planes(&occluders::occluder_triangles(carved));
    let input = SubdivisionInput { planes: &planes, solids: &model.solids, eyes: &eyes };
    Spaces::new(&own_bounds(model, &axes), axes, &input)
}

/// The region in which an eye can be, in the building's own axes. Around a turned building, a box
/// along the world's axes would hold much more space.
fn own_bounds(model: &Model, axes: &Axes) -> Aabb {
    let bounds = Aabb::from_points(model.points().map(|point| axes.own(point)));
    Aabb::new(bounds.min - MARGIN, bounds.max + MARGIN)
}

/// Splits spaces into cells, which have no PVS yet. Also returns which spaces see each other.
fn cells(
    spaces: &Spaces,
    options: &CompileOptions,
    relay: &ProgressRelay<'_>,
) -> Result<(Cells, SpacesSeen), CompileError> {
    let whole = subdivide::cells(spaces, CellGrain::Whole);
    let seen = pvs::spaces_seen(&whole, &|share| relay.report(Stage::Pvs, share * 0.1));
    let seen = seen.ok_or(CompileError::Cancelled)?;
    let cells = match options.cell {
        Some(width) => {
            let size = CellSize::of_width(width);
            if pvs::pairs_at(&size, &whole.spaces, &seen) > PAIRS_MAX {
                let enough = pvs::cell_size_for(PAIRS_MAX, &whole.spaces, &seen).width_max.ceil();
                return Err(CompileError::Cells { width, enough });
            }
            subdivide::cells(spaces, CellGrain::Even(size))
        }
        None if options.quality == Quality::Quick => whole,
        None => {
            let pairs = PAIRS_ABOUT + PAIRS_PER_SPACE * whole.spaces.len() as f64;
            let size = pvs::cell_size_for(pairs, &whole.spaces, &seen);
            let see_all = subdivide::see_all(spaces, &seen);
            subdivide::cells(spaces, CellGrain::EvenExcept(size, &see_all))
        }
    };
    Ok((cells, seen))
}

/// Finds the PVS of cells.
fn pvs(cells: &Cells, seen: &SpacesSeen, relay: &ProgressRelay<'_>) -> Result<Pvs, CompileError> {
    let report = |share: f32| relay.report(Stage::Pvs, share);
    let pvs = pvs::potentially_visible(cells, seen, &|share| report(0.2 + share * 0.8));
    let pvs = pvs.ok_or(CompileError::Cancelled)?;
    if report(1.0).is_break() { Err(CompileError::Cancelled) } else { Ok(pvs) }
}

/// The opaque triangles as a mesh that stores equal corners once.
fn mesh(opaque: &[[Vec3; 3]]) -> Mesh {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    for corners in opaque {
        mesh.triangles.push(corners.map(|corner| {
            *known.entry(corner.to_array().map(f32::to_bits)).or_insert_with(|| {
                mesh.positions.push(corner);
                mesh.positions.len() as u32 - 1
            })
        }));
    }
    mesh
}

/// Ambient light on the surfaces.
fn ambient(
    model: &Model,
    axes: &Axes,
    voxel: f32,
    relay: &ProgressRelay<'_>,
) -> Result<Light, CompileError> {
    relay.begin(Stage::Light)?;
    let report = |share| relay.report(Stage::Light, share);
    let light = Light::new(&model.surfaces, &model.opaque, axes.world(Vec3::X), voxel, &report);
    light.ok_or(CompileError::Cancelled)
}

/// Light that surfaces pass on to each other.
fn radiosity(
    model: &Model,
    axes: &Axes,
    voxel: f32,
    quality: LightQuality,
    relay: &ProgressRelay<'_>,
) -> Result<(Light, BakedLight, LightFigures), CompileError> {
    relay.begin(Stage::Light)?;
    let report = |share| relay.report(Stage::Light, share);
    let light = Light::by_radiosity(model, axes.world(Vec3::X), voxel, quality, &report);
    light.ok_or(CompileError::Cancelled)
}

#[cfg(test)]
mod tests;
