//! Radiosity: light that surfaces pass on to each other.
//!
//! 1. [`nodes`] groups the points of patches to nodes, which exchange light.
//! 2. [`direct`] finds what the sun, lamps and small bright surfaces give each point.
//! 3. [`exchange`] finds form factors between nodes, and passes light on between them.
//! 4. [`gather`] finds what arrives at each point from all nodes and from the sky.
//! 5. [`edges`] adds points where a shadow ends between them.
//! 6. [`exposure`] chooses how bright the picture is.
//! 7. [`probes`] finds the light on things that move.

mod direct;
mod edges;
mod emitter_groups;
mod emitters;
mod exchange;
mod exposure;
mod gather;
mod nodes;
mod polygon;
mod probes;
mod quality;
mod reference;
mod sampling;
mod scene;
#[cfg(test)]
mod tests;

use std::{
    ops::ControlFlow,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
};

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::{Mover, light::BakedLight, motion::Body};

use super::{NO_PATCH, patch::Patch, shell::Shell};
use crate::{
    model::{Lamp, Surface},
    palette::{self, reflectance},
};
use direct::Direct;
use emitter_groups::EmitterGroups;
use emitters::{AreaEmitter, Emitters};
use exchange::{FormFactors, exchange};
use nodes::Nodes;
use probes::ProbeInput;
pub use quality::LightQuality;
use quality::RayCounts;
pub(crate) use reference::Reference;
use scene::{Met, Scene};

/// Surfaces that give light are found by rays when they are larger than this, in square metres.
const WIDE_M2: f32 = 2.0;
/// No surface passes on more than this share of light.
const REFLECTANCE_MAX: f32 = 0.9;
/// Without any lamp, ceilings give this light downwards, which the eye does not see.
const CEILING_LIGHT: Vec3 = Vec3::new(0.62, 0.60, 0.56);
/// A ceiling is level and has something below it at a distance in this range, in metres.
const CEILING_HEIGHTS: std::ops::Range<f32> = 1.9..12.0;
/// How level a ceiling is.
const LEVEL: f32 = 0.95;

/// What radiosity begins with, besides patches.
pub(super) struct RadiosityInput<'a> {
    pub(super) surfaces: &'a [Surface],
    /// The patch of each triangle of each surface.
    pub(super) of_triangle: &'a [Vec<u32>],
    pub(super) lamps: &'a [Lamp],
    pub(super) has_sky: bool,
    /// What moves: bodies of one shape, and movers.
    pub(super) body: &'a Body,
    pub(super) movers: &'a [Mover],
    pub(super) quality: LightQuality,
    /// How many voxels there are between neighbouring points.
    pub(super) voxels_between: f32,
}

/// The figures of light.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct LightFigures {
    /// The points at which light was found.
    pub points: usize,
    /// The nodes that exchange light.
    pub nodes: usize,
    /// The squares that were refined at the edges of shadows.
    pub refined: usize,
    /// The difference between light that left nodes for others and light that arrived, as a share.
    pub energy_error: f64,
    /// The points at which light was found for what moves.
    pub probes: usize,
    /// The factor from irradiance to the picture.
    pub exposure: f32,
}

/// What is known of the light of a building, apart from the light on its patches.
pub(super) struct Solved {
    scene: Scene,
    emitters: Emitters,
    nodes: Nodes,
    /// What each node gives, per area.
    emission: Vec<Vec3>,
    /// The share of light that each patch passes on.
    reflectance: Vec<Vec3>,
    /// The light for what moves.
    pub(super) baked: BakedLight,
    pub(super) figures: LightFigures,
}

/// What rays need to find nodes.
struct Surroundings<'a> {
    scene: &'a Scene,
    emitters: &'a Emitters,
    nodes: &'a Nodes,
    patches: &'a [Patch],
    shell: &'a Shell,
    is_opaque: &'a [bool],
}

impl Surroundings<'_> {
    fn node_at(&self, met: &Met) -> Option<usize> {
        self.nodes.at(met.patch, self.patches, met.before, self.shell)
    }

    fn receives(&self, patch: usize) -> bool {
        self.is_opaque[patch]
    }
}

