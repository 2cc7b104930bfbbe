//! Where light comes from: the sun, the sky, lamps, and surfaces that give light.

use glam::Vec3;

use super::{emitter_groups::EmitterGroups, polygon::irradiance_of_polygon};
use crate::model::{Lamp, LampSource};

/// The direction towards the sun.
pub(super) const SUN: Vec3 = Vec3::new(0.439_4, 0.779_0, 0.449_4);
/// The light of the sun on a surface that faces it.
const SUN_LIGHT: Vec3 = Vec3::new(6.0, 5.5, 4.7);
/// The radius of the sun, as a share of its distance. It is four times as wide as the true one,
/// which makes shadows soft within a few voxels.
pub(super) const SUN_RADIUS: f32 = 0.018;
/// The light of the sky, above and at the horizon, and of the ground beyond all surfaces.
const ZENITH: Vec3 = Vec3::new(0.62, 0.80, 1.12);
const HORIZON: Vec3 = Vec3::new(1.05, 1.08, 1.10);
const GROUND: Vec3 = Vec3::new(0.50, 0.48, 0.44);
/// A surface of white paper gives as much light as its emission 1 at this illuminance, in lux.
const LUX: f32 = 250.0 * std::f32::consts::PI;
/// A point lamp is at least this far away, in metres: its light has no pole.
const LAMP_NEAR_M: f32 = 0.05;

/// All that gives light, apart from surfaces so wide that rays find them.
pub(super) struct Emitters {
    pub(super) has_sky: bool,
    pub(super) lamps: Vec<Lamp>,
    pub(super) areas: EmitterGroups,
}

/// A triangle that gives light off one side.
#[derive(Clone, Copy)]
pub(super) struct AreaEmitter {
    pub(super) corners: [Vec3; 3],
    /// Off the side that gives light, of unit length.
    pub(super) normal: Vec3,
    pub(super) radiance: Vec3,
    pub(super) area: f32,
}

/// Light that arrives at a point from one direction, were nothing in its way.
pub(super) struct Arrival {
    /// Towards the lamp, of unit length.
    pub(super) towards: Vec3,
    /// In metres; infinite for the sun and parallel light.
    pub(super) distance: f32,
    pub(super) irradiance: Vec3,
}

impl Emitters {
    /// The light of the sky in a direction of unit length.
    pub(super) fn sky(&self, along: Vec3) -> Vec3 {
        match self.has_sky {
            false => Vec3::ZERO,
            true if along.y < 0.0 => GROUND,
            true => HORIZON.lerp(ZENITH, along.y.sqrt()),
        }
    }

    /// The light of the sun at a surface with this normal, from a direction near the sun's.
    pub(super) fn sun(&self, normal: Vec3, towards: Vec3) -> Option<Arrival> {
        let cosine = normal.dot(towards);
        (self.has_sky && cosine > 0.0).then(|| Arrival {
            towards,
            distance: f32::INFINITY,
            irradiance: SUN_LIGHT * cosine,
        })
    }
}

/// The light of a lamp at a surface. None where it gives none.
pub(super) fn lamp_at(lamp: &Lamp, point: Vec3, normal: Vec3) -> Option<Arrival> {
    let intensity = Vec3::from(lamp.intensity) * (std::f32::consts::PI / LUX);
    let (at, share) = match lamp.source {
        LampSource::Parallel(along) => {
            let cosine = normal.dot(-along);
            let irradiance = intensity * cosine;
            return (cosine > 0.0).then_some(Arrival {
                towards: -along,
                distance: f32::INFINITY,
                irradiance,
            });
        }
        LampSource::Point(at) => (at, 1.0),
        LampSource::Spot { at, along, cosines: [inner, outer] } => {
            let cosine = along.dot((point - at).normalize_or_zero());
            let share = ((cosine - outer) / (inner - outer).max(1.0e-3)).clamp(0.0, 1.0);
            (at, share * share)
        }
    };
    let distance = point.distance(at);
    let towards = (at - point).try_normalize()?;
    let cosine = normal.dot(towards);
    let irradiance = intensity * (cosine * share / distance.max(LAMP_NEAR_M).powi(2));
    (cosine > 0.0 && share > 0.0).then_some(Arrival { towards, distance, irradiance })
}

impl AreaEmitter {
    /// The largest component of the light that it gives to one direction.
    pub(super) fn power(&self) -> f32 {
        self.radiance.max_element() * self.area
    }

    pub(super) fn middle(&self) -> Vec3 {
        self.corners.iter().sum::<Vec3>() / 3.0
    }

    /// An upper bound of its light at a point, on any surface.
    pub(super) fn at_most(&self, point: Vec3) -> f32 {
        let middle = self.middle();
        let radius =
            self.corners.map(|corner| corner.distance(middle)).into_iter().fold(0.0, f32::max);
        let near = (point.distance(middle) - radius).max(0.0);
        let solid = (self.area / (near * near).max(1.0e-6)).min(std::f32::consts::TAU);
        if self.normal.dot(point - middle) <= 0.0 {
            0.0
        } else {
            self.radiance.max_element() * solid
        }
    }

    /// Its light at a surface, were nothing in its way.
    pub(super) fn unhidden(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let corners = self.corners.map(|corner| corner - point);
        self.radiance * irradiance_of_polygon(&corners, normal).abs()
    }

    /// A point on the triangle for two numbers from 0 to 1, evenly over its area.
    pub(super) fn point(&self, [u, v]: [f32; 2]) -> Vec3 {
        let [a, b, c] = self.corners;
        let root = u.sqrt();
        a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v)
    }
}
