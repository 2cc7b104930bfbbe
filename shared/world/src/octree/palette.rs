//! The palette of materials.
//!
//! Materials are rounded in a space where equal steps look about equally large. Colours become luma
//! and two chromas by integer arithmetic (YCoCg-R: Malvar and Sullivan 2003). Normals become points
//! of a grid on an octahedron that contains the axes exactly. Each entry of the palette has one of
//! several grains, from exact to very coarse: frequent materials have finer grains than rare ones.
//! A material belongs to the entry with the finest grain that matches it, so the reader of a file
//! finds the same entries for inner nodes as its writer.

use rustc_hash::FxHashMap;

use super::{MATERIALS_MAX, Material};

/// The step to which materials are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grain {
    /// The step in luma, of 255.
    pub(super) luma: u8,
    /// The step in each chroma, of ±255.
    pub(super) chroma: u8,
    /// The number of steps from one axis of the octahedron to the next.
    pub(super) normal: u8,
}

/// All grains, from exact colours to a grain at which every material fits: 9 × 9 × 9 colours, 18
/// normals, glass or not.
pub(super) const GRAINS: [Grain; 7] = [
    Grain { luma: 1, chroma: 1, normal: 16 },
    Grain { luma: 1, chroma: 3, normal: 16 },
    Grain { luma: 2, chroma: 4, normal: 16 },
    Grain { luma: 3, chroma: 6, normal: 12 },
    Grain { luma: 6, chroma: 12, normal: 8 },
    Grain { luma: 12, chroma: 24, normal: 4 },
    Grain { luma: 32, chroma: 64, normal: 2 },
];

/// A rounded material and its grain, packed into 42 bits.
pub(super) type Key = u64;

/// The greatest key.
pub(super) const KEY_MAX: Key = (1 << 42) - 1;

/// The offset that makes chromas positive.
const CHROMA_ZERO: i32 = 256;

/// The key of a material at a grain: an index into [`GRAINS`].
pub(super) fn key_of(material: &Material, grain: usize) -> Key {
    let Grain { luma, chroma, normal } = GRAINS[grain];
    let colour = to_ycocg(material.colour);
    let [u, v] = fold(material.normal.map(i32::from), normal.into());
    Fields {
        glass: material.is_glass(),
        grain,
        u,
        v,
        luma: rounded(colour[0], luma) as u32,
        orange: (rounded(colour[1], chroma) + CHROMA_ZERO) as u32,
        green: (rounded(colour[2], chroma) + CHROMA_ZERO) as u32,
    }
    .join()
}

/// The material of a key. Any number gives a material.
pub(super) fn material_of(key: Key) -> Material {
    let fields = Fields::split(key);
    let grain = GRAINS[fields.grain.min(GRAINS.len() - 1)];
    let chroma = |value: u32| (value as i32 - CHROMA_ZERO) * i32::from(grain.chroma);
    let luma = (fields.luma as i32 * i32::from(grain.luma)).min(255);
    Material {
        colour: from_ycocg([luma, chroma(fields.orange), chroma(fields.green)]),
        normal: unfold([fields.u, fields.v], grain.normal.into()),
        flags: if fields.glass { Material::GLASS } else { 0 },
    }
}

/// The grid point of a direction, with coordinates from 1 on; zeros for a zero vector. The
/// arithmetic is in integers, so that all machines agree.
fn fold([x, y, z]: [i32; 3], steps: i32) -> [u32; 2] {
    let sum = x.abs() + y.abs() + z.abs();
    if sum == 0 {
        return [0; 2];
    }
    let [mut u, mut v] = [x, y].map(|part| rounded_ratio(part * steps, sum));
    if z < 0 {
        let sign = |part: i32| if part < 0 { -1 } else { 1 };
        [u, v] = [
            rounded_ratio((sum - y.abs()) * sign(x) * steps, sum),
            rounded_ratio((sum - x.abs()) * sign(y) * steps, sum),
        ];
    }
    // Each direction on the rim has two grid points, and all four corners are one direction.
    if u.abs() == steps {
        v = v.abs();
    }
    if v.abs() == steps {
        u = u.abs();
    }
    [(u + steps + 1) as u32, (v + steps + 1) as u32]
}

/// The unit vector of a grid point, in units of 1/127; zero for zeros.
fn unfold([u, v]: [u32; 2], steps: i32) -> [i8; 3] {
    if u == 0 || v == 0 {
        return [0; 3];
    }
    let at = |part: u32| (part as i32 - 1 - steps).clamp(-steps, steps);
    let (u, v) = (at(u), at(v));
    let z = steps - u.abs() - v.abs();
    let [x, y] = if z < 0 {
        let sign = |part: i32| if part < 0 { -1 } else { 1 };
        [(steps - v.abs()) * sign(u), (steps - u.abs()) * sign(v)]
    } else {
        [u, v]
    };
    unit([x, y, z].map(f64::from))
}