/// Lights patches by radiosity. None when `progress`, which hears the share that is done from any
/// thread, breaks.
pub(super) fn light(
    patches: &mut [Patch],
    shell: &Shell,
    input: &RadiosityInput<'_>,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Solved> {
    let counts = RayCounts::of(input.quality);
    let scene = Scene::new(input.surfaces, input.of_triangle);
    let Materials { is_opaque, reflectance, emission } = Materials::new(patches.len(), input);
    let nodes = Nodes::new(patches, |patch| is_opaque[patch]);
    let emitters = emitters(patches, input, &emission);
    let around = Surroundings {
        scene: &scene,
        emitters: &emitters,
        nodes: &nodes,
        patches,
        shell,
        is_opaque: &is_opaque,
    };
    let (node_rays, point_rays) =
        (counts.of_nodes(nodes.list.len()), counts.of_points(nodes.patch_of.len()));
    let meter = Meter::new(
        nodes.patch_of.len() * (point_rays + counts.sun) + nodes.list.len() * node_rays,
        progress,
    );
    let given = node_emission(&around, &emission, input.lamps.is_empty());
    let direct_at = Direct { scene: &scene, emitters: &emitters, counts };
    let direct = direct_light(&around, &direct_at, &|points| meter.add(points * counts.sun))?;
    let factors = FormFactors::new(&around, node_rays, &|rows| meter.add(rows * node_rays))?;
    let reflectances: Vec<Vec3> =
        nodes.list.iter().map(|node| reflectance[node.patch as usize]).collect();
    let areas: Vec<f32> = nodes.list.iter().map(|node| node.area).collect();
    let first: Vec<Vec3> = (0..nodes.list.len())
        .map(|node| {
            let direct = nodes.list[node].mean(|point| direct[point].unwrap_or_default());
            given[node] + (direct + factors.sky[node]) * reflectances[node]
        })
        .collect();
    let exchanged = exchange(&factors, first, &reflectances, &areas);
    let indirect = gather::gather(&around, &exchanged.radiosity, point_rays, &|points| {
        meter.add(points * point_rays)
    })?;
    let all: Vec<Option<Vec3>> = direct
        .iter()
        .zip(&indirect)
        .map(|(direct, indirect)| indirect.map(|indirect| direct.unwrap_or_default() + indirect))
        .collect();
    let exposure = exposure::choose(&nodes, &factors.open, &all);
    let squares =
        edges::refine(&around, &direct_at, &direct, &indirect, exposure, input.voxels_between);
    let probes = ProbeInput {
        around: &around,
        direct: &direct_at,
        factors: &factors,
        radiosity: &exchanged.radiosity,
        exposure,
        body: input.body,
        movers: input.movers,
        rays: counts.probe,
    };
    let baked = probes.bake();
    let figures = LightFigures {
        points: all.iter().flatten().count(),
        nodes: nodes.list.len(),
        refined: squares.len(),
        energy_error: exchanged.energy_error,
        probes: baked.grid.probes.len(),
        exposure,
    };
    for (index, patch) in patches.iter_mut().enumerate() {
        let points = &all[nodes.first[index]..nodes.first[index + 1]];
        let light: Vec<Option<Vec3>> = match is_opaque[index] {
            true => points.iter().map(|light| light.map(|light| light * exposure)).collect(),
            // Glass has its own colour: it is what is seen through it that is lit.
            false => vec![Some(Vec3::ONE); points.len()],
        };
        patch.set_light(&light);
    }
    edges::add(patches, squares);
    (meter.add(0)).then_some(Solved {
        scene,
        emitters,
        nodes,
        emission: given,
        reflectance,
        baked,
        figures,
    })
}

/// Counts rays, and tells of them.
struct Meter<'a> {
    done: AtomicUsize,
    all: usize,
    is_cancelled: AtomicBool,
    progress: &'a (dyn Fn(f32) -> ControlFlow<()> + Sync),
}

/// Progress is told each time that about this many rays are cast.
const METER_STEP: usize = 1 << 20;

impl<'a> Meter<'a> {
    fn new(all: usize, progress: &'a (dyn Fn(f32) -> ControlFlow<()> + Sync)) -> Self {
        Self {
            done: AtomicUsize::new(0),
            all: all.max(1),
            is_cancelled: AtomicBool::new(false),
            progress,
        }
    }

    /// Adds rays, and says whether to go on.
    fn add(&self, rays: usize) -> bool {
        let before = self.done.fetch_add(rays, Relaxed);
        if before / METER_STEP != (before + rays) / METER_STEP || rays == 0 {
            let share = ((before + rays) as f32 / self.all as f32).min(1.0);
            if (self.progress)(share).is_break() {
                self.is_cancelled.store(true, Relaxed);
            }
        }
        !self.is_cancelled.load(Relaxed)
    }
}

