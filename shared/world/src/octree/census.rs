//! Chooses the materials of a palette: frequent ones at fine grains, rare ones at coarser grains.

use rustc_hash::FxHashMap;

use super::{
    Material,
    palette::{GRAINS, Key, Palette, key_of, material_of, to_ycocg},
};
use crate::packing;

/// Up to this number of materials are kept exactly.
const FEW: usize = 4_096;

/// The greatest number of materials at finer grains than the rest.
const CHOSEN: usize = 30_000;

/// The most packed bytes per voxel that colours may take in a trial. The finest grain within this
/// limit is chosen. Finer steps between neighbours are mere noise. A whole building packs better
/// than the trial.
const WIRE_BYTES: f64 = 0.9;

/// The number of voxels in the trial.
const TRIAL: usize = 1 << 20;

/// The greatest number of distinct materials to choose from: they take 224 MiB.
const KINDS_MAX: usize = 4 << 20;

/// The number of voxels of each material.
#[derive(Default)]
pub(super) struct Census {
    counts: FxHashMap<Key, u32>,
    last: Option<(Material, Key)>,
    trial: Vec<Material>,
}

impl Census {
    /// Counts the materials of neighbouring voxels. A share of them is kept for the trial. `total`
    /// is the number of all voxels.
    pub(super) fn count(&mut self, materials: &[Material], total: usize) {
        for material in materials {
            let key = match self.last {
                Some((known, key)) if known == *material => key,
                _ => key_of(material, 0),
            };
            self.last = Some((*material, key));
            let count = self.counts.entry(key).or_insert(0);
            *count = count.saturating_add(1);
        }
        // A share of every group, so that neighbours stay together.
        let kept =
            (materials.len() as u64 * TRIAL as u64).div_ceil(total.max(TRIAL) as u64) as usize;
        self.trial.extend(&materials[..kept.min(materials.len())]);
    }

    /// Open palettes, the best first. The last one has room for any materials.
    pub(super) fn palettes(&self) -> impl Iterator<Item = Palette> {
        let few = self.counts.len() <= FEW;
        let finest = if few { 0 } else { self.finest() };
        let kinds = if few { Vec::new() } else { self.kinds() };
        (finest..GRAINS.len()).map(move |grain| match grain {
            0 => Palette::open(Vec::new(), 0),
            _ => Palette::open(best(&kinds, finest.max(1), grain), grain),
        })
    }

    /// The finest grain whose colours pack well enough.
    fn finest(&self) -> usize {
        let packs_well = |&grain: &usize| {
            let materials = self
                .trial
                .iter()
                .map(|material| to_ycocg(material_of(key_of(material, grain)).colour));
            let colours: Vec<[u8; 3]> =
                materials.map(|colour| colour.map(|part| part as u8)).collect();
            let lumas =
                colours.windows(2).map(|pair| pair[1][0].wrapping_sub(pair[0][0])).collect();
            let plane = |plane: usize| colours.iter().map(|colour| colour[plane]).collect();
            let packed = |bytes: Vec<u8>| packing::pack(&bytes, 3).len();
            let bytes = packed(lumas) + packed(plane(1)) + packed(plane(2));
            bytes as f64 <= WIRE_BYTES * colours.len() as f64
        };
        (1..GRAINS.len() - 2).find(packs_well).unwrap_or(GRAINS.len() - 2)
    }

    fn kinds(&self) -> Vec<Kind> {
        let mut least = 1;
        while self.counts.values().filter(|&&voxels| voxels >= least).count() > KINDS_MAX {
            least += 1;
        }
        let kinds = self.counts.iter().filter(|&(_, &voxels)| voxels >= least);
        kinds.map(|(&key, &voxels)| Kind::new(key, voxels)).collect()
    }
}

/// The voxels of one material, and their keys at all grains but the first and the last.
struct Kind {
    voxels: u32,
    keys: [Key; GRAINS.len() - 2],
}

impl Kind {
    fn new(key: Key, voxels: u32) -> Self {
        let material = material_of(key);
        Self { voxels, keys: std::array::from_fn(|place| key_of(&material, place + 1)) }
    }
}

