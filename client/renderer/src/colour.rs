//! Colours: light, air, sky and glass.

use glam::{Vec3, Vec3A};
use sightline_world::{light::ShownLight, octree::Material};

use super::mask::BLOCK;

/// Two fixed lamps and their strengths, for movers and figures where no baked light is known. With
/// them every side of a box has a different colour.
const LAMPS: [(Vec3, f32); 2] =
    [(Vec3::new(0.48, 0.82, 0.31), 0.38), (Vec3::new(-0.55, 0.08, -0.83), 0.28)];

/// The light that reaches every surface.
const AMBIENT: f32 = 0.62;

/// How fast far surfaces take on the colour of the air: at a distance of d metres its share is the
/// square of d / (d + `HAZE_M`).
const HAZE_M: f32 = 160.0;

const HORIZON: Vec3 = Vec3::new(214.0, 224.0, 232.0);
/// [`HORIZON`] as 0x00RRGGBB.
const HORIZON_COLOUR: u32 = 0x00d6_e0e8;
const ZENITH: Vec3 = Vec3::new(108.0, 156.0, 214.0);
const GROUND: Vec3 = Vec3::new(132.0, 128.0, 122.0);

/// The share of a pane's colour in what is seen through it.
const GLASS_SHARE: f32 = 0.3;

/// The colour of a material as 0x00RRGGBB. The light is baked into it.
pub(super) fn of_material(material: &Material) -> u32 {
    let [r, g, b] = material.colour;
    u32::from_be_bytes([0, r, g, b])
}

/// A colour as 0x00RRGGBB, seen through this many metres of air.
#[inline(always)]
pub(super) fn hazed(colour: u32, distance: f32) -> u32 {
    let share = distance / (HAZE_M + distance);
    // At this size one step of a float is 1, so its lowest bits hold the whole number. This takes
    // less time than a cast.
    let share = (share * share * 256.0 + 8_388_608.0).to_bits() & 0x1ff;
    let mix = |mask: u32| {
        let (from, to) = (colour >> 8 & mask, HORIZON_COLOUR >> 8 & mask);
        from * (256 - share) + to * share
    };
    let low = |mask: u32| {
        let (from, to) = (colour & mask, HORIZON_COLOUR & mask);
        (from * (256 - share) + to * share) >> 8 & mask
    };
    (mix(0x0000_00ff) & 0x0000_ff00) | low(0x00ff_00ff)
}

/// The colour of a lit surface seen through air, as 0x00RRGGBB. `along` leads from the eye to the
/// surface, in metres. Without `baked` light, two fixed lamps light it.
pub(super) fn lit(colour: Vec3, normal: Vec3, along: Vec3, baked: Option<&ShownLight>) -> u32 {
    let colour = match baked {
        None => colour * light(normal, along),
        Some(baked) => {
            let facing = if normal.dot(along) > 0.0 { -normal } else { normal };
            colour * baked.tint * baked_outside(&baked.sides, facing.to_array(), 1.0)
        }
    };
    let haze = along.length() / (along.length() + HAZE_M);
    pack(colour.lerp(HORIZON, haze * haze))
}

/// The light on a surface, on the side that faces the eye.
pub(super) fn light(normal: Vec3, along: Vec3) -> f32 {
    let normal = if normal.dot(along) > 0.0 { -normal } else { normal };
    light_outside(normal.to_array(), 1.0)
}

/// The light on a surface that is seen from outside. `normal` points along its normal, and `scale`
/// is one over the length of `normal`.
#[inline(always)]
pub(super) fn light_outside(normal: [f32; 3], scale: f32) -> f32 {
    let mut light = AMBIENT;
    for (lamp, power) in LAMPS {
        let share = normal[0] * lamp.x + normal[1] * lamp.y + normal[2] * lamp.z;
        light += power * if share > 0.0 { share * scale } else { 0.0 };
    }
    light
}

