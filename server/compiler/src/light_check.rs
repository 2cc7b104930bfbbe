//! Compares radiosity with a reference: pictures by paths of light, traced one by one.
//!
//! Both pictures show the original triangles, not voxels, and take the mean colour of each patch,
//! so that they differ in light alone.

use std::ops::ControlFlow;

use glam::{Quat, Vec3};
use rayon::prelude::*;
use sightline_picture::Picture;
use sightline_world::{
    geometry::Axes,
    light::{GAMMA, shoulder},
};

use crate::{
    carve,
    light::{LightFigures, LightQuality, Reference},
    model::Model,
};

/// A building that was lit for a comparison.
pub struct LightCheck {
    reference: Reference,
}

/// A place to look from.
#[derive(Clone, Copy, Debug)]
pub struct CheckView {
    /// The eye, in metres.
    pub eye: Vec3,
    /// A point to look at, in metres, which is not straight above or below the eye.
    pub look: Vec3,
    /// Pixels across and down.
    pub size: [u32; 2],
}

/// The outcome of one view.
pub struct ViewCheck {
    /// The picture by radiosity.
    pub radiosity: Picture,
    /// The picture by paths.
    pub reference: Picture,
    /// The mean of all channels of all pixels in linear light, by radiosity and by paths. White
    /// surfaces in good light have 1.
    pub means: [f64; 2],
    /// The mean over pixels of the absolute difference, as a share of the reference's mean.
    pub difference: f64,
}

impl LightCheck {
    /// Lights a model by radiosity, for voxels of this edge in metres. None when `progress`, which
    /// hears the share that is done from any thread, breaks.
    pub fn new(
        model: &Model,
        voxel: f32,
        quality: LightQuality,
        progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
    ) -> Option<Self> {
        let axes = Axes::turned(carve::dominant_orientation(&model.opaque));
        let reference = Reference::new(model, axes.world(Vec3::X), voxel, quality, progress)?;
        Some(Self { reference })
    }

    /// The figures of the light.
    pub fn figures(&self) -> LightFigures {
        self.reference.figures()
    }

    /// Compares the light in a view, with this many paths for each pixel.
    pub fn view(&self, view: &CheckView, paths: usize) -> ViewCheck {
        let [width, height] = view.size;
        let forward = (view.look - view.eye).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(Vec3::Y).normalize_or(Vec3::X);
        let turn = Quat::from_mat3(&glam::Mat3::from_cols(right, right.cross(forward), -forward));
        let scale = 2.0 * (35.0f32.to_radians()).tan() / height as f32;
        let pixel = |i: u32| {
            let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let (x, y) = ((x - width as f32 / 2.0) * scale, (height as f32 / 2.0 - y) * scale);
            let along = turn * Vec3::new(x, y, -1.0).normalize();
            let pair = self.reference.along(view.eye, along, paths, u64::from(i));
            pair.map(|pair| [pair.radiosity * pair.colour, pair.reference * pair.colour])
        };
        let pixels: Vec<Option<[Vec3; 2]>> =
            (0..width * height).into_par_iter().map(pixel).collect();
        let mean = |of: &dyn Fn(&[Vec3; 2]) -> f32| {
            let all = pixels.iter().flatten().map(|pair| f64::from(of(pair))).sum::<f64>();
            all / pixels.iter().flatten().count().max(1) as f64 / 3.0
        };
        let picture = |i: usize| {
            Picture::from_fn(width, height, |x, y| {
                let light = pixels[(y * width + x) as usize].map_or(Vec3::ONE, |pair| pair[i]);
                let shown = shoulder(light).powf(GAMMA).min(Vec3::ONE) * 255.0;
                shown.to_array().map(|channel| channel.round() as u8)
            })
        };
        let means = [0, 1].map(|i| mean(&|pair| pair[i].element_sum()));
        let away = mean(&|[one, other]| (*one - *other).abs().element_sum());
        let difference = away / means[1].max(f64::MIN_POSITIVE);
        ViewCheck { radiosity: picture(0), reference: picture(1), means, difference }
    }
}
