//! From a model to a world: carving → occluders → cells and portals → PVS, and all surfaces →
//! voxels.
//!
//! * [`model`]: what an importer makes; [`glb`], [`bsp`] and [`demo_building`] make one.
//! * [`carve`]: polygons, and the model without those that are not axial.
//! * [`rooms`]: what an author knows about the building.
//! * [`occluders`]: which surfaces make cells. [`subdivide`]: cells and portals. [`pvs`]: who sees
//!   whom. `light`: for models that bring none. [`voxelise`]: what clients draw.

use std::{
    borrow::Cow,
    collections::HashMap,
    ops::ControlFlow,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
    time::Instant,
};

use cpu_time::ProcessTime;
use glam::Vec3;
use model::{Model, Surface};
use serde::Serialize;
use sightline_world::{
    Cell, Cells, Mesh, Spawn, World,
    geometry::{Aabb, Axes},
    rooms::Rooms,
};

use crate::octree_statistics::OctreeStatistics;
use sightline_oracle::Oracle;
use subdivide::{CellSize, Spaces, SubdivisionInput};

pub mod carve;
pub mod carve_preview;
pub mod import;
mod light;
pub mod model;
pub mod occluders;
pub mod octree_statistics;
pub mod plan;
pub mod pvs;
pub mod rooms;
pub mod subdivide;
pub mod suggest;
pub mod verify;
pub mod voxelise;

/// Around the building there is this much space in which an eye can be, in metres.
const MARGIN: Vec3 = Vec3::new(4.0, 3.0, 4.0);

/// What the compiler is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Stage {
    /// Merging polygons, and carving out what is not axial.
    Carving,
    /// Splitting along the occluders, and finding portals.
    Cells,
    /// Propagating sight lines.
    Pvs,
    /// Finding the light, when the model brings none.
    Light,
    /// Turning surfaces into voxels.
    Voxels,
}

impl Stage {
    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Self::Carving => "carving",
            Self::Cells => "cells and portals",
            Self::Pvs => "sight lines",
            Self::Light => "light",
            Self::Voxels => "voxels",
        }
    }
}

/// What the author chooses.
#[derive(Clone, Copy, Debug, Default)]
pub struct CompileOptions {
    /// The edge of a voxel, in metres; chosen by the building's size when absent.
    pub voxel: Option<f32>,
    /// The width of the widest cell, in metres; chosen by how much there is to see when absent.
    pub cell: Option<f32>,
    /// How models are carved.
    pub carving: carve::CarveOptions,
}

/// Cells are as fine as lets about so many pairs of them see each other. These take some ten
/// seconds to find on two cores, and some ten megabytes to keep …
const PAIRS_ABOUT: f64 = 2.5e7;
/// … and so many more for each space, so that large buildings are not coarser than small ones.
const PAIRS_A_SPACE: f64 = 2_000.0;

/// Why a model makes no world.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// Nothing to draw and nothing that blocks sight.
    #[error("the model has no triangles")]
    Empty,
    /// The progress callback said so.
    #[error("cancelled")]
    Cancelled,
    /// See the cause.
    #[error(transparent)]
    Voxels(voxelise::VoxeliseError),
    /// Rooms that make no sense.
    #[error(transparent)]
    Rooms(#[from] rooms::RoomErrors),
}

impl From<voxelise::VoxeliseError> for CompileError {
    fn from(error: voxelise::VoxeliseError) -> Self {
        match error {
            voxelise::VoxeliseError::Cancelled => Self::Cancelled,
            other => Self::Voxels(other),
        }
    }
}

/// What a compilation did.
#[derive(Clone, Debug, Serialize)]
pub struct CompileReport {
    /// All that are drawn.
    pub triangles: usize,
    /// Opaque triangles, all of which the oracle traces.
    pub opaque: usize,
    /// The angle about the vertical by which most walls are turned, in radians.
    pub turn: f64,
    /// What carving did, in axes turned by that angle.
    pub carving: carve::CarveReport,
    /// Convex parts of the building between occluders.
    pub spaces: usize,
    /// Where they join.
    pub gates: usize,
    /// Cells.
    pub cells: usize,
    /// Portals.
    pub portals: usize,
    /// The part of all pairs of cells that the PVS holds, from 0 to 1.
    pub pvs_density: f64,
    /// What moves by itself.
    pub movers: usize,
    /// What the author declared.
    pub rooms: usize,
    /// All windows of these.
    pub windows: usize,
    /// What of the rooms was probably not meant.
    pub room_warnings: Vec<rooms::RoomError>,
    /// The octree that clients draw.
    #[serde(flatten)]
    pub octree: OctreeStatistics,
    /// Wall-clock time for each stage.
    pub seconds: Vec<(Stage, f64)>,
    /// What all threads of the process together worked during each stage; empty where the system
    /// does not tell.
    pub cpu_seconds: Vec<(Stage, f64)>,
}

