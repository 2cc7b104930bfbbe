//! The palette: which looks are told apart.
//!
//! Looks are rounded in a space in which equal steps look about equally large: luma and two
//! chromas, made of sRGB by whole numbers (YCoCg-R), and the normal as a point of a grid on an
//! octahedron, on which the axes lie exactly. The grain is the finest with which all looks of a
//! tree fit into 16 bits; when there are few, colours are exact.

use rustc_hash::FxHashMap;

use super::{LOOKS_MAX, Look};

/// How coarsely looks are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grain {
    /// The step in luma, of 255.
    pub(super) luma: u8,
    /// The step in each chroma, of ±255.
    pub(super) chroma: u8,
    /// Steps from one axis of the octahedron to the next.
    pub(super) normal: u8,
}

/// A look, rounded: see [`Grain::key`].
pub(super) type Key = u64;

/// The greatest key: 39 bits.
pub(super) const KEY_MAX: Key = (1 << 39) - 1;

/// Zero is added to chromas so that they have no sign.
const CHROMA_ZERO: i32 = 256;

impl Grain {
    pub(super) const FINEST: Self = Self { luma: 1, chroma: 1, normal: 16 };

    /// From the finest to one with which everything fits: 9 × 9 × 9 colours, 18 normals, glass.
    pub(super) const ALL: [Self; 14] = [
        Self::FINEST,
        Self { luma: 1, chroma: 2, normal: 16 },
        Self { luma: 2, chroma: 3, normal: 16 },
        Self { luma: 2, chroma: 4, normal: 12 },
        Self { luma: 2, chroma: 4, normal: 8 },
        Self { luma: 3, chroma: 5, normal: 12 },
        Self { luma: 3, chroma: 5, normal: 8 },
        Self { luma: 3, chroma: 6, normal: 8 },
        Self { luma: 4, chroma: 8, normal: 8 },
        Self { luma: 5, chroma: 10, normal: 6 },
        Self { luma: 6, chroma: 12, normal: 6 },
        Self { luma: 8, chroma: 16, normal: 4 },
        Self { luma: 12, chroma: 24, normal: 4 },
        Self { luma: 32, chroma: 64, normal: 2 },
    ];

    pub(super) fn is_sound(self) -> bool {
        self.luma > 0 && self.chroma > 0 && (1..=16).contains(&self.normal)
    }

    /// The look's place on the grid.
    pub(super) fn key(self, look: &Look) -> Key {
        let [luma, orange, green] = to_ycocg(look.colour);
        let [u, v] = self.fold(look.normal.map(i32::from));
        Fields {
            glass: look.is_glass(),
            u,
            v,
            luma: rounded(luma, self.luma) as u32,
            orange: (rounded(orange, self.chroma) + CHROMA_ZERO) as u32,
            green: (rounded(green, self.chroma) + CHROMA_ZERO) as u32,
        }
        .join()
    }

    /// What is drawn for a key. Any number is fine.
    pub(super) fn look(self, key: Key) -> Look {
        let fields = Fields::split(key);
        let chroma = |value: u32| (value as i32 - CHROMA_ZERO) * i32::from(self.chroma);
        let luma = (fields.luma as i32 * i32::from(self.luma)).min(255);
        let colour = from_ycocg([luma, chroma(fields.orange), chroma(fields.green)]);
        let normal = self.unfold([fields.u, fields.v]);
        Look { colour, normal, flags: if fields.glass { Look::GLASS } else { 0 } }
    }

    /// A direction as a point of the grid, from 1 on; zeros when it has none. By whole numbers, so that
    /// all machines agree.
    fn fold(self, [x, y, z]: [i32; 3]) -> [u32; 2] {
        let sum = x.abs() + y.abs() + z.abs();
        if sum == 0 {
            return [0; 2];
        }
        let steps = i32::from(self.normal);
        let [mut u, mut v] = [x, y].map(|part| rounded_ratio(part * steps, sum));
        if z < 0 {
            let sign = |part: i32| if part < 0 { -1 } else { 1 };
            [u, v] = [
                rounded_ratio((sum - y.abs()) * sign(x) * steps, sum),
                rounded_ratio((sum - x.abs()) * sign(y) * steps, sum),
            ];
        }
        // Each direction on the rim has two points, and the corners are all one.
        if u.abs() == steps {
            v = v.abs();
        }
        if v.abs() == steps {
            u = u.abs();
        }
        [(u + steps + 1) as u32, (v + steps + 1) as u32]
    }

