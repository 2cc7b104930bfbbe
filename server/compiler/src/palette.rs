//! The colours of triangles: material × texture × vertex colour, with the texture averaged over a
//! voxel.

use std::{collections::HashMap, sync::Arc};

use glam::{Vec2, Vec3};
use sightline_picture::Picture;
use sightline_world::light::GAMMA;

use crate::model::{Surface, SurfaceMaterial};

/// The least value of a channel of glass, from 0 to 1. The palette of the octree keeps it apart
/// from black.
const GLASS_LEAST: f32 = 0.13;

/// The mean of a texture is that of about this many of its texels.
const TEXELS: usize = 4_096;

/// The light on a place.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shade {
    /// A factor on sRGB colours.
    Factor(f32),
    /// Linear light: where it is 1, a surface has its own colour.
    Linear(Vec3),
}

/// The textures of a model, each with its smaller copies (a mipmap; Williams 1983).
pub(crate) struct Palette {
    /// Mipmaps by the address of the texture, since many surfaces share one.
    textures: HashMap<usize, Vec<Picture>>,
}

/// The material of one triangle.
pub(crate) struct TriangleMaterial<'a> {
    /// Whether sight passes through.
    pub(crate) glass: bool,
    /// The least value of a channel.
    least: f32,
    colours: [Vec3; 3],
    texture: Option<(&'a Picture, [Vec2; 3])>,
    /// The light that it gives, in linear RGB.
    emission: Vec3,
}

impl Palette {
    /// The mipmaps of all textures of some surfaces.
    pub(crate) fn new(surfaces: &[Surface]) -> Self {
        let mut textures = HashMap::new();
        for texture in surfaces.iter().filter_map(|surface| surface.material.texture.as_ref()) {
            if texture.width() > 0 && texture.height() > 0 {
                textures.entry(address(texture)).or_insert_with(|| halvings(texture));
            }
        }
        Self { textures }
    }

    /// The material of a triangle, for voxels of this edge in metres. `None` when there is no such
    /// triangle.
    pub(crate) fn material_of(
        &self,
        surface: &Surface,
        triangle: usize,
        voxel: f32,
    ) -> Option<TriangleMaterial<'_>> {
        let corners = surface.corners_of(triangle)?;
        let indices = *surface.triangles.get(triangle)?;
        let tint = unit(surface.material.colour);
        let colours = indices.map(|i| {
            tint * surface.colours.get(i as usize).map_or(Vec3::ONE, |&colour| unit(colour))
        });
        let texture = surface.material.texture.as_ref().and_then(|texture| {
            let halvings = self.textures.get(&address(texture))?;
            let [Some(a), Some(b), Some(c)] = indices.map(|i| surface.uvs.get(i as usize).copied())
            else {
                return None;
            };
            Some((level_for(halvings, [a, b, c], corners, voxel), [a, b, c]))
        });
        let glass = surface.material.glass;
        // Glass that is black is not seen at all.
        let least = if glass && !surface.material.is_unseen() { GLASS_LEAST } else { 0.0 };
        let emission = Vec3::from(surface.material.emission);
        Some(TriangleMaterial { glass, least, colours, texture, emission })
    }
}

impl TriangleMaterial<'_> {
    /// The sRGB colour, from 0 to 1, at the point with these barycentric weights, in some light.
    pub(crate) fn colour(&self, weights: [f32; 3], shade: Shade) -> Vec3 {
        let [a, b, c] = weights;
        let colour = self.colours[0] * a + self.colours[1] * b + self.colours[2] * c;
        let colour = match self.texture {
            Some((image, uvs)) => colour * texel(image, uvs[0] * a + uvs[1] * b + uvs[2] * c),
            None => colour,
        };
        let lit = match shade {
            Shade::Factor(factor) => colour * factor,
            Shade::Linear(light) if self.emission == Vec3::ZERO => colour * light.powf(GAMMA),
            Shade::Linear(light) => (colour.powf(1.0 / GAMMA) * light + self.emission).powf(GAMMA),
        };
        lit.max(Vec3::splat(self.least))
    }
}

/// The mean linear colour of a material.
pub(crate) fn reflectance(material: &SurfaceMaterial) -> Vec3 {
    let colour = linear(unit(material.colour));
    let Some(texels) = material.texture.as_ref().map(|texture| texture.pixels()) else {
        return colour;
    };
    let step = texels.len().div_ceil(TEXELS).max(1);
    let some = || texels.iter().step_by(step);
    let sum: Vec3 = some().map(|texel| linear(unit(*texel))).sum();
    colour * sum / some().count().max(1) as f32
}