/// What patches are made of.
struct Materials {
    is_opaque: Vec<bool>,
    /// The linear colour.
    reflectance: Vec<Vec3>,
    emission: Vec<Vec3>,
}

impl Materials {
    fn new(patches: usize, input: &RadiosityInput<'_>) -> Self {
        let mut materials = Self {
            is_opaque: vec![false; patches],
            reflectance: vec![Vec3::ZERO; patches],
            emission: vec![Vec3::ZERO; patches],
        };
        let mut areas = vec![0.0f32; patches];
        for (surface, of_triangle) in input.surfaces.iter().zip(input.of_triangle) {
            let colour = reflectance(&surface.material);
            let is_opaque = !surface.material.glass;
            for (triangle, &patch) in of_triangle.iter().enumerate() {
                let Some([a, b, c]) = surface.corners_of(triangle).filter(|_| patch != NO_PATCH)
                else {
                    continue;
                };
                let patch = patch as usize;
                let area = (b - a).cross(c - a).length();
                materials.is_opaque[patch] = is_opaque;
                materials.emission[patch] = Vec3::from(surface.material.emission);
                materials.reflectance[patch] +=
                    colour * palette::mean_tint(surface, triangle) * area;
                areas[patch] += area;
            }
        }
        for (reflectance, area) in materials.reflectance.iter_mut().zip(areas) {
            *reflectance =
                (*reflectance / area.max(f32::MIN_POSITIVE)).min(Vec3::splat(REFLECTANCE_MAX));
        }
        materials
    }
}

/// The lamps, and the triangles of patches that give light and are small.
fn emitters(patches: &[Patch], input: &RadiosityInput<'_>, emission: &[Vec3]) -> Emitters {
    let mut areas = Vec::new();
    for (surface, of_triangle) in input.surfaces.iter().zip(input.of_triangle) {
        for (triangle, &patch) in of_triangle.iter().enumerate() {
            let Some(corners) = surface.corners_of(triangle).filter(|_| patch != NO_PATCH) else {
                continue;
            };
            let (of, radiance) = (&patches[patch as usize], emission[patch as usize]);
            if radiance != Vec3::ZERO && of.area <= WIDE_M2 {
                let [a, b, c] = corners;
                let area = (b - a).cross(c - a).length() / 2.0;
                areas.push(AreaEmitter { corners, normal: of.normal, radiance, area });
            }
        }
    }
    Emitters {
        has_sky: input.has_sky,
        lamps: input.lamps.to_vec(),
        areas: EmitterGroups::new(areas),
    }
}

/// What each node gives, apart from what small bright surfaces give: the light of wide surfaces,
/// and of ceilings when nothing else gives light.
fn node_emission(around: &Surroundings<'_>, emission: &[Vec3], no_lamps: bool) -> Vec<Vec3> {
    let is_dark =
        no_lamps && around.emitters.has_sky && emission.iter().all(|light| *light == Vec3::ZERO);
    let of = |node: &nodes::Node| {
        let patch = &around.patches[node.patch as usize];
        let given = emission[node.patch as usize];
        if given != Vec3::ZERO {
            return if patch.area > WIDE_M2 { given * std::f32::consts::PI } else { Vec3::ZERO };
        }
        let point = around.nodes.point(around.patches, node.points[node.points.len() / 2] as usize);
        let height = point
            .filter(|_| is_dark && patch.normal.y < -LEVEL)
            .and_then(|point| around.scene.trace(point + patch.normal * 1.0e-3, patch.normal).met)
            .map_or(0.0, |met| met.distance);
        if CEILING_HEIGHTS.contains(&height) {
            CEILING_LIGHT * std::f32::consts::PI
        } else {
            Vec3::ZERO
        }
    };
    around.nodes.list.par_iter().map(of).collect()
}

/// Direct light at all points. None inside something solid, and on glass.
fn direct_light(
    around: &Surroundings<'_>,
    direct: &Direct<'_>,
    go_on: &(dyn Fn(usize) -> bool + Sync),
) -> Option<Vec<Option<Vec3>>> {
    let at = |point: usize| {
        let patch = around.nodes.patch_of[point] as usize;
        let open = around.nodes.point(around.patches, point).filter(|_| around.receives(patch));
        go_on(1).then(|| open.map(|at| direct.at(at, around.patches[patch].normal)))
    };
    (0..around.nodes.patch_of.len()).into_par_iter().map(at).collect()
}
