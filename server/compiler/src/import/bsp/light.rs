//! Baked light: the lightmaps of a map.

use glam::{Vec2, Vec3};

use super::map::{LIGHTMAP_EDGE, Map};

/// Lightmaps hold half of the light, to leave room for highlights.
const OVERBRIGHT: f32 = 2.0;
/// Maps are lit for dark rooms and a raised gamma. This raises it.
const GAMMA: f32 = 0.7;
/// The least light of a place, from 0 to 1, so that walls stay visible.
const AMBIENT: f32 = 0.16;

/// The light of one face.
#[derive(Clone, Copy)]
pub(super) enum Light<'a> {
    /// A lightmap, with coordinates from 0 to 1.
    Lightmap(&'a [u8]),
    /// Light at the vertices.
    Vertices,
}

impl<'a> Light<'a> {
    pub(super) fn of(map: &Map<'a>, lightmap: Option<usize>) -> Self {
        lightmap
            .and_then(|index| map.lightmaps.get(index))
            .map_or(Self::Vertices, |pixels| Self::Lightmap(pixels))
    }

    /// The light at a point, as a factor on sRGB colours.
    pub(super) fn at(&self, lightmap: Vec2, vertex: Vec3) -> [u8; 3] {
        let light = match self {
            Self::Lightmap(pixels) => bilinear(pixels, lightmap) * OVERBRIGHT,
            Self::Vertices => vertex * OVERBRIGHT,
        };
        // Excessive light keeps its hue.
        let light = light / light.max_element().max(255.0);
        let lifted = light.powf(GAMMA) * (1.0 - AMBIENT) + AMBIENT;
        lifted.to_array().map(|value| (value * 255.0) as u8)
    }
}

/// The colour of a lightmap, interpolated between the centres of pixels and clamped at its border.
fn bilinear(pixels: &[u8], at: Vec2) -> Vec3 {
    let edge = (LIGHTMAP_EDGE - 1) as f32;
    // A NaN coordinate becomes 0.
    let at = (at * LIGHTMAP_EDGE as f32 - 0.5).max(Vec2::ZERO).min(Vec2::splat(edge));
    let low = at.floor();
    let share = at - low;
    let pixel = |x: f32, y: f32| {
        let (x, y) = (x.min(edge) as usize, y.min(edge) as usize);
        let start = 3 * (y * LIGHTMAP_EDGE + x);
        match pixels.get(start..start + 3) {
            Some(&[r, g, b]) => Vec3::new(r.into(), g.into(), b.into()),
            _ => Vec3::ZERO,
        }
    };
    let row = |y: f32| pixel(low.x, y).lerp(pixel(low.x + 1.0, y), share.x);
    row(low.y).lerp(row(low.y + 1.0), share.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_between_pixels_is_between_theirs() {
        let mut pixels = vec![0; LIGHTMAP_EDGE * LIGHTMAP_EDGE * 3];
        pixels[0..6].copy_from_slice(&[100, 0, 0, 0, 50, 0]);
        let centre = |x: f32| Vec2::new(x + 0.5, 0.5) / LIGHTMAP_EDGE as f32;
        assert_eq!(bilinear(&pixels, centre(0.0)), Vec3::new(100.0, 0.0, 0.0));
        assert_eq!(bilinear(&pixels, centre(0.5)), Vec3::new(50.0, 25.0, 0.0));
        for odd in [f32::NAN, f32::INFINITY, -5.0, 7.0] {
            assert!(bilinear(&pixels, Vec2::splat(odd)).is_finite());
        }
    }

    #[test]
    fn too_much_light_keeps_its_hue() {
        let [r, g, b] = Light::Vertices.at(Vec2::ZERO, Vec3::new(255.0, 127.5, 0.0));
        assert_eq!(r, 255);
        assert!((165..=178).contains(&g) && (36..=44).contains(&b), "{r} {g} {b}");
    }
}