/// The mean of the linear colours of a triangle's corners.
pub(crate) fn mean_tint(surface: &Surface, triangle: usize) -> Vec3 {
    let corners = surface.triangles[triangle];
    let tint = |corner: u32| {
        surface.colours.get(corner as usize).map_or(Vec3::ONE, |colour| linear(unit(*colour)))
    };
    corners.into_iter().map(tint).sum::<Vec3>() / 3.0
}

/// Linear RGB of sRGB, both from 0 to 1.
pub(crate) fn linear(colour: Vec3) -> Vec3 {
    let of = |value: f32| match value <= 0.040_45 {
        true => value / 12.92,
        false => ((value + 0.055) / 1.055).powf(2.4),
    };
    Vec3::from_array(colour.to_array().map(of))
}

fn address(texture: &Arc<Picture>) -> usize {
    Arc::as_ptr(texture).addr()
}

fn unit(colour: [u8; 3]) -> Vec3 {
    Vec3::from(colour.map(f32::from)) / 255.0
}

/// The mipmap of an image: the image, and copies of half the size each, down to one texel.
fn halvings(image: &Picture) -> Vec<Picture> {
    let mut levels = vec![image.clone()];
    while let Some(last) = levels.last().filter(|last| last.width() * last.height() > 1) {
        let (width, height) = (last.width().div_ceil(2), last.height().div_ceil(2));
        let halved = Picture::from_fn(width, height, |x, y| {
            let at = |dx: u32, dy: u32| {
                let x = (2 * x + dx).min(last.width() - 1);
                let y = (2 * y + dy).min(last.height() - 1);
                last.pixel(x, y).map(u16::from)
            };
            let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
            let mean = |i: usize| (four.iter().map(|texel| texel[i]).sum::<u16>() + 2) / 4;
            [0, 1, 2].map(|i| mean(i) as u8)
        });
        levels.push(halved);
    }
    levels
}

/// The level of a mipmap whose texels are about as large as a voxel on this triangle.
fn level_for(levels: &[Picture], uvs: [Vec2; 3], corners: [Vec3; 3], voxel: f32) -> &Picture {
    let size = Vec2::new(levels[0].width() as f32, levels[0].height() as f32);
    let [a, b, c] = uvs.map(|uv| uv * size);
    let texels = (b - a).perp_dot(c - a).abs();
    let square_metres = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
    let across = (texels / square_metres).sqrt() * voxel;
    let level = if across.is_finite() { across.max(1.0).log2().round() as usize } else { 0 };
    &levels[level.min(levels.len() - 1)]
}

/// The colour of a texture at coordinates, which repeat. Between texels it is blended.
fn texel(image: &Picture, uv: Vec2) -> Vec3 {
    let uv = if uv.is_finite() { uv - uv.floor() } else { Vec2::ZERO };
    let (width, height) = (image.width(), image.height());
    let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
    let (low, part) = (at.floor(), at - at.floor());
    let wrap = |i: f32, size: u32| (i as i64).rem_euclid(i64::from(size)) as u32;
    let get =
        |dx: f32, dy: f32| unit(image.pixel(wrap(low.x + dx, width), wrap(low.y + dy, height)));
    let top = get(0.0, 0.0).lerp(get(1.0, 0.0), part.x);
    top.lerp(get(0.0, 1.0).lerp(get(1.0, 1.0), part.x), part.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halvings_keep_the_mean() {
        let checks = Picture::from_fn(8, 4, |x, y| [((x + y) % 2 * 200) as u8, 40, 0]);
        let levels = halvings(&checks);
        assert_eq!(
            levels.iter().map(|l| l.dimensions()).collect::<Vec<_>>(),
            [(8, 4), (4, 2), (2, 1), (1, 1)]
        );
        assert!(levels[1..].iter().flat_map(|l| l.pixels()).all(|p| *p == [100, 40, 0]));
    }

    #[test]
    fn textures_repeat_and_blend() {
        let image = Picture::from_fn(2, 1, |x, _| [x as u8 * 255; 3]);
        for whole in [-3.0, 0.0, 2.0] {
            let at = |u: f32| texel(&image, Vec2::new(whole + u, 0.3)).x;
            assert!(at(0.25) < 1.0e-3 && at(0.75) > 0.999);
            assert!((at(0.5) - 0.5).abs() < 1.0e-3 && (at(0.0) - 0.5).abs() < 1.0e-3);
        }
        assert_eq!(texel(&image, Vec2::NAN).x, texel(&image, Vec2::ZERO).x);
    }
}
