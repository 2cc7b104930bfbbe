//! Light, sky and glass.

use glam::Vec3;
use sightline_shared::octree::Look;

/// Two lamps that never move, and how strong they are: every side of a box looks different.
const LAMPS: [(Vec3, f32); 2] =
    [(Vec3::new(0.48, 0.82, 0.31), 0.38), (Vec3::new(-0.55, 0.08, -0.83), 0.28)];

/// What reaches every surface.
const AMBIENT: f32 = 0.62;

/// What is far takes on the colour of the air, by half at this many metres.
const HAZE_M: f32 = 160.0;

const HORIZON: Vec3 = Vec3::new(214.0, 224.0, 232.0);
const ZENITH: Vec3 = Vec3::new(108.0, 156.0, 214.0);
const GROUND: Vec3 = Vec3::new(132.0, 128.0, 122.0);

/// How much of a pane's colour covers what is behind.
const GLASS_SHARE: f32 = 0.3;

/// A look's colour in the light, as 0x00RRGGBB. `along` points from the eye to it, in metres.
pub(super) fn surface(look: &Look, along: Vec3) -> u32 {
    let normal = Vec3::from(look.normal.map(f32::from)) / 127.0;
    lit(Vec3::from(look.colour.map(f32::from)), normal, along)
}

/// A colour in the light and behind the air, as 0x00RRGGBB. `along` points from the eye to it.
pub(super) fn lit(colour: Vec3, normal: Vec3, along: Vec3) -> u32 {
    let colour = colour * light(normal, along);
    let haze = along.length() / (along.length() + HAZE_M);
    pack(colour.lerp(HORIZON, haze * haze))
}

/// The light on a surface, whichever side of it faces the eye.
pub(super) fn light(normal: Vec3, along: Vec3) -> f32 {
    let normal = if normal.dot(along) > 0.0 { -normal } else { normal };
    AMBIENT + LAMPS.iter().map(|(lamp, power)| power * normal.dot(*lamp).max(0.0)).sum::<f32>()
}

/// The sky along a line of sight.
pub(super) fn sky(ray: Vec3) -> u32 {
    let height = ray.y / ray.length();
    let end = if height > 0.0 { ZENITH } else { GROUND };
    pack(HORIZON.lerp(end, height.abs().sqrt()))
}

/// What is seen through a pane.
pub(super) fn through_glass(behind: u32, glass: u32) -> u32 {
    pack(unpack(behind).lerp(unpack(glass), GLASS_SHARE))
}

pub(super) fn pack(colour: Vec3) -> u32 {
    let [r, g, b] = colour.to_array().map(|channel| channel as u8);
    u32::from_be_bytes([0, r, g, b])
}

fn unpack(colour: u32) -> Vec3 {
    let [_, r, g, b] = colour.to_be_bytes();
    Vec3::new(r.into(), g.into(), b.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sides_of_a_box_can_be_told_apart() {
        let lights: Vec<f32> = Vec3::AXES
            .iter()
            .flat_map(|&axis| [axis, -axis])
            .map(|normal| light(normal, -normal))
            .collect();
        for (i, a) in lights.iter().enumerate() {
            assert!((0.5..=1.02).contains(a));
            for b in &lights[i + 1..] {
                assert!((a - b).abs() > 0.015, "{lights:?}");
            }
        }
    }

    #[test]
    fn both_sides_of_a_sheet_are_lit() {
        let normal = Vec3::new(0.6, 0.8, 0.0);
        assert_eq!(light(normal, -Vec3::Y), light(-normal, -Vec3::Y));
    }
}
