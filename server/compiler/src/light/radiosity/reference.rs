//! The truth to compare radiosity with: paths of light, traced one by one.

use std::{
    f32::consts::{PI, TAU},
    ops::ControlFlow,
};

use glam::{Vec2, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_world::tolerance::RAY_LIFT_M;

use super::{
    super::{Light, shell::Shell},
    LightFigures, LightQuality, Solved,
    emitters::{Arrival, SUN, SUN_RADIUS, lamp_at},
    sampling::about,
    scene::Met,
};
use crate::model::Model;

/// From this bounce on, paths end at random.
const BOUNCES_SURE: usize = 3;
/// No path is longer.
const BOUNCES_MAX: usize = 40;

/// Traces paths in a lit building.
pub(crate) struct Reference {
    light: Light,
    solved: Solved,
}

/// The light at what a line of sight meets, by radiosity and by paths: exposed irradiance, without
/// compression.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightPair {
    pub(crate) radiosity: Vec3,
    pub(crate) reference: Vec3,
    /// The linear colour of the surface.
    pub(crate) colour: Vec3,
}

impl Reference {
    /// Lights a model. The arguments are those of [`Light::by_radiosity`].
    pub(crate) fn new(
        model: &Model,
        along: Vec3,
        voxel: f32,
        quality: LightQuality,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<Self> {
        let (light, solved) = Light::solved(model, along, voxel, quality, progress)?;
        Some(Self { light, solved })
    }

    /// The light where a line of sight ends, by this many paths. None in the sky.
    pub(crate) fn along(
        &self,
        eye: Vec3,
        along: Vec3,
        paths: usize,
        seed: u64,
    ) -> Option<LightPair> {
        let met = self.solved.scene.trace(eye, along).met?;
        let mut random = SmallRng::seed_from_u64(seed);
        let light: Vec3 = (0..paths).map(|_| self.arriving(&met, &mut random, 0)).sum();
        let patch = &self.light.patches[met.patch];
        Some(LightPair {
            radiosity: patch.at(met.at, &self.light.shell),
            reference: light * (self.solved.figures.exposure / paths as f32),
            colour: self.solved.reflectance[met.patch],
        })
    }

    /// The figures of the light.
    pub(crate) fn figures(&self) -> LightFigures {
        self.solved.figures
    }

    fn shell(&self) -> &Shell {
        &self.light.shell
    }

    /// The light that arrives at a place, by one random path.
    fn arriving(&self, met: &Met, random: &mut SmallRng, bounce: usize) -> Vec3 {
        let from = met.at + met.normal * RAY_LIFT_M;
        let direct = self.direct(from, met.normal, random);
        if bounce >= BOUNCES_MAX {
            return direct;
        }
        let (share, turn): (f32, f32) = (random.random(), random.random());
        let flat = Vec2::from_angle(turn * TAU) * share.sqrt();
        let along = about(met.normal, flat.extend((1.0 - share).sqrt()));
        let end = self.solved.scene.trace(from, along);
        let Some(next) = end.met else {
            return direct + self.solved.emitters.sky(along) * end.tint * PI;
        };
        let nodes = &self.solved.nodes;
        let node = nodes.at(next.patch, &self.light.patches, next.before, self.shell());
        let mut light = node.map_or(Vec3::ZERO, |node| self.solved.emission[node]);
        let reflectance = self.solved.reflectance[next.patch];
        let going_on = if bounce < BOUNCES_SURE { 1.0 } else { reflectance.max_element() };
        if random.random::<f32>() < going_on {
            light += reflectance / going_on * self.arriving(&next, random, bounce + 1);
        }
        direct + light * end.tint
    }

    /// Direct light at a point, with one random place on each kind of emitter.
    fn direct(&self, from: Vec3, normal: Vec3, random: &mut SmallRng) -> Vec3 {
        let Solved { scene, emitters, .. } = &self.solved;
        let lamps = emitters.lamps.iter().filter_map(|lamp| lamp_at(lamp, from, normal));
        let mut light: Vec3 = lamps
            .map(|Arrival { towards, distance, irradiance }| {
                irradiance * scene.arrives(from, towards, distance - RAY_LIFT_M)
            })
            .sum();
        let (u, v) = SUN.any_orthonormal_pair();
        let disc = Vec2::from_angle(random.random::<f32>() * TAU)
            * (random.random::<f32>().sqrt() * SUN_RADIUS);
        let towards = (SUN + u * disc.x + v * disc.y).normalize();
        if let Some(arrival) = emitters.sun(normal, towards) {
            light += arrival.irradiance * scene.arrives(from, towards, f32::INFINITY);
        }
        let areas = emitters.areas.members();
        if !areas.is_empty() {
            let area = &areas[random.random_range(0..areas.len())];
            let place = area.point([random.random(), random.random()]);
            let away = place - from;
            let square = away.length_squared().max(1.0e-6);
            let along = away / square.sqrt();
            let cosines = normal.dot(along).max(0.0) * (-area.normal.dot(along)).max(0.0);
            if cosines > 0.0 {
                let all = areas.len() as f32;
                light += area.radiance
                    * (cosines * area.area * all / square)
                    * scene.between(from, place);
            }
        }
        light
    }
}
