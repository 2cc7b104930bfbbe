//! Light straight from the sun, from lamps and from small bright surfaces.

use std::f32::consts::TAU;

use glam::Vec3;
use sightline_world::tolerance::RAY_LIFT_M;

use super::{
    emitters::{AreaEmitter, Arrival, Emitters, SUN, SUN_RADIUS, lamp_at},
    quality::RayCounts,
    sampling::spread,
    scene::Scene,
};

/// An emitter that can give a point no more than this share of what the strongest one can is left
/// out.
const FAINT: f32 = 5.0e-4;
/// An emitter with less than this share of the light at a point is tested with one ray …
const MINOR: f32 = 0.02;
/// … and with this many first when it has more.
const FIRST: usize = 4;

/// What is needed to find direct light.
pub(super) struct Direct<'a> {
    pub(super) scene: &'a Scene,
    pub(super) emitters: &'a Emitters,
    pub(super) counts: RayCounts,
}

impl Direct<'_> {
    /// The light on a surface at a point.
    pub(super) fn at(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let [light] = self.on(point + normal * RAY_LIFT_M, &[normal]);
        light
    }

    /// The light on some surfaces at a place in the open, by their normals.
    pub(super) fn on<const N: usize>(&self, from: Vec3, normals: &[Vec3; N]) -> [Vec3; N] {
        let mut light = [Vec3::ZERO; N];
        for lamp in &self.emitters.lamps {
            let arrivals = normals.map(|normal| lamp_at(lamp, from, normal));
            let Some(Arrival { towards, distance, .. }) = arrivals.iter().flatten().next() else {
                continue;
            };
            let seen = self.scene.arrives(from, *towards, distance - RAY_LIFT_M);
            for (light, arrival) in light.iter_mut().zip(arrivals) {
                *light += arrival.map_or(Vec3::ZERO, |arrival| arrival.irradiance * seen);
            }
        }
        let more = self.sun(from, normals).into_iter().zip(self.areas(from, normals));
        light.iter_mut().zip(more).for_each(|(light, (sun, areas))| *light = *light + sun + areas);
        light
    }

    /// The light of the sun: the mean over points on its disc.
    fn sun<const N: usize>(&self, from: Vec3, normals: &[Vec3; N]) -> [Vec3; N] {
        let mut light = [Vec3::ZERO; N];
        if normals.iter().all(|normal| self.emitters.sun(*normal, SUN).is_none()) {
            return light;
        }
        let (u, v) = SUN.any_orthonormal_pair();
        let count = self.counts.sun;
        for i in 0..count {
            let [share, turn] = spread(i, count);
            let (sine, cosine) = (turn * TAU).sin_cos();
            let aside = (u * cosine + v * sine) * (share.sqrt() * SUN_RADIUS);
            let towards = (SUN + aside).normalize();
            let seen = self.scene.arrives(from, towards, f32::INFINITY);
            for (light, normal) in light.iter_mut().zip(normals) {
                let arrival = self.emitters.sun(*normal, towards);
                *light += arrival.map_or(Vec3::ZERO, |arrival| arrival.irradiance * seen);
            }
        }
        light.map(|light| light / count as f32)
    }

    /// The light of small surfaces. How exactly each is tested follows from its share.
    fn areas<const N: usize>(&self, from: Vec3, normals: &[Vec3; N]) -> [Vec3; N] {
        let areas = self.emitters.areas.seen_from(from, self.counts.groups);
        let most = areas.iter().map(|seen| seen.at_most).fold(0.0, f32::max);
        let greatest =
            |light: &[Vec3; N]| light.iter().map(|side| side.max_element()).fold(0.0, f32::max);
        let unhidden: Vec<(&AreaEmitter, [Vec3; N])> = areas
            .into_iter()
            .filter(|seen| seen.at_most > FAINT * most)
            .map(|seen| (seen.sign, normals.map(|normal| seen.light.unhidden(from, normal))))
            .filter(|(_, light)| greatest(light) > 0.0)
            .collect();
        let all: f32 = unhidden.iter().map(|(_, light)| greatest(light)).sum();
        let mut sum = [Vec3::ZERO; N];
        for (area, light) in &unhidden {
            let rays = if greatest(light) < MINOR * all { 1 } else { self.counts.area };
            let share = self.share(area, from, rays);
            sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += *light * share);
        }
        sum
    }

    /// The share of an emitter that a point sees, by up to this many rays. The first few settle it
    /// when they agree.
    fn share(&self, area: &AreaEmitter, from: Vec3, rays: usize) -> Vec3 {
        let sees = |i: usize, of: usize| self.scene.between(from, area.point(spread(i, of)));
        if rays == 1 {
            return self.scene.between(from, area.middle());
        }
        let first: [Vec3; FIRST] = std::array::from_fn(|i| sees(i, FIRST));
        if first.iter().all(|seen| *seen == first[0]) || rays <= FIRST {
            return first.iter().sum::<Vec3>() / FIRST as f32;
        }
        (0..rays).map(|i| sees(i, rays)).sum::<Vec3>() / rays as f32
    }
}
