//! Probes: the light on things that move, at points of a grid where something may move.
//!
//! A *seed* is a place in the open where light will be asked for: the middle of a body that stands
//! on a floor, or a side of a mover. The points of the grid around a seed get a probe if the seed
//! sees them. So there are none in walls, and none in the open air far above a floor.

use std::{
    collections::BTreeMap,
    f32::consts::{PI, TAU},
    time::Duration,
};

use glam::{IVec3, UVec3, Vec3};
use rayon::prelude::*;
use sightline_world::{
    Mover,
    light::{BakedLight, Probe, ProbeGrid, places_beside},
    motion::Body,
    tolerance::RAY_LIFT_M,
};

use super::{Surroundings, direct::Direct, emitters::SUN, exchange::FormFactors, sampling::spread};

/// Probes are this far apart, in metres …
const SPACING_M: f32 = 1.0;
/// … and farther in large buildings, so that there are about this many.
const PROBES: f32 = 40_000.0;
/// How many probes there are for each square of floor: two layers, and some beside walls.
const LAYERS: f32 = 2.5;
/// The most points of the grid, with a probe or without, and the most along an axis.
const POINTS_MAX: f64 = 1.0e9;
const SIDE_MAX: f32 = 1.0e5;
/// The offset of the grid from whole metres. Authors put walls at round coordinates.
const SHIFT: Vec3 = Vec3::new(0.37, 0.41, 0.61);
/// Floors rise less steeply than this.
const LEVEL: f32 = 0.7;
/// Floors that see more than this share of sky are roofs and open ground: all of them have the same
/// light.
const OPEN: f32 = 0.9;
/// A mover is looked for at this many moments.
const MOMENTS: u32 = 8;
/// Light that is brighter than this in the picture is stored as if it were this.
const SHOWN_MAX: f32 = 64.0;
/// The light under the open sky is found by this many rays.
const SKY_RAYS: usize = 1_024;
/// The sides of a cube, as in [`Probe::levels`].
const SIDES: [Vec3; 6] = [Vec3::NEG_X, Vec3::X, Vec3::NEG_Y, Vec3::Y, Vec3::NEG_Z, Vec3::Z];

/// What probes are found with.
pub(super) struct ProbeInput<'a> {
    pub(super) around: &'a Surroundings<'a>,
    pub(super) direct: &'a Direct<'a>,
    pub(super) factors: &'a FormFactors,
    /// The light that leaves each node, per area.
    pub(super) radiosity: &'a [Vec3],
    pub(super) exposure: f32,
    pub(super) body: &'a Body,
    pub(super) movers: &'a [Mover],
    /// The rays from each probe.
    pub(super) rays: usize,
}

