//! The material of a voxel: the mean of what touches it.

use glam::Vec3;
use sightline_world::octree::{Material, Voxel};

/// A weighted mean of colours and normals.
#[derive(Default)]
pub(super) struct MaterialMean {
    weight: f32,
    colour: Vec3,
    normal: Vec3,
}

impl MaterialMean {
    /// Adds a sample.
    pub(super) fn add(&mut self, weight: f32, colour: Vec3, normal: Vec3) {
        self.weight += weight;
        self.colour += colour * weight;
        // The two sides of a thin sheet must not cancel out. A drawn voxel faces the eye anyway.
        let side = if self.normal.dot(normal) < 0.0 { -1.0 } else { 1.0 };
        self.normal += normal * (weight * side);
    }

    /// The voxel of this mean.
    pub(super) fn voxel(&self, key: u64, glass: bool) -> Voxel {
        debug_assert!(self.weight > 0.0, "something touches the voxel");
        let colour = (self.colour / self.weight).clamp(Vec3::ZERO, Vec3::ONE) * 255.0;
        let normal = self.normal.normalize_or_zero() * 127.0;
        Voxel {
            key,
            colour: colour.to_array().map(|channel| channel.round() as u8),
            normal: normal.to_array().map(|part| part.round() as i8),
            flags: if glass { Material::GLASS } else { 0 },
        }
    }
}