/// Baked light on a surface that is seen from outside, without its tint. `normal` points along its
/// normal, and `scale` is one over the square of the length of `normal`.
#[inline(always)]
pub(super) fn baked_outside(sides: &[f32; 6], normal: [f32; 3], scale: f32) -> f32 {
    let mut light = 0.0;
    for axis in 0..3 {
        let side = if normal[axis] > 0.0 { sides[2 * axis + 1] } else { sides[2 * axis] };
        light += normal[axis] * normal[axis] * side;
    }
    light * scale
}

/// The colours of the sky along eight lines of sight, each `step` beside the one before.
#[inline(always)]
pub(super) fn sky_line(first: Vec3A, step: Vec3A) -> [u32; BLOCK] {
    let (toward_zenith, toward_ground) = (ZENITH - HORIZON, GROUND - HORIZON);
    let mut colours = [0; BLOCK];
    for (i, colour) in colours.iter_mut().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|axis| first[axis] + step[axis] * i as f32);
        let height = y / (x * x + y * y + z * z).sqrt();
        let share = height.abs().sqrt();
        for channel in 0..3 {
            let toward = if height > 0.0 { toward_zenith[channel] } else { toward_ground[channel] };
            // The lowest bits hold the whole number, as above.
            let level = (HORIZON[channel] + toward * share + 8_388_608.0).to_bits() & 0xff;
            *colour = *colour << 8 | level;
        }
    }
    colours
}

/// The colour of the sky along a line of sight.
#[cfg(test)]
pub(super) fn sky(ray: Vec3) -> u32 {
    sky_line(ray.into(), Vec3A::ZERO)[0]
}

/// A colour seen through a pane of another colour. Black is the pane of what only stops bodies
/// (`Material::GLASS`): it tints nothing.
pub(super) fn through_glass(behind: u32, glass: u32) -> u32 {
    if glass == 0 {
        return behind;
    }
    pack(unpack(behind).lerp(unpack(glass), GLASS_SHARE))
}

/// A colour with channels from 0 to 255, as 0x00RRGGBB. Channels saturate.
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
    fn from_outside_the_light_is_the_same() {
        for normal in [Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.3, -0.1, 0.7), -Vec3::Z] {
            let (length, along) = (normal.length(), -normal);
            let light = light(normal / length, along);
            assert!((light_outside(normal.to_array(), 1.0 / length) - light).abs() < 1e-6);
        }
    }

    #[test]
    fn baked_light_lies_on_the_sides_that_face_it() {
        let sides = [0.1, 0.9, 0.3, 0.7, 0.5, 0.2];
        let at =
            |normal: Vec3| baked_outside(&sides, normal.to_array(), 1.0 / normal.length_squared());
        for (axis, pair) in Vec3::AXES.into_iter().zip(sides.as_chunks::<2>().0) {
            assert_eq!([at(-axis * 3.0), at(axis * 0.5)], *pair);
        }
        assert!((at(Vec3::new(1.0, 1.0, -1.0)) - (0.9 + 0.7 + 0.5) / 3.0).abs() < 1.0e-6);
        let warm = ShownLight { sides, tint: Vec3::new(1.0, 0.5, 0.25) };
        let seen = lit(Vec3::splat(200.0), Vec3::X, Vec3::X * 1.0e-3, Some(&warm));
        assert_eq!(seen, 0x0014_0a05, "the side that faces the eye is that at -x");
    }

    #[test]
    fn glass_tints_unless_it_is_black() {
        assert_eq!(through_glass(0x00c8_6432, 0), 0x00c8_6432);
        assert_eq!(through_glass(0x0064_6464, 0x00c8_0000), 0x0082_4646);
    }

    #[test]
    fn both_sides_of_a_sheet_are_lit() {
        let normal = Vec3::new(0.6, 0.8, 0.0);
        assert_eq!(light(normal, -Vec3::Y), light(-normal, -Vec3::Y));
    }
}