    fn unfold(self, [u, v]: [u32; 2]) -> [i8; 3] {
        if u == 0 || v == 0 {
            return [0; 3];
        }
        let steps = i32::from(self.normal);
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
}

/// A direction's unit vector, in hundred-and-twenty-sevenths.
pub(super) fn unit([x, y, z]: [f64; 3]) -> [i8; 3] {
    // Roots and quotients are exactly rounded, so that all machines agree.
    let length = (x * x + y * y + z * z).sqrt();
    // Casting rounds down what is positive, and does so faster than a call.
    let byte = |part: f64| ((part / length * 127.0 + 127.5) as i32 - 127) as i8;
    if length > 0.0 { [x, y, z].map(byte) } else { [0; 3] }
}

/// A key's parts: its material, which is glass or not and the normal, and its colour.
pub(super) struct Fields {
    glass: bool,
    u: u32,
    v: u32,
    pub(super) luma: u32,
    pub(super) orange: u32,
    pub(super) green: u32,
}

impl Fields {
    /// How many of a key's lowest bits are its colour.
    const COLOUR_BITS: u32 = 26;

    pub(super) fn material_of(key: Key) -> Key {
        key >> Self::COLOUR_BITS
    }

    /// The key of a material in a colour: luma, orange and green.
    pub(super) fn with_colour(material: Key, [luma, orange, green]: [u32; 3]) -> Key {
        material << Self::COLOUR_BITS
            | Key::from(orange) << 17
            | Key::from(green) << 8
            | Key::from(luma)
    }

    fn join(self) -> Key {
        let parts = [(self.u, 6), (self.v, 6), (self.orange, 9), (self.green, 9), (self.luma, 8)];
        parts.iter().fold(Key::from(self.glass), |key, &(part, bits)| key << bits | Key::from(part))
    }