/// The unit vector along a direction, in units of 1/127; zero for a zero vector.
pub(super) fn unit([x, y, z]: [f64; 3]) -> [i8; 3] {
    // IEEE 754 rounds roots and quotients exactly, so all machines agree.
    let length = (x * x + y * y + z * z).sqrt();
    // A cast rounds positive numbers down, faster than a call of `floor`.
    let byte = |part: f64| ((part / length * 127.0 + 127.5) as i32 - 127) as i8;
    if length > 0.0 { [x, y, z].map(byte) } else { [0; 3] }
}

/// The parts of a key.
struct Fields {
    glass: bool,
    grain: usize,
    u: u32,
    v: u32,
    luma: u32,
    orange: u32,
    green: u32,
}

impl Fields {
    fn join(self) -> Key {
        let parts = [
            (self.grain as u32, 3),
            (self.u, 6),
            (self.v, 6),
            (self.orange, 9),
            (self.green, 9),
            (self.luma, 8),
        ];
        parts.iter().fold(Key::from(self.glass), |key, &(part, bits)| key << bits | Key::from(part))
    }

    fn split(mut key: Key) -> Self {
        let mut take = |bits: u32| {
            let part = key as u32 & ((1 << bits) - 1);
            key >>= bits;
            part
        };
        let [luma, green, orange, v, u, grain, glass] = [8, 9, 9, 6, 6, 3, 1].map(&mut take);
        Self { glass: glass != 0, grain: grain as usize, u, v, luma, orange, green }
    }
}

/// The YCoCg-R transform: luma, orange against blue, and green against both.
pub(super) fn to_ycocg([r, g, b]: [u8; 3]) -> [i32; 3] {
    let [r, g, b] = [r, g, b].map(i32::from);
    let orange = r - b;
    let middle = b + (orange >> 1);
    let green = g - middle;
    [middle + (green >> 1), orange, green]
}

fn from_ycocg([luma, orange, green]: [i32; 3]) -> [u8; 3] {
    let middle = luma - (green >> 1);
    let b = middle - (orange >> 1);
    [b + orange, middle + green, b].map(|channel| channel.clamp(0, 255) as u8)
}

/// The number of steps nearest to a value. Halves round away from zero.
fn rounded(value: i32, step: u8) -> i32 {
    rounded_ratio(value, i32::from(step))
}

/// The integer nearest to a ratio. Halves round away from zero.
fn rounded_ratio(value: i32, by: i32) -> i32 {
    (value + value.signum() * (by / 2)) / by
}

/// Keys and their materials. When several keys have one material, the index of the first stands for
/// all.
pub(super) struct Palette {
    pub(super) keys: Vec<Key>,
    pub(super) materials: Vec<Material>,
    known: FxHashMap<Key, u16>,
    firsts: FxHashMap<Material, u16>,
    is_used: Vec<bool>,
    /// Whether the palette has entries of each grain. Others need not be tried.
    has_grain: [bool; GRAINS.len()],
    /// The grain at which materials are added. `None` in a closed palette.
    added: Option<usize>,
    /// A cache of recent queries by their hash: neighbours have similar materials.
    lately: Vec<(Material, u16)>,
}

/// The number of cached queries: a power of two.
const LATELY: usize = 1 << 13;

impl Palette {
    /// A palette of given keys, to which materials are added at a grain. All keys have finer
    /// grains.
    pub(super) fn open(keys: Vec<Key>, grain: usize) -> Self {
        Self { added: Some(grain), ..Self::closed(keys) }
    }

    /// A palette of given keys, to which nothing is added.
    pub(super) fn closed(keys: Vec<Key>) -> Self {
        // No material has these flags.
        let nothing = Material { flags: !0, ..Material::default() };
        let mut palette = Self {
            keys: Vec::with_capacity(keys.len()),
            materials: Vec::with_capacity(keys.len()),
            known: FxHashMap::default(),
            firsts: FxHashMap::default(),
            is_used: Vec::with_capacity(keys.len()),
            has_grain: [false; GRAINS.len()],
            added: None,
            lately: vec![(nothing, 0); LATELY],
        };
        for key in keys {
            palette.add(key);
        }
        palette
    }

    /// The index of the first entry with exactly this material.
    pub(super) fn first_like(&self, material: &Material) -> Option<u16> {
        self.firsts.get(material).copied()
    }

    /// The index of the entry for a material. An open palette adds one if need be. `None` when it
    /// has no room, or a closed palette has no entry.
    pub(super) fn index(&mut self, material: &Material) -> Option<u16> {
        let slot = slot(material);
        if self.lately[slot].0 == *material {
            return Some(self.lately[slot].1);
        }
        // An added entry must not match materials that belonged to another entry before. So only
        // grains up to the added one are tried.
        let grains = 0..self.added.map_or(GRAINS.len(), |grain| grain + 1);
        let grains = grains.filter(|&grain| self.has_grain[grain]);
        let mut known = grains.filter_map(|grain| self.known.get(&key_of(material, grain)));
        let entry = match known.next() {
            Some(&entry) => entry,
            None => self.add(key_of(material, self.added?))?,
        };
        self.is_used[usize::from(entry)] = true;
        let index = self.first_like(&self.materials[usize::from(entry)])?;
        self.lately[slot] = (*material, index);
        Some(index)
    }