/// Up to [`CHOSEN`] keys at grains from `finest` to before `coarsest`, for the materials that gain
/// the most from a finer grain.
fn best(kinds: &[Kind], finest: usize, coarsest: usize) -> Vec<Key> {
    let total: u64 = kinds.iter().map(|kind| u64::from(kind.voxels)).sum();
    // A threshold that surely chooses few enough keys, as a number of bits to shift right by, …
    let most = total * u64::from(GRAINS[GRAINS.len() - 1].luma) / CHOSEN as u64 + 1;
    let (mut enough, mut best) = (0, choice(kinds, finest, coarsest, most));
    // … and one that need not be tried, or that chooses too many.
    let mut too_many = u64::BITS - most.leading_zeros();
    while enough + 1 < too_many {
        let middle = enough.midpoint(too_many);
        let chosen = choice(kinds, finest, coarsest, most >> middle);
        if chosen.len() > CHOSEN {
            too_many = middle;
        } else {
            (enough, best) = (middle, chosen);
        }
    }
    best
}

/// The keys whose worth reaches a threshold, from the finest grain on. The worth is the error that
/// the next coarser grain would add, summed over the voxels without a chosen key.
fn choice(kinds: &[Kind], finest: usize, coarsest: usize, threshold: u64) -> Vec<Key> {
    let mut chosen = Vec::new();
    let mut left: Vec<&Kind> = kinds.iter().collect();
    for grain in finest..coarsest {
        let worth = u64::from(GRAINS[grain + 1].luma - GRAINS[grain].luma);
        let mut counts: FxHashMap<Key, u64> = FxHashMap::default();
        for kind in &left {
            *counts.entry(kind.keys[grain - 1]).or_insert(0) += u64::from(kind.voxels);
        }
        left.retain(|kind| counts[&kind.keys[grain - 1]] * worth < threshold);
        counts.retain(|_, voxels| *voxels * worth >= threshold);
        chosen.extend(counts.into_keys());
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::MATERIALS_MAX;

    fn shade(i: u32) -> Material {
        let [_, r, g, b] = i.wrapping_mul(2_654_435_761).to_be_bytes();
        Material { colour: [r, g, b], normal: [0, 127, 0], flags: 0 }
    }

    #[test]
    fn the_last_palette_has_room_for_anything() {
        let coarsest = GRAINS[GRAINS.len() - 1];
        let lumas = 255 / usize::from(coarsest.luma) + 2;
        let chromas = 2 * (255 / usize::from(coarsest.chroma) + 1) + 1;
        let normals = 4 * usize::from(coarsest.normal).pow(2) + 2 + 1;
        assert!(CHOSEN + lumas * chromas * chromas * normals * 2 <= MATERIALS_MAX);
    }

    #[test]
    fn frequent_materials_are_closer_than_rare_ones() {
        let mut census = Census::default();
        for i in 0..200_000 {
            census.count(&vec![shade(i); if i < 10_000 { 60 } else { 1 }], 790_000);
        }
        let filled = |mut palette: Palette| {
            let indices: Option<Vec<u16>> =
                (0..200_000).map(|i| palette.index(&shade(i))).collect();
            Some(indices?.iter().map(|&index| palette.materials[usize::from(index)]).collect())
        };
        let found: Vec<Material> = census.palettes().find_map(filled).expect("the last has room");
        let error = |i: usize| {
            let wanted = shade(i as u32).colour;
            found[i].colour.iter().zip(wanted).map(|(&a, b)| a.abs_diff(b)).max().unwrap_or(0)
        };
        let mean = |all: std::ops::Range<usize>| {
            all.clone().map(|i| f64::from(error(i))).sum::<f64>() / all.len() as f64
        };
        let (many, rare) = (mean(0..10_000), mean(10_000..200_000));
        assert!(many < 3.0 && rare < 12.0 && many < 0.6 * rare, "{many} {rare}");
    }

    #[test]
    fn few_materials_are_exact() {
        let mut census = Census::default();
        (0..1_000).for_each(|i| census.count(&[shade(i)], 1_000));
        let mut palette = census.palettes().next().expect("there is one");
        for i in 0..1_000 {
            let index = palette.index(&shade(i)).expect("room");
            assert_eq!(palette.materials[usize::from(index)], shade(i));
        }
    }
}
