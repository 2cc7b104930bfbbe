//! Exposure: how light becomes colour.

use std::f32::consts::PI;

use glam::Vec3;

use super::nodes::{NO_NODE, Nodes};

/// The geometric mean of the light indoors in the picture: white walls there are light grey.
const INDOORS: f32 = 0.42;
/// Light that is less than this in the picture stays as it is …
const SHOULDER: f32 = 0.6;
/// … and more light never exceeds this.
const BRIGHTEST: f32 = 1.15;
/// Luminance of linear RGB.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// The factor from irradiance to the picture. Points count less the more sky their nodes see, so
/// that rooms are well lit whatever is outdoors.
pub(super) fn choose(nodes: &Nodes, open: &[f32], light: &[Option<Vec3>]) -> f32 {
    let (mut indoors, mut anywhere) = ([0.0f64; 2], [0.0f64; 2]);
    for (point, light) in light.iter().enumerate() {
        let (Some(light), node) = (light, nodes.node_of[point]) else { continue };
        let level = light.dot(LUMINANCE);
        if node == NO_NODE || level <= 1.0e-6 {
            continue;
        }
        let node = node as usize;
        let area = f64::from(nodes.list[node].area) / nodes.list[node].points.len() as f64;
        let inside = f64::from((1.0 - 3.0 * open[node]).max(0.0)) * area;
        for (sum, weight) in [(&mut indoors, inside), (&mut anywhere, area)] {
            sum[0] += f64::from(level.ln()) * weight;
            sum[1] += weight;
        }
    }
    let [sum, weight] = if indoors[1] > 0.02 * anywhere[1] { indoors } else { anywhere };
    if weight > 0.0 { INDOORS / (sum / weight).exp() as f32 } else { 1.0 / PI }
}

/// Light in the picture: bright light is compressed, and keeps its hue.
pub(crate) fn shoulder(light: Vec3) -> Vec3 {
    let level = light.max_element();
    if level <= SHOULDER {
        return light;
    }
    let room = BRIGHTEST - SHOULDER;
    let compressed = SHOULDER + room * (1.0 - (-(level - SHOULDER) / room).exp());
    light * (compressed / level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bright_light_is_compressed_without_a_step() {
        let at = |level: f32| shoulder(Vec3::new(level, level / 2.0, 0.0));
        assert_eq!(at(0.5), Vec3::new(0.5, 0.25, 0.0));
        let mut before = at(0.59);
        for i in 60..2_000 {
            let light = at(i as f32 / 100.0);
            assert!(light.x >= before.x - 1.0e-6 && light.x - before.x < 0.0101, "{i}");
            assert!((light.x - 2.0 * light.y).abs() < 1.0e-6 && light.x < BRIGHTEST + 1.0e-6);
            before = light;
        }
    }
}