/// Compiles a model. `progress` is told the stage and its share done, from 0 to 1, from any thread;
/// when it breaks, the compilation ends soon.
///
/// # Errors
/// When the model is empty or needs more voxels than fit, and when `progress` breaks.
pub fn compile(
    model: &Model,
    options: &CompileOptions,
    progress: &(dyn Fn(Stage, f32) -> ControlFlow<()> + Sync),
) -> Result<(World, CompileReport), CompileError> {
    let listener = Listener { progress, cancelled: AtomicBool::new(false) };
    let bounds = model.bounds().ok_or(CompileError::Empty)?;
    let mut watch = Watch::default();

    listener.tell(Stage::Carving, 0.0)?;
    let has_solids = !model.solids.is_empty();
    // Solids are split along as they are, in the axes in which they were built.
    let turn = if has_solids { 0.0 } else { carve::dominant_orientation(&model.opaque) };
    let axes = Axes::turned(turn);
    let space = own_space(model, &axes);
    let carved = watch
        .time(Stage::Carving, || {
            let own = |corner: Vec3| axes.own_exact(corner.as_dvec3());
            let surfaces = if has_solids { &[] } else { model.opaque.as_slice() };
            let triangles: Vec<_> = surfaces.iter().map(|corners| corners.map(own)).collect();
            let hear = &mut |share| listener.hear(Stage::Carving, share);
            carve::carve_with_progress(&triangles, &[], &options.carving, hear)
        })
        .ok_or(CompileError::Cancelled)?;
    listener.tell(Stage::Cells, 0.0)?;
    let places = model.spawns.iter().map(|spawn| spawn.eye).chain(model.places.iter().copied());
    let eyes: Vec<Vec3> = places.map(|place| axes.own(place)).collect();
    let spaces = watch.time(Stage::Cells, || {
        let planes = occluders::planes(&opaque(&carved));
        let occluders = SubdivisionInput { planes: &planes, solids: &model.solids, eyes: &eyes };
        Spaces::new(&space, axes, &occluders)
    });
    let cells = watch.time(Stage::Pvs, || sight_lines(&spaces, options.cell, &listener))?;
    let mesh = mesh(&model.opaque);
    let (rooms, room_warnings) = rooms_of(model, &cells, &mesh)?;
    let voxel = options.voxel.unwrap_or_else(|| voxelise::default_voxel(&model.surfaces, &bounds));
    let lit = watch.time(Stage::Light, || lit(model, voxel, &listener))?;
    listener.tell(Stage::Voxels, 0.0)?;
    let octree = watch.time(Stage::Voxels, || {
        voxelise::voxelise(&lit, &bounds, voxel, &|share| listener.hear(Stage::Voxels, share))
    })?;

    let report = CompileReport {
        triangles: model.surfaces.iter().map(|s| s.triangles.len()).sum(),
        opaque: model.opaque.len(),
        turn,
        carving: carved.report,
        spaces: cells.spaces.len(),
        gates: cells.gates.len(),
        cells: cells.cells.len(),
        portals: cells.portals.len(),
        pvs_density: cells.density(),
        movers: model.movers.len(),
        rooms: rooms.list().len(),
        windows: rooms.list().iter().map(|room| room.windows.len()).sum(),
        room_warnings,
        octree: OctreeStatistics::of(&octree),
        seconds: watch.seconds,
        cpu_seconds: watch.cpu_seconds,
    };
    let spawns = if model.spawns.is_empty() {
        vec![find_spawn(model, &cells, &mesh)]
    } else {
        model.spawns.clone()
    };
    let world = World {
        title: model.title.clone(),
        octree,
        cells,
        mesh,
        spawns,
        body: model.body,
        speed_max: model.speed_max,
        movers: model.movers.clone(),
        rooms,
        origin: model.origin.clone(),
    };
    Ok((world, report))
}

/// The rooms that the model declares, and what of them was probably not meant.
fn rooms_of(
    model: &Model,
    cells: &Cells,
    mesh: &Mesh,
) -> Result<(Rooms, Vec<rooms::RoomError>), rooms::RoomErrors> {
    let known = rooms::RoomScope { cells, movers: &model.movers, nodes: &model.nodes };
    let made = rooms::resolve(&model.rooms, &known)?;
    let warnings = rooms::checks::warnings(&model.rooms, &made, cells, &|| Oracle::new(mesh));
    Ok((made, warnings))
}

