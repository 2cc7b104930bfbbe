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
        let from = point + normal * RAY_LIFT_M;
        let lamps = self.emitters.lamps.iter().filter_map(|lamp| lamp_at(lamp, from, normal));
        let lamps: Vec3 = lamps
            .map(|Arrival { towards, distance, irradiance }| {
                irradiance * self.scene.arrives(from, towards, distance - RAY_LIFT_M)
            })
            .sum();
        lamps + self.sun(from, normal) + self.areas(from, normal)
    }

    /// The light of the sun: the mean over points on its disc.
    fn sun(&self, from: Vec3, normal: Vec3) -> Vec3 {
        if self.emitters.sun(normal, SUN).is_none() {
            return Vec3::ZERO;
        }
        let (u, v) = SUN.any_orthonormal_pair();
        let count = self.counts.sun;
        let ray = |i: usize| {
            let [share, turn] = spread(i, count);
            let (sine, cosine) = (turn * TAU).sin_cos();
            let aside = (u * cosine + v * sine) * (share.sqrt() * SUN_RADIUS);
            let towards = (SUN + aside).normalize();
            self.emitters.sun(normal, towards).map_or(Vec3::ZERO, |arrival| {
                arrival.irradiance * self.scene.arrives(from, towards, f32::INFINITY)
            })
        };
        (0..count).map(ray).sum::<Vec3>() / count as f32
    }

    /// The light of small surfaces. How exactly each is tested follows from its share.
    fn areas(&self, from: Vec3, normal: Vec3) -> Vec3 {
        let areas = self.emitters.areas.seen_from(from, self.counts.groups);
        let most = areas.iter().map(|seen| seen.at_most).fold(0.0, f32::max);
        let unhidden: Vec<(&AreaEmitter, Vec3)> = areas
            .into_iter()
            .filter(|seen| seen.at_most > FAINT * most)
            .map(|seen| (seen.sign, seen.light.unhidden(from, normal)))
            .filter(|(_, light)| *light != Vec3::ZERO)
            .collect();
        let all: f32 = unhidden.iter().map(|(_, light)| light.max_element()).sum();
        let arrived = |(area, light): &(&AreaEmitter, Vec3)| {
            let rays = if light.max_element() < MINOR * all { 1 } else { self.counts.area };
            *light * self.share(area, from, rays)
        };
        unhidden.iter().map(arrived).sum()
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
