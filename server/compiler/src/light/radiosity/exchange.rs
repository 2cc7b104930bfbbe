//! The exchange of light between nodes: form factors, and progressive refinement (Cohen and others
//! 1988).

use glam::Vec3;
use rayon::prelude::*;
use sightline_world::tolerance::RAY_LIFT_M;

use super::{
    Surroundings,
    sampling::{about, cosine_direction},
};

/// Light is passed on until less than this share of it is unshot. The rest gets everywhere, also
/// into closed rooms, so it has to be too little to be seen.
const UNSHOT: f64 = 1.0e-4;
/// In each round, nodes shoot that have at least this share of the light of the brightest.
const BRIGHT: f32 = 0.2;
/// Multiples of this are spread evenly, and not in step with those of the golden ratio.
const PLASTIC: f32 = 0.754_877_7;
/// The most rounds. Each passes on most of the light that is left.
const ROUNDS_MAX: usize = 200;

/// The form factors of all nodes, row by row: the shares of what a node sees.
pub(super) struct FormFactors {
    starts: Vec<usize>,
    /// The node that is seen, and its share, tinted by glass.
    entries: Vec<(u32, Vec3)>,
    /// The light of the sky on each node.
    pub(super) sky: Vec<Vec3>,
    /// The share of each node's surroundings that is the sky.
    pub(super) open: Vec<f32>,
}

/// What one node sees.
struct Row {
    entries: Vec<(u32, Vec3)>,
    sky: Vec3,
    open: f32,
}

impl FormFactors {
    /// Finds the form factors by `rays` rays from the points of each node. None when `on_row`
    /// says so.
    pub(super) fn new(
        around: &Surroundings<'_>,
        rays: usize,
        go_on: &(dyn Fn(usize) -> bool + Sync),
    ) -> Option<Self> {
        let count = around.nodes.list.len();
        let rows: Vec<Option<Row>> = (0..count)
            .into_par_iter()
            .map(|node| go_on(1).then(|| Row::new(around, node, rays)))
            .collect();
        let mut factors = Self {
            starts: vec![0],
            entries: Vec::new(),
            sky: Vec::with_capacity(count),
            open: Vec::with_capacity(count),
        };
        for row in rows {
            let row = row?;
            factors.entries.extend(row.entries);
            factors.starts.push(factors.entries.len());
            factors.sky.push(row.sky);
            factors.open.push(row.open);
        }
        assert_eq!(factors.starts.len(), count + 1, "each node has a row");
        Some(factors)
    }

    /// What a node sees: nodes and their shares, ascending.
    pub(super) fn row(&self, node: usize) -> &[(u32, Vec3)] {
        &self.entries[self.starts[node]..self.starts[node + 1]]
    }

    /// The nodes that see each node, with the shares of it that they see.
    fn columns(&self) -> (Vec<usize>, Vec<(u32, Vec3)>) {
        let count = self.sky.len();
        let mut starts = vec![0; count + 1];
        self.entries.iter().for_each(|(seen, _)| starts[*seen as usize + 1] += 1);
        for node in 0..count {
            starts[node + 1] += starts[node];
        }
        let mut next = starts.clone();
        let mut columns = vec![(0, Vec3::ZERO); self.entries.len()];
        for node in 0..count {
            for &(seen, share) in self.row(node) {
                columns[next[seen as usize]] = (node as u32, share);
                next[seen as usize] += 1;
            }
        }
        (starts, columns)
    }
}