impl ProbeInput<'_> {
    /// The probes of a building.
    pub(super) fn bake(&self) -> BakedLight {
        let (floors, area) = self.floor_seeds();
        let mut seeds = floors;
        seeds.extend(self.mover_seeds());
        let mut grid = self.grid(&seeds, spacing(&seeds, area));
        let light: Vec<[Vec3; 6]> = grid
            .places
            .par_iter()
            .map(|&place| self.light(grid.point(grid.coordinates(place))))
            .collect();
        let most =
            |sides: &[Vec3; 6]| sides.iter().map(|side| side.max_element()).fold(0.0, f32::max);
        let sky = self.sky();
        let brightest = light.iter().chain(&sky).map(most).fold(f32::MIN_POSITIVE, f32::max);
        let brightest = brightest.min(SHOWN_MAX / self.exposure).max(1.0e-9);
        let links: Vec<u8> =
            grid.places.par_iter().map(|&place| self.links(&grid, place)).collect();
        let probes = light.iter().zip(links);
        grid.probes = probes.map(|(sides, links)| Probe::new(sides, brightest, links)).collect();
        let sky = sky.map(|sides| Probe::new(&sides, brightest, 0));
        BakedLight { exposure: self.exposure, brightest, sky, grid }
    }

    /// The middles of bodies that stand on points of floors, and the area of these floors in square
    /// metres.
    fn floor_seeds(&self) -> (Vec<Vec3>, f32) {
        let Surroundings { nodes, patches, scene, .. } = self.around;
        let middle = (self.body.below_eye + self.body.above_eye) / 2.0;
        let is_floor = |node: usize| {
            patches[nodes.list[node].patch as usize].normal.y > LEVEL
                && self.factors.open[node] <= OPEN
        };
        let of_node = |node: usize| {
            let of = &nodes.list[node];
            let points = of.points.iter().filter_map(|point| nodes.point(patches, *point as usize));
            let seeds: Vec<Vec3> = points
                .filter(|at| {
                    let from = *at + Vec3::Y * RAY_LIFT_M;
                    scene.arrives(from, Vec3::Y, 2.0 * middle) != Vec3::ZERO
                })
                .map(|at| at + Vec3::Y * middle)
                .collect();
            let area = if seeds.is_empty() { 0.0 } else { of.area };
            (seeds, area)
        };
        let found: Vec<(Vec<Vec3>, f32)> = (0..nodes.list.len())
            .into_par_iter()
            .filter(|node| is_floor(*node))
            .map(of_node)
            .collect();
        let area = found.iter().map(|(_, area)| area).sum();
        (found.into_iter().flat_map(|(seeds, _)| seeds).collect(), area)
    }

    /// The places beside movers, at some moments.
    fn mover_seeds(&self) -> Vec<Vec3> {
        let beside = |mover: &Mover| {
            let step = Duration::from_secs_f32(mover.trajectory.length_s().max(0.0)) / MOMENTS;
            let at = |moment: u32| {
                let bounds = mover.swept(step * moment, step * moment);
                places_beside(&bounds)
            };
            (0..MOMENTS).flat_map(at).filter(|place| place.is_finite()).collect::<Vec<_>>()
        };
        self.movers.iter().flat_map(beside).collect()
    }

    /// The grid around some seeds: the points that seeds see, without their light.
    fn grid(&self, seeds: &[Vec3], spacing: f32) -> ProbeGrid {
        let step = |seed: Vec3| ((seed - SHIFT) / spacing).floor().as_ivec3();
        let mut is_seen: BTreeMap<[i32; 3], bool> = BTreeMap::new();
        for &seed in seeds {
            for corner in 0..8 {
                let at = step(seed) + IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
                let seen = is_seen.entry(at.to_array()).or_insert(false);
                let point = SHIFT + at.as_vec3() * spacing;
                *seen = *seen || self.around.scene.between(seed, point) != Vec3::ZERO;
            }
        }
        let seen: Vec<IVec3> =
            is_seen.into_iter().filter(|(_, seen)| *seen).map(|(at, _)| at.into()).collect();
        let low = seen.iter().copied().reduce(IVec3::min).unwrap_or_default();
        let high = seen.iter().copied().reduce(IVec3::max).unwrap_or_default();
        let mut grid = ProbeGrid {
            origin: SHIFT + low.as_vec3() * spacing,
            spacing,
            size: (high - low).as_uvec3() + UVec3::ONE,
            places: Vec::new(),
            probes: Vec::new(),
        };
        grid.places = seen.iter().map(|at| grid.index((*at - low).as_uvec3())).collect();
        grid.places.sort_unstable();
        grid
    }

    /// The light on the sides of a small cube at a point in the open.
    fn light(&self, at: Vec3) -> [Vec3; 6] {
        let mut light = self.direct.on(at, &SIDES);
        for ray in 0..self.rays {
            let along = sphere(ray, self.rays);
            let end = self.around.scene.trace(at, along);
            let arriving = match &end.met {
                None => self.around.emitters.sky(along) * PI,
                Some(met) => {
                    self.around.node_at(met).map_or(Vec3::ZERO, |node| self.radiosity[node])
                }
            };
            add(&mut light, along, arriving * end.tint * (4.0 / self.rays as f32));
        }
        light
    }

    /// The light under the open sky.
    fn sky(&self) -> Option<[Vec3; 6]> {
        let emitters = self.around.emitters;
        emitters.has_sky.then(|| {
            let mut light =
                SIDES.map(|side| emitters.sun(side, SUN).map_or(Vec3::ZERO, |sun| sun.irradiance));
            for ray in 0..SKY_RAYS {
                let along = sphere(ray, SKY_RAYS);
                add(&mut light, along, emitters.sky(along) * (PI * 4.0 / SKY_RAYS as f32));
            }
            light
        })
    }

    /// See [`Probe::links`].
    fn links(&self, grid: &ProbeGrid, place: u32) -> u8 {
        let at = grid.coordinates(place);
        let is_linked = |axis: usize| {
            let next = at + UVec3::AXES[axis];
            next.cmplt(grid.size).all()
                && grid.places.binary_search(&grid.index(next)).is_ok()
                && self.around.scene.between(grid.point(at), grid.point(next)) != Vec3::ZERO
        };
        (0..3).filter(|axis| is_linked(*axis)).fold(0, |links, axis| links | 1 << axis)
    }
}

/// How far apart probes are, in metres, around some seeds on floors of this area.
fn spacing(seeds: &[Vec3], area: f32) -> f32 {
    let low = seeds.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = seeds.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let mut spacing = (area * LAYERS / PROBES).sqrt().max(SPACING_M);
    // Seeds may lie very far apart.
    let points = |spacing: f32| ((high - low) / spacing + 3.0).as_dvec3().element_product();
    while points(spacing) > POINTS_MAX || (high - low).max_element() / spacing > SIDE_MAX {
        spacing *= 2.0;
    }
    spacing
}

/// Adds light from a direction to the sides that face it.
fn add(light: &mut [Vec3; 6], from: Vec3, arriving: Vec3) {
    for (side, facing) in light.iter_mut().zip(SIDES) {
        *side += arriving * facing.dot(from).max(0.0);
    }
}

/// Directions all around, evenly.
fn sphere(i: usize, count: usize) -> Vec3 {
    let [share, turn] = spread(i, count);
    let up = 1.0 - 2.0 * share;
    let (sine, cosine) = (turn * TAU).sin_cos();
    let radius = (1.0 - up * up).sqrt();
    Vec3::new(radius * cosine, up, radius * sine)
}