    pub(super) fn split(mut key: Key) -> Self {
        let mut take = |bits: u32| {
            let part = key as u32 & ((1 << bits) - 1);
            key >>= bits;
            part
        };
        let [luma, green, orange, v, u, glass] = [8, 9, 9, 6, 6, 1].map(&mut take);
        Self { glass: glass != 0, u, v, luma, orange, green }
    }
}

/// Luma, orange against blue, green against both.
fn to_ycocg([r, g, b]: [u8; 3]) -> [i32; 3] {
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

/// The number of steps nearest to a value.
fn rounded(value: i32, step: u8) -> i32 {
    rounded_ratio(value, i32::from(step))
}

/// Halves go away from zero.
fn rounded_ratio(value: i32, by: i32) -> i32 {
    (value + value.signum() * (by / 2)) / by
}

/// Looks by their keys.
pub(super) struct Palette {
    pub(super) grain: Grain,
    pub(super) keys: Vec<Key>,
    pub(super) looks: Vec<Look>,
    known: FxHashMap<Key, u16>,
    /// Whether new looks may be added.
    is_open: bool,
    /// What was asked for last, since neighbours are alike.
    last: (Look, u16),
}

impl Palette {
    /// An empty one that takes up to [`LOOKS_MAX`] looks.
    pub(super) fn open(grain: Grain) -> Self {
        let (keys, looks, known) = (Vec::new(), Vec::new(), FxHashMap::default());
        let nothing = Look { flags: !0, ..Look::default() };
        Self { grain, keys, looks, known, is_open: true, last: (nothing, 0) }
    }

    /// One of given keys, to which none is added.
    pub(super) fn closed(grain: Grain, keys: Vec<Key>) -> Self {
        let looks = keys.iter().map(|&key| grain.look(key)).collect();
        let known = keys.iter().enumerate().map(|(i, &key)| (key, i as u16)).collect();
        Self { keys, looks, known, is_open: false, ..Self::open(grain) }
    }

    /// The index of a look; `None` when there is no room for it.
    pub(super) fn index(&mut self, look: &Look) -> Option<u16> {
        if *look == self.last.0 {
            return Some(self.last.1);
        }
        let index = self.index_of_key(self.grain.key(look))?;
        self.last = (*look, index);
        Some(index)
    }

    pub(super) fn index_of_key(&mut self, key: Key) -> Option<u16> {
        if let Some(&index) = self.known.get(&key) {
            return Some(index);
        }
        if !self.is_open || self.keys.len() == LOOKS_MAX {
            return None;
        }
        let index = self.keys.len() as u16;
        self.known.insert(key, index);
        self.keys.push(key);
        self.looks.push(self.grain.look(key));
        Some(index)
    }

    /// Puts the looks in the order of their keys, so that glass is last; gives where each one went.
    pub(super) fn sort(&mut self) -> Vec<u16> {
        let mut order: Vec<u16> = (0..self.keys.len()).map(|i| i as u16).collect();
        order.sort_unstable_by_key(|&i| self.keys[usize::from(i)]);
        let mut places = vec![0; order.len()];
        for (place, &from) in order.iter().enumerate() {
            places[usize::from(from)] = place as u16;
        }
        let keys = order.iter().map(|&from| self.keys[usize::from(from)]).collect();
        *self = Self::closed(self.grain, keys);
        places
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(colour: [u8; 3], normal: [i8; 3]) -> Look {
        Look { colour, normal, flags: 0 }
    }

    #[test]
    fn the_finest_grain_keeps_colours_and_axes() {
        let shades = [0u8, 1, 2, 77, 128, 200, 254, 255];
        for r in shades {
            for g in shades {
                for b in shades {
                    let exact = look([r, g, b], [0, -127, 0]);
                    let glass = Look { flags: Look::GLASS, ..exact };
                    for look in [exact, glass] {
                        assert_eq!(Grain::FINEST.look(Grain::FINEST.key(&look)), look);
                    }
                }
            }
        }
    }

    #[test]
    fn rounding_moves_looks_by_half_a_step() {
        for grain in Grain::ALL {
            let reach = i32::from(grain.luma / 2 + grain.chroma) + 1;
            for i in 0..5_000u32 {
                let byte = |shift: u32| (i.wrapping_mul(2_654_435_761) >> shift) as u8;
                let normal = [byte(8) as i8 | 1, byte(3) as i8, byte(17) as i8];
                let before = look([byte(0), byte(9), byte(21)], normal);
                let after = grain.look(grain.key(&before));
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
    fn directions_have_one_point_each() {
        for grain in Grain::ALL {
            let mut seen = FxHashMap::default();
            for u in 0..=32 {
                for v in 0..=32 {
                    let normal = grain.unfold([u, v]);
                    let point = grain.fold(normal.map(i32::from));
                    assert_eq!(*seen.entry(normal).or_insert(point), point);
                    assert_eq!(grain.unfold(point), normal, "{grain:?}");
                }
            }
        }
    }

    #[test]
    fn the_coarsest_grain_always_fits() {
        let coarsest = Grain::ALL[Grain::ALL.len() - 1];
        let lumas = 255 / u32::from(coarsest.luma) + 2;
        let chromas = 2 * (255 / u32::from(coarsest.chroma) + 1) + 1;
        let normals = 4 * u32::from(coarsest.normal).pow(2) + 2 + 1;
        assert!(((lumas * chromas * chromas * normals * 2) as usize) < LOOKS_MAX);
    }

    #[test]
    fn glass_is_last() {
        let mut palette = Palette::open(Grain::FINEST);
        let glass = Look { flags: Look::GLASS, ..look([1; 3], [127, 0, 0]) };
        for look in [glass, look([255; 3], [0, 0, -127]), look([0; 3], [0; 3])] {
            palette.index(&look);
        }
        let places = palette.sort();
        assert_eq!(places[0], 2);
        assert!(palette.looks[2].is_glass() && palette.keys.is_sorted());
        assert_eq!(palette.index(&look([9; 3], [0; 3])), None);
    }
}
