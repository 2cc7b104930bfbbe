//! Exposure: how bright the picture is.

use std::f32::consts::PI;

use glam::Vec3;

use super::nodes::{NO_NODE, Nodes};

/// The geometric mean of the light indoors in the picture: white walls there are light grey.
const INDOORS: f32 = 0.42;
/// Luminance of linear RGB.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Points with less than this share of the mean light do not count: nobody lights closed shafts.
const DARK: f64 = 0.02;

/// The factor from irradiance to the picture. Points count less the more sky their nodes see, so
/// that rooms are well lit whatever is outdoors.
pub(super) fn choose(nodes: &Nodes, open: &[f32], light: &[Option<Vec3>]) -> f32 {
    let levels: Vec<Level> = light
        .iter()
        .zip(&nodes.node_of)
        .filter(|(_, node)| **node != NO_NODE)
        .filter_map(|(light, node)| {
            let (of, open) = (&nodes.list[*node as usize], open[*node as usize]);
            let area = f64::from(of.area) / of.points.len() as f64;
            let indoors = f64::from((1.0 - 3.0 * open).max(0.0)) * area;
            Some(Level { light: f64::from((*light)?.dot(LUMINANCE)), area, indoors })
        })
        .collect();
    let area = |of: fn(&Level) -> f64| levels.iter().map(of).sum::<f64>();
    let weight: fn(&Level) -> f64 =
        if area(|l| l.indoors) > 0.02 * area(|l| l.area) { |l| l.indoors } else { |l| l.area };
    let mean = levels.iter().map(|level| level.light * weight(level)).sum::<f64>()
        / area(weight).max(f64::MIN_POSITIVE);
    let lit = || levels.iter().filter(|level| level.light > DARK * mean);
    let sum: f64 = lit().map(|level| level.light.ln() * weight(level)).sum();
    let weights: f64 = lit().map(weight).sum();
    if weights > 0.0 { INDOORS / (sum / weights).exp() as f32 } else { 1.0 / PI }
}

/// The light at a point.
struct Level {
    light: f64,
    /// In square metres.
    area: f64,
    /// The same, less what sees the sky.
    indoors: f64,
}