/// The surfaces with their light.
fn lit<'a>(
    model: &'a Model,
    voxel: f32,
    listener: &Listener<'_>,
) -> Result<Cow<'a, [Surface]>, CompileError> {
    if model.is_lit {
        return Ok(Cow::Borrowed(&model.surfaces));
    }
    listener.tell(Stage::Light, 0.0)?;
    let hear = |share| listener.hear(Stage::Light, share);
    let lit = light::lit(&model.surfaces, &model.opaque, voxel, &hear);
    lit.map(Cow::Owned).ok_or(CompileError::Cancelled)
}

/// The cells and their PVS.
fn sight_lines(
    spaces: &Spaces,
    width: Option<f32>,
    listener: &Listener<'_>,
) -> Result<Cells, CompileError> {
    let hear = |share: f32| listener.hear(Stage::Pvs, share);
    let whole = spaces.cells(&CellSize::WHOLE);
    let seen = pvs::spaces_seen(&whole, &|share| hear(share * 0.1));
    let seen = seen.ok_or(CompileError::Cancelled)?;
    let grain = match width {
        Some(width) => CellSize::of_width(width),
        None => {
            let pairs = PAIRS_ABOUT + PAIRS_A_SPACE * whole.spaces.len() as f64;
            pvs::cell_size_for(pairs, &whole.spaces, &seen)
        }
    };
    let mut cells = spaces.cells(&grain);
    let pvs = pvs::potentially_visible(&cells, &seen, &|share| hear(0.1 + share * 0.9));
    cells.pvs = pvs.ok_or(CompileError::Cancelled)?;
    Ok(cells)
}

/// What carving left that hides, and whether it is to be split along last: level surfaces that are
/// turned leave no portals when everything upright is split along before them.
pub fn opaque(carved: &carve::CarvedModel) -> Vec<occluders::Opaque> {
    let kept = carved.polygons.iter().flat_map(|polygon| {
        let is_last = polygon.class == carve::Class::SemiAxial && polygon.plane.axis() == Some(1);
        polygon.triangles.iter().map(move |&corners| occluders::Opaque { corners, is_last })
    });
    let sealed = carved.added.iter().filter(|added| added.sealed);
    let added = sealed.flat_map(|added| &added.triangles);
    // Parts of the model that lie in axial planes hide where they are, whatever their edges are.
    let flat = carved.cuttings.iter().filter(|cutting| cutting.plane.axis().is_some());
    let flat = flat.flat_map(|cutting| &cutting.triangles);
    let opaque = |&corners| occluders::Opaque { corners, is_last: false };
    kept.chain(added.chain(flat).map(opaque)).collect()
}

/// The region in which an eye can be, in own axes. It is found there, since around a building that
/// is turned, a box of the world's axes has much more room.
fn own_space(model: &Model, axes: &Axes) -> Aabb {
    let bounds = Aabb::from_points(model.points().map(|point| axes.own(point)));
    Aabb::new(bounds.min - MARGIN, bounds.max + MARGIN)
}

/// Passes progress on, and remembers a break.
struct Listener<'a> {
    progress: &'a (dyn Fn(Stage, f32) -> ControlFlow<()> + Sync),
    cancelled: AtomicBool,
}

impl Listener<'_> {
    /// What stages call, from any thread. Once broken, always broken.
    fn hear(&self, stage: Stage, share: f32) -> ControlFlow<()> {
        if self.cancelled.load(Relaxed) {
            return ControlFlow::Break(());
        }
        (self.progress)(stage, share).map_break(|()| self.cancelled.store(true, Relaxed))
    }

    /// The same between stages, as an error.
    fn tell(&self, stage: Stage, share: f32) -> Result<(), CompileError> {
        match self.hear(stage, share) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(CompileError::Cancelled),
        }
    }
}

/// Times stages.
#[derive(Default)]
struct Watch {
    seconds: Vec<(Stage, f64)>,
    cpu_seconds: Vec<(Stage, f64)>,
}

impl Watch {
    fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let (start, cpu_start) = (Instant::now(), ProcessTime::try_now());
        let done = work();
        self.seconds.push((stage, start.elapsed().as_secs_f64()));
        if let (Ok(start), Ok(end)) = (cpu_start, ProcessTime::try_now()) {
            self.cpu_seconds.push((stage, end.duration_since(start).as_secs_f64()));
        }
        done
    }
}

/// The triangles with equal corners stored once.
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