    /// Adds an entry. `None` when the palette is full.
    fn add(&mut self, key: Key) -> Option<u16> {
        if self.keys.len() >= MATERIALS_MAX {
            return None;
        }
        let (entry, material) = (self.keys.len() as u16, material_of(key));
        self.known.insert(key, entry);
        self.firsts.entry(material).or_insert(entry);
        self.keys.push(key);
        self.materials.push(material);
        self.is_used.push(false);
        if let Some(has) = self.has_grain.get_mut(Fields::split(key).grain) {
            *has = true;
        }
        Some(entry)
    }

    /// Drops the unused entries and sorts the rest by their keys, so that glass comes last. Returns
    /// the new index of each old entry.
    pub(super) fn sort(&mut self) -> Vec<u16> {
        let used = self.keys.iter().zip(&self.is_used).filter(|(_, is_used)| **is_used);
        let mut keys: Vec<Key> = used.map(|(&key, _)| key).collect();
        keys.sort_unstable();
        let sorted = Self::closed(keys);
        debug_assert!(sorted.materials.is_sorted_by_key(Material::is_glass), "glass comes last");
        let places = self
            .materials
            .iter()
            .map(|material| sorted.first_like(material).unwrap_or(0))
            .collect();
        *self = sorted;
        places
    }
}

/// The place of a material in the cache.
fn slot(material: &Material) -> usize {
    let [r, g, b] = material.colour.map(u32::from);
    let [x, y, z] = material.normal.map(|part| u32::from(part as u8));
    let mixed = (r | g << 8 | b << 16 | u32::from(material.flags) << 24)
        .wrapping_mul(0x9e37_79b1)
        .wrapping_add((x | y << 8 | z << 16).wrapping_mul(0x85eb_ca6b));
    (mixed >> 19) as usize % LATELY
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(colour: [u8; 3], normal: [i8; 3]) -> Material {
        Material { colour, normal, flags: 0 }
    }

    #[test]
    fn the_finest_grain_keeps_colours_and_axes() {
        let shades = [0u8, 1, 2, 77, 128, 200, 254, 255];
        for r in shades {
            for g in shades {
                for b in shades {
                    let exact = material([r, g, b], [0, -127, 0]);
                    let glass = Material { flags: Material::GLASS, ..exact };
                    for material in [exact, glass] {
                        assert_eq!(material_of(key_of(&material, 0)), material);
                    }
                }
            }
        }
    }

    #[test]
    fn rounding_moves_materials_by_half_a_step() {
        for (index, grain) in GRAINS.iter().enumerate() {
            let reach = i32::from(grain.luma / 2 + grain.chroma) + 1;
            for i in 0..5_000u32 {
                let byte = |shift: u32| (i.wrapping_mul(2_654_435_761) >> shift) as u8;
                let normal = [byte(8) as i8 | 1, byte(3) as i8, byte(17) as i8];
                let before = material([byte(0), byte(9), byte(21)], normal);
                let after = material_of(key_of(&before, index));
                for (a, b) in before.colour.iter().zip(after.colour) {
                    assert!(
                        i32::from(*a).abs_diff(b.into()) <= reach as u32,
                        "{grain:?} {before:?}"
                    );
                }
                let [a, b] = [before, after].map(|l| glam::Vec3::from(l.normal.map(f32::from)));
                let apart = a.angle_between(b);
                assert!(apart < 2.1 / f32::from(grain.normal), "{grain:?} {a} {b} {apart}");
            }
        }
    }

    #[test]
    fn each_direction_has_one_grid_point() {
        for grain in GRAINS {
            let steps = i32::from(grain.normal);
            let mut seen = FxHashMap::default();
            for u in 0..=32 {
                for v in 0..=32 {
                    let normal = unfold([u, v], steps);
                    let point = fold(normal.map(i32::from), steps);
                    assert_eq!(*seen.entry(normal).or_insert(point), point);
                    assert_eq!(unfold(point, steps), normal, "{grain:?}");
                }
            }
        }
    }

    #[test]
    fn glass_is_last_and_unused_entries_are_dropped() {
        let mut palette = Palette::open(Vec::new(), 0);
        let glass = Material { flags: Material::GLASS, ..material([1; 3], [127, 0, 0]) };
        let materials = [glass, material([255; 3], [0, 0, -127]), material([0; 3], [0; 3])];
        for material in materials {
            palette.index(&material);
        }
        let places = palette.sort();
        assert_eq!(places, [2, 1, 0]);
        assert!(palette.materials[2].is_glass() && palette.keys.is_sorted());
        assert_eq!(palette.materials.len(), 3);
        assert_eq!(palette.index(&material([9; 3], [0; 3])), None);
        palette.index(&materials[1]);
        palette.sort();
        assert_eq!(palette.materials, [materials[1]]);
    }
}