impl Row {
    fn new(around: &Surroundings<'_>, node: usize, rays: usize) -> Self {
        let Surroundings { nodes, patches, .. } = around;
        let of = &nodes.list[node];
        let normal = patches[of.patch as usize].normal;
        let share = 1.0 / rays as f32;
        let mut seen: Vec<(u32, Vec3)> = Vec::new();
        let mut row = Self { entries: Vec::new(), sky: Vec3::ZERO, open: 0.0 };
        for ray in 0..rays {
            let point = of.point((ray as f32 * PLASTIC).fract());
            let Some(at) = nodes.point(patches, point as usize) else { continue };
            let along = about(normal, cosine_direction(ray, rays, 0.0));
            let end = around.scene.trace(at + normal * RAY_LIFT_M, along);
            match end.met {
                None => {
                    row.sky +=
                        around.emitters.sky(along) * end.tint * (share * std::f32::consts::PI);
                    row.open += share;
                }
                Some(met) => {
                    if let Some(node) = around.node_at(&met) {
                        seen.push((node as u32, end.tint * share));
                    }
                }
            }
        }
        seen.sort_by_key(|(node, _)| *node);
        for (node, share) in seen {
            match row.entries.last_mut() {
                Some((last, sum)) if *last == node => *sum += share,
                _ => row.entries.push((node, share)),
            }
        }
        row
    }
}

/// How much light leaves each node: what it gives, and what it passes on.
pub(super) struct Exchange {
    /// The light that leaves each node, per area.
    pub(super) radiosity: Vec<Vec3>,
    /// The difference between the light that leaves nodes for others and the light that arrives
    /// there, as a share of it.
    pub(super) energy_error: f64,
}

/// Passes light on between nodes, brightest first. `given` is the light that leaves each node at
/// first, per area, and `reflectance` the share of what arrives that leaves again.
pub(super) fn exchange(
    factors: &FormFactors,
    given: Vec<Vec3>,
    reflectance: &[Vec3],
    areas: &[f32],
) -> Exchange {
    let (starts, columns) = factors.columns();
    let power = |light: &[Vec3]| -> f64 {
        light.iter().zip(areas).map(|(light, area)| f64::from(light.element_sum() * area)).sum()
    };
    let all = power(&given);
    let (mut radiosity, mut unshot) = (given.clone(), given);
    for _ in 0..ROUNDS_MAX {
        if power(&unshot) <= UNSHOT * all {
            break;
        }
        let energy = |node: usize, unshot: &[Vec3]| unshot[node].max_element() * areas[node];
        let most = (0..unshot.len()).map(|node| energy(node, &unshot)).fold(0.0, f32::max);
        let mut bright: Vec<(usize, f32)> = (0..unshot.len())
            .map(|node| (node, energy(node, &unshot)))
            .filter(|(_, energy)| *energy > BRIGHT * most)
            .collect();
        bright.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (node, _) in bright {
            let light = std::mem::take(&mut unshot[node]);
            for &(to, share) in &columns[starts[node]..starts[node + 1]] {
                let passed = light * share * reflectance[to as usize];
                radiosity[to as usize] += passed;
                unshot[to as usize] += passed;
            }
        }
    }
    let ambient = ambient(&unshot, reflectance, areas);
    radiosity.iter_mut().zip(reflectance).for_each(|(light, share)| *light += ambient * share);
    let energy_error = energy_error(factors, &radiosity, areas);
    Exchange { radiosity, energy_error }
}

/// The even light that stands for what is unshot, after all its reflections.
fn ambient(unshot: &[Vec3], reflectance: &[Vec3], areas: &[f32]) -> Vec3 {
    let all = areas.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    let mean = |light: &[Vec3]| {
        light.iter().zip(areas).map(|(light, area)| light * (area / all)).sum::<Vec3>()
    };
    mean(unshot) / (1.0 - mean(reflectance)).max(Vec3::splat(0.1))
}

/// See [`Exchange::energy_error`].
fn energy_error(factors: &FormFactors, radiosity: &[Vec3], areas: &[f32]) -> f64 {
    let (mut left, mut arrived) = (0.0, 0.0);
    for (node, area) in areas.iter().enumerate() {
        let seen: Vec3 =
            factors.row(node).iter().map(|(seen, share)| radiosity[*seen as usize] * share).sum();
        arrived += f64::from(seen.element_sum() * area);
        let tinted: Vec3 = factors.row(node).iter().map(|(_, share)| *share).sum();
        left += f64::from((radiosity[node] * tinted).element_sum() * area);
    }
    if left > 0.0 { (left - arrived).abs() / left } else { 0.0 }
}
