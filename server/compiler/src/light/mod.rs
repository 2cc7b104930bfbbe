//! Light for models that bring none: [`radiosity`], or ambient light.
//!
//! *Ambient light* is ambient occlusion and one soft lamp, which make corners, edges and objects on
//! a floor visible. Radiosity begins with its patches and points.
//!
//! Triangles in one plane make patches. Light is found at the points of a lattice on each patch.
//! From each point, rays go out over the side that the patch shows. Surfaces that they meet nearby
//! take light away, near ones more. Rays towards the lamp count more. Between points, light is
//! linear. A wall that crosses a patch separates points: a place takes light only from those that
//! it sees. All this depends on the triangles alone and uses no random numbers.

mod lattice;
mod patch;
mod patches;
mod radiosity;
mod shell;
mod varying;

use std::{
    ops::ControlFlow,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed},
};

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::light::{BakedLight, shoulder};

use crate::{
    model::{Model, Surface},
    palette::Shade,
};
use patch::Patch;
pub(crate) use radiosity::Reference;
pub use radiosity::{LightFigures, LightQuality};
use radiosity::{RadiosityInput, Solved};
use shell::Shell;

/// Points are this far apart, in metres …
const SPACING_MIN: f32 = 0.22;
/// … or this many voxels, whichever is more …
const SPACING_VOXELS: f32 = 5.0;
/// … and farther in large buildings, so that there are about this many points …
const POINTS: f64 = 300_000.0;
/// … and that the edges of all triangles are no longer than this many steps.
const EDGE_STEPS: f64 = 4.0e6;

/// How a model that brings no light of its own is lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightMethod {
    /// Surfaces pass light on to each other, from the sun, the sky, lamps, and surfaces that give
    /// light.
    Radiosity,
    /// Ambient occlusion and one soft lamp.
    #[default]
    Ambient,
    /// Surfaces have their own colours.
    None,
}

/// The light of some surfaces.
pub struct Light {
    shell: Shell,
    patches: Vec<Patch>,
    /// The patch of each triangle of each surface. [`NO_PATCH`] for triangles without area.
    of_triangle: Vec<Vec<u32>>,
    /// How far apart points are, in metres.
    spacing: f32,
    /// Whether light is linear, as radiosity finds it. Else it is a factor on sRGB colours.
    is_linear: bool,
}

/// The share of the time of radiosity that finding patches and points takes.
const PATCHES_SHARE: f32 = 0.15;

const NO_PATCH: u32 = u32::MAX;

/// A place where light is wanted.
#[derive(Clone, Copy)]
pub(crate) struct PatchLight<'a> {
    shell: &'a Shell,
    patch: &'a Patch,
    is_linear: bool,
}

impl Light {
    /// The light of surfaces among opaque triangles, for voxels of this edge in metres. `along` is
    /// a level direction of the building's walls. None when `progress`, which hears the share that
    /// is done from any thread, breaks.
    pub fn new(
        surfaces: &[Surface],
        opaque: &[[Vec3; 3]],
        along: Vec3,
        voxel: f32,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<Self> {
        let spacing = spacing(surfaces, voxel);
        let shell = Shell::new(opaque);
        let (done, is_cancelled) = (AtomicUsize::new(0), AtomicBool::new(false));
        let light = |surface: &Surface| {
            let groups = patches::patches(surface);
            let mut of_triangle = vec![NO_PATCH; surface.triangles.len()];
            let mut parts = Vec::with_capacity(groups.len());
            for group in &groups {
                for part in patch::parts(surface, group, along, spacing) {
                    for &triangle in &part.triangles {
                        of_triangle[triangle as usize] = parts.len() as u32;
                    }
                    parts.push(part);
                }
            }
            let patches: Vec<Patch> = parts
                .into_par_iter()
                .filter_map(|part| (!is_cancelled.load(Relaxed)).then(|| part.lit(&shell)))
                .collect();
            let share = (done.fetch_add(1, Relaxed) + 1) as f32 / surfaces.len() as f32;
            if progress(share).is_break() {
                is_cancelled.store(true, Relaxed);
            }
            (patches, of_triangle)
        };
        let lit: Vec<_> = surfaces.par_iter().map(light).collect();
        if is_cancelled.into_inner() {
            return None;
        }
        let (mut patches, mut of_triangle) = (Vec::new(), Vec::with_capacity(surfaces.len()));
        for (more, mut of_surface) in lit {
            let first = patches.len() as u32;
            for patch in of_surface.iter_mut().filter(|patch| **patch != NO_PATCH) {
                *patch += first;
            }
            patches.extend(more);
            of_triangle.push(of_surface);
        }
        assert_eq!(of_triangle.len(), surfaces.len(), "each surface is lit");
        Some(Self { shell, patches, of_triangle, spacing, is_linear: false })
    }

    /// The light of a model by radiosity, that for what moves, and figures. `along` and `voxel` are
    /// those of [`Light::new`]. None when `progress` breaks.
    pub fn by_radiosity(
        model: &Model,
        along: Vec3,
        voxel: f32,
        quality: LightQuality,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<(Self, BakedLight, LightFigures)> {
        let (light, solved) = Self::solved(model, along, voxel, quality, progress)?;
        Some((light, solved.baked, solved.figures))
    }

    fn solved(
        model: &Model,
        along: Vec3,
        voxel: f32,
        quality: LightQuality,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<(Self, Solved)> {
        let early = |share: f32| progress(share * PATCHES_SHARE);
        let mut light = Self::new(&model.surfaces, &model.opaque, along, voxel, &early)?;
        let late = |share: f32| progress(PATCHES_SHARE + share * (1.0 - PATCHES_SHARE));
        let input = RadiosityInput {
            surfaces: &model.surfaces,
            of_triangle: &light.of_triangle,
            lamps: &model.lamps,
            has_sky: model.has_sky,
            body: &model.body,
            movers: &model.movers,
            quality,
            voxels_between: light.spacing / voxel,
        };
        let solved = radiosity::light(&mut light.patches, &light.shell, &input, &late)?;
        light.is_linear = true;
        Some((light, solved))
    }

    /// The light on a triangle. None when it has no area.
    pub(crate) fn of(&self, surface: usize, triangle: usize) -> Option<PatchLight<'_>> {
        let number = *self.of_triangle.get(surface)?.get(triangle)?;
        let patch = self.patches.get(number as usize)?;
        Some(PatchLight { shell: &self.shell, patch, is_linear: self.is_linear })
    }
}

impl PatchLight<'_> {
    /// The light at a point.
    pub(crate) fn at(&self, point: Vec3) -> Shade {
        let light = self.patch.at(point, self.shell);
        match self.is_linear {
            true => Shade::Linear(shoulder(light)),
            false => Shade::Factor(light.x),
        }
    }
}

/// How far apart points are, in metres.
fn spacing(surfaces: &[Surface], voxel: f32) -> f32 {
    let (mut area, mut edges) = (0.0, 0.0);
    for [a, b, c] in surfaces.iter().flat_map(Surface::corners) {
        if a.is_finite() && b.is_finite() && c.is_finite() {
            area += f64::from((b - a).cross(c - a).length() / 2.0);
            edges += f64::from(a.distance(b) + b.distance(c) + c.distance(a));
        }
    }
    let for_many = (area / POINTS).sqrt().max(edges / EDGE_STEPS) as f32;
    for_many.max(SPACING_MIN).max(SPACING_VOXELS * voxel)
}

#[cfg(test)]
mod tests;
