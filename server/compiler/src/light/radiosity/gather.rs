//! The last step: light that arrives at each point from all nodes and from the sky.

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::tolerance::RAY_LIFT_M;

use super::{Surroundings, sampling::cosine_direction};
use crate::light::{patch::Spread, varying::Varying};

/// The mean over neighbours is taken anew until a point's light comes from about this many rays …
const RAYS_IN_MEAN: usize = 2_400;
/// … but no more often than this.
const MEANS_MAX: usize = 4;
/// A patch with fewer rows or columns than this is a strip.
const STRIP: usize = 3;

/// The light at all points, by this many rays from each. None inside something solid. The whole is
/// None when `go_on` says so.
pub(super) fn gather(
    around: &Surroundings<'_>,
    radiosity: &[Vec3],
    rays: usize,
    go_on: &(dyn Fn(usize) -> bool + Sync),
) -> Option<Vec<Option<Vec3>>> {
    let turns = turns(around);
    let at = |point: usize| {
        let patch = around.nodes.patch_of[point] as usize;
        if !go_on(1) {
            return None;
        }
        let light = around
            .receives(patch)
            .then(|| around.nodes.point(around.patches, point))
            .flatten()
            .map(|at| arriving(around, radiosity, at, patch, rays, turns[point]));
        Some(light)
    };
    let mut light = (0..around.nodes.patch_of.len())
        .into_par_iter()
        .map(at)
        .collect::<Option<Vec<Option<Vec3>>>>()?;
    for (index, patch) in around.patches.iter().enumerate() {
        if let Spread::Varying(varying) = &patch.spread {
            let points = around.nodes.first[index]..around.nodes.first[index + 1];
            let window = Window::of(varying);
            for _ in 0..window.means(rays) {
                window.smooth(varying, &mut light[points.clone()]);
            }
        }
    }
    Some(light)
}

/// The neighbours whose mean a point takes. They use as many different patterns of rays, so that
/// the mean has all of them.
#[derive(Clone, Copy)]
struct Window {
    /// How far it reaches along rows and across them, in points on each side.
    reach: [usize; 2],
}

impl Window {
    /// The window of a patch. On a strip, such as a facet of a round column, it is as large as
    /// elsewhere and lies lengthwise.
    fn of(varying: &Varying) -> Self {
        let [columns, rows] = varying.size();
        let reach = match (columns < STRIP, rows < STRIP) {
            (true, _) => [0, 4],
            (false, true) => [4, 0],
            (false, false) => [1, 1],
        };
        Self { reach }
    }

    /// How many points it has each way.
    fn widths(self) -> [usize; 2] {
        self.reach.map(|reach| 2 * reach + 1)
    }

    /// How the rays of a point are turned, from 0 to 1.
    fn turn(self, (column, row): (i32, i32)) -> f32 {
        let [along, across] = self.widths().map(|width| width as i32);
        let pattern = column.rem_euclid(along) + along * row.rem_euclid(across);
        pattern as f32 / (along * across) as f32
    }

    /// How often the mean is taken when each point has this many rays.
    fn means(self, rays: usize) -> usize {
        let [along, across] = self.widths();
        RAYS_IN_MEAN.div_ceil(rays * along * across).min(MEANS_MAX)
    }

    /// Gives each point the mean along its row, and then across rows. What is averaged reaches
    /// equally far to both sides, and not across walls: light falls towards an edge.
    fn smooth(self, varying: &Varying, light: &mut [Option<Vec3>]) {
        let places: Vec<(i32, i32)> = varying.places().collect();
        type Next = fn(&Varying, usize, (i32, i32)) -> Option<usize>;
        let ways = [Varying::next_along as Next, Varying::next_across as Next];
        for (next, reach) in ways.into_iter().zip(self.reach) {
            let ahead: Vec<Option<usize>> =
                places.iter().enumerate().map(|(at, place)| next(varying, at, *place)).collect();
            let mut behind = vec![None; places.len()];
            for (at, next) in ahead.iter().enumerate() {
                if let Some(next) = next {
                    behind[*next] = Some(at);
                }
            }
            let known = light.to_vec();
            for (at, of) in light.iter_mut().enumerate() {
                let Some(mut sum) = *of else { continue };
                let (mut before, mut after, mut count) = (at, at, 1);
                for _ in 0..reach {
                    let Some((b, a)) = behind[before].zip(ahead[after]) else { break };
                    let Some((light_before, light_after)) = known[b].zip(known[a]) else { break };
                    sum += light_before + light_after;
                    (before, after, count) = (b, a, count + 2);
                }
                *of = Some(sum / count as f32);
            }
        }
    }
}

/// How the rays of each point are turned, from 0 to 1.
fn turns(around: &Surroundings<'_>) -> Vec<f32> {
    let mut turns = Vec::with_capacity(around.nodes.patch_of.len());
    for patch in around.patches {
        match &patch.spread {
            Spread::Even { .. } => turns.push(0.0),
            Spread::Varying(varying) => {
                let window = Window::of(varying);
                turns.extend(varying.places().map(|place| window.turn(place)));
            }
        }
    }
    turns
}

/// The light that arrives at a point of a patch.
fn arriving(
    around: &Surroundings<'_>,
    radiosity: &[Vec3],
    at: Vec3,
    patch: usize,
    rays: usize,
    turn: f32,
) -> Vec3 {
    let normal = around.patches[patch].normal;
    let from = at + normal * RAY_LIFT_M;
    let (u, v) = normal.any_orthonormal_pair();
    let ray = |ray: usize| {
        let direction = cosine_direction(ray, rays, turn);
        let along = u * direction.x + v * direction.y + normal * direction.z;
        let end = around.scene.trace(from, along);
        let light = match &end.met {
            None => around.emitters.sky(along) * std::f32::consts::PI,
            Some(met) => around.node_at(met).map_or(Vec3::ZERO, |node| radiosity[node]),
        };
        light * end.tint
    };
    (0..rays).map(ray).sum::<Vec3>() / rays as f32
}