/// A place to stand in a model that names none: under a roof if possible, on a floor, in a cell as
/// large as can be.
fn find_spawn(model: &Model, cells: &Cells, mesh: &Mesh) -> Spawn {
    let sight = Oracle::new(mesh);
    let stand = |at: Vec3| {
        let floor = sight.distance(at, Vec3::NEG_Y)?;
        let roofed = sight.distance(at, Vec3::Y).is_some();
        Some((roofed, at - Vec3::Y * (floor - model.body.below_eye - 0.05)))
    };
    let world = |cell: &Cell| cells.axes.world_box(&cell.bounds);
    let mut by_size: Vec<_> = cells.cells.iter().map(world).collect();
    by_size.sort_by(|a, b| b.size().element_product().total_cmp(&a.size().element_product()));
    // A little off the centre, where the diagonals of floors and roofs tend to meet.
    let places: Vec<_> = by_size
        .iter()
        .filter_map(|b| stand(b.centre() + b.size() * Vec3::new(0.037, 0.0, 0.023)))
        .collect();
    let eye = places
        .iter()
        .find(|(roofed, _)| *roofed)
        .or(places.first())
        .map_or(cells.axes.world(cells.bounds.centre()), |(_, eye)| *eye);
    Spawn { eye, yaw: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::SurfaceMaterial;
    use sightline_world::motion::Body;

    /// A hollow box with a table in it.
    fn house() -> Model {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for (min, max) in [
            (Vec3::ZERO, Vec3::new(6.0, 3.0, 5.0)),
            (Vec3::new(2.0, 0.0, 2.0), Vec3::new(3.0, 0.8, 3.0)),
        ] {
            let first = positions.len() as u32;
            positions.extend((0..8).map(|i| {
                Vec3::new(
                    if i & 1 == 0 { min.x } else { max.x },
                    if i & 2 == 0 { min.y } else { max.y },
                    if i & 4 == 0 { min.z } else { max.z },
                )
            }));
            for [a, b, c, d] in
                [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
            {
                triangles.push([a, b, c].map(|i: u32| i + first));
                triangles.push([a, c, d].map(|i: u32| i + first));
            }
        }
        let opaque = triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect();
        let material = SurfaceMaterial { colour: [180, 90, 60], texture: None, glass: false };
        let surface =
            Surface { positions, uvs: Vec::new(), colours: Vec::new(), triangles, material };
        Model {
            title: "house".into(),
            surfaces: vec![surface],
            is_lit: true,
            opaque,
            solids: Vec::new(),
            spawns: Vec::new(),
            places: Vec::new(),
            body: Body::PERSON,
            speed_max: 5.0,
            movers: Vec::new(),
            rooms: Vec::new(),
            nodes: Vec::new(),
            origin: None,
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_house_compiles_and_what_is_outside_does_not_see_inside() {
        let options = CompileOptions { voxel: Some(0.25), ..CompileOptions::default() };
        let (world, report) =
            compile(&house(), &options, &|_, _| ControlFlow::Continue(())).unwrap();
        let (inside, outside) = (Vec3::new(1.0, 1.5, 1.0), Vec3::new(-1.0, 1.5, 1.0));
        let [inside, outside] = [inside, outside].map(|eye| world.cells.at(eye).unwrap());
        assert!(!world.cells.sees(inside, outside));
        assert_eq!(world.mesh.positions.len(), 16);
        assert_eq!(report.triangles, 24);
        assert!(report.octree.voxels > 1_000, "{}", report.octree.voxels);
        assert_eq!(World::from_bytes(&world.to_bytes()).unwrap(), world);
    }

    #[test]
    fn a_place_to_stand_is_found_inside() {
        let (world, _) = compile(
            &house(),
            &CompileOptions { voxel: Some(0.25), ..CompileOptions::default() },
            &|_, _| ControlFlow::Continue(()),
        )
        .unwrap();
        let eye = world.spawns[0].eye;
        assert!(Aabb::new(Vec3::ZERO, Vec3::new(6.0, 3.0, 5.0)).contains(eye), "{eye}");
        assert!((1.6..1.7).contains(&eye.y) || (2.4..2.5).contains(&eye.y), "{eye}");
    }

    #[test]
    fn a_break_at_any_stage_ends_the_compilation() {
        let options = CompileOptions { voxel: Some(0.25), ..CompileOptions::default() };
        for broken in [Stage::Carving, Stage::Cells, Stage::Pvs, Stage::Voxels] {
            // At once, and in the middle of the work.
            for from in [0.0, 0.3] {
                let progress = |stage, share| match stage == broken && share >= from {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                };
                let outcome = compile(&house(), &options, &progress);
                // This one tells only that it begins.
                let may_end = broken == Stage::Cells && from > 0.0;
                match outcome {
                    Err(CompileError::Cancelled) => {}
                    Ok(_) if may_end => {}
                    other => panic!("{broken:?} from {from}: {other:?}"),
                }
            }
        }
    }

    #[test]
    fn an_empty_model_is_refused() {
        let mut model = house();
        model.surfaces.clear();
        model.opaque.clear();
        assert!(matches!(
            compile(&model, &CompileOptions::default(), &|_, _| ControlFlow::Continue(())),
            Err(CompileError::Empty)
        ));
    }
}
