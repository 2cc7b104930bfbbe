//! Light for what moves: probes on a grid, and how bright light is in a picture.
//!
//! The colours of voxels have their light baked in. Avatars and movers are lit by *probes*: points
//! at which the compiler found the light that arrives on each side of a small cube (the ambient
//! cube of Mitchell, McTaggart and Green 2006, "Shading in Valve's Source engine"). There are
//! probes only where something may move.

use glam::{UVec3, Vec3};

use crate::{cells::Cells, geometry::Aabb};

/// Colours in sRGB are about this power of light.
pub const GAMMA: f32 = 1.0 / 2.2;
/// Light that is less than this in the picture stays as it is …
const SHOULDER: f32 = 0.6;
/// … and more light never exceeds this.
const BRIGHTEST: f32 = 1.15;
/// A probe's light doubles with this number of levels.
const LEVELS_PER_STOP: f32 = 16.0;
/// The light on a side of a mover is that of a place this far away, in metres.
const BESIDE_M: f32 = 0.25;
/// How many layers of the grid below a place without probes are searched for some.
const LAYERS_BELOW: u32 = 3;
/// Probes that count less than this together are taken equally.
const WEIGHT_MIN: f32 = 1.0e-4;

/// Light in the picture: bright light is compressed, and keeps its hue.
pub fn shoulder(light: Vec3) -> Vec3 {
    let level = light.max_element();
    if level <= SHOULDER {
        return light;
    }
    let room = BRIGHTEST - SHOULDER;
    let compressed = SHOULDER + room * (1.0 - (-(level - SHOULDER) / room).exp());
    light * (compressed / level)
}

/// The baked light of a world.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedLight {
    /// The factor from light to the picture. It is chosen once for a world, and is in the colours
    /// of the voxels already.
    pub exposure: f32,
    /// The light that the highest level of a probe stands for.
    pub brightest: f32,
    /// The light under the open sky, where there are no probes. None in a world without sky.
    pub sky: Option<Probe>,
    /// The probes.
    pub grid: ProbeGrid,
}

/// Probes at points of a cubic lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeGrid {
    /// The lattice's point of index 0.
    pub origin: Vec3,
    /// The distance between neighbouring points, in metres.
    pub spacing: f32,
    /// The points along each axis. Their product is less than 2³².
    pub size: UVec3,
    /// The points that have a probe, by index, in increasing order. The index counts along x first,
    /// then along y, then along z.
    pub places: Vec<u32>,
    /// The probe of each of `places`.
    pub probes: Vec<Probe>,
}

/// The light at a point, from all around.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Probe {
    /// How much light arrives at the sides of a small cube that face -x, +x, -y, +y, -z and +z. The
    /// highest level stands for [`BakedLight::brightest`], and 16 levels for a factor of two. Level
    /// 0 is no light.
    pub levels: [u8; 6],
    /// The colour of the light: linear red, green and blue, as shares of the greatest, which is
    /// 255.
    pub tint: [u8; 3],
    /// Whether nothing lies between this point of the lattice and the next one along x, y and z:
    /// the lowest three bits.
    pub links: u8,
}

/// The light at a place, as factors on sRGB colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShownLight {
    /// On surfaces that face -x, +x, -y, +y, -z and +z.
    pub sides: [f32; 6],
    /// The colour of the light, from 0 to 1.
    pub tint: Vec3,
}

/// Where the light on each side of a mover that fills a box is asked for, in the order of
/// [`Probe::levels`].
pub fn places_beside(bounds: &Aabb) -> [Vec3; 6] {
    let (middle, reach) = (bounds.centre(), bounds.size() * 0.5 + BESIDE_M);
    let [x, y, z] = Vec3::AXES.map(|axis| axis * reach);
    [-x, x, -y, y, -z, z].map(|aside| middle + aside)
}

impl BakedLight {
    /// The light that arrives at a place, or None where none is known. Probes on the other side of
    /// a wall do not count: `cells` say on which side the place is.
    pub fn at(&self, place: Vec3, cells: &Cells) -> Option<ArrivingLight> {
        let blend = |corners: Vec<(usize, f32)>| {
            let mut sum = ArrivingLight { sides: [0.0; 6], tint: Vec3::ZERO };
            for (index, weight) in corners {
                sum.add(&self.arriving(&self.grid.probes[index]), weight);
            }
            sum
        };
        let found = self.grid.around(place, cells).map(blend);
        found.or_else(|| self.sky.as_ref().map(|sky| self.arriving(sky)))
    }

    /// The light of a probe.
    fn arriving(&self, probe: &Probe) -> ArrivingLight {
        ArrivingLight {
            sides: probe.levels.map(|level| self.light_of(level)),
            tint: Vec3::from(probe.tint.map(f32::from)) / 255.0,
        }
    }

    fn light_of(&self, level: u8) -> f32 {
        let below = f32::from(u8::MAX - level) / LEVELS_PER_STOP;
        if level == 0 { 0.0 } else { self.brightest * (-below).exp2() }
    }
}

impl Probe {
    /// A probe with this much light on its sides, in linear red, green and blue, in a world where
    /// no light exceeds `brightest`.
    pub fn new(sides: &[Vec3; 6], brightest: f32, links: u8) -> Self {
        let sum: Vec3 = sides.iter().sum();
        let tint = sum / sum.max_element().max(f32::MIN_POSITIVE);
        let all = tint.element_sum().max(f32::MIN_POSITIVE);
        let level = |side: &Vec3| {
            let share = side.element_sum() / all / brightest;
            let level = f32::from(u8::MAX) + share.log2() * LEVELS_PER_STOP;
            level.round().clamp(0.0, 255.0) as u8
        };
        Self {
            levels: sides.each_ref().map(level),
            tint: (tint * 255.0).round().to_array().map(|channel| channel as u8),
            links,
        }
    }
}

/// The light that arrives at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArrivingLight {
    /// On surfaces that face -x, +x, -y, +y, -z and +z, in the unit of the compiler's light.
    pub sides: [f32; 6],
    /// The colour of the light, as shares of the greatest of red, green and blue.
    pub tint: Vec3,
}

impl ArrivingLight {
    fn add(&mut self, other: &Self, weight: f32) {
        for (side, more) in self.sides.iter_mut().zip(other.sides) {
            *side += more * weight;
        }
        self.tint += other.tint * weight;
    }

    /// The light in the picture.
    pub fn shown(&self, exposure: f32) -> ShownLight {
        let side = |light: f32| shoulder(Vec3::splat(light * exposure)).x.powf(GAMMA);
        ShownLight { sides: self.sides.map(side), tint: self.tint.powf(GAMMA) }
    }
}

impl ProbeGrid {
    /// The position of a point of the lattice.
    pub fn point(&self, at: UVec3) -> Vec3 {
        self.origin + at.as_vec3() * self.spacing
    }

    /// The index of a point of the lattice.
    pub fn index(&self, at: UVec3) -> u32 {
        at.x + self.size.x * (at.y + self.size.y * at.z)
    }

    /// The lattice's point with an index.
    pub fn coordinates(&self, index: u32) -> UVec3 {
        let rows = index / self.size.x;
        UVec3::new(index % self.size.x, rows % self.size.y, rows / self.size.y)
    }

    /// The probes around a place and their weights, whose sum is one. None where there are none.
    fn around(&self, place: Vec3, cells: &Cells) -> Option<Vec<(usize, f32)>> {
        let steps = (place - self.origin) / self.spacing;
        let inside = steps.cmpge(Vec3::ZERO).all() && steps.cmplt(self.size.as_vec3()).all();
        if !inside {
            return None;
        }
        let (low, part) = (steps.floor().as_uvec3(), steps - steps.floor());
        (0..=LAYERS_BELOW.min(low.y)).find_map(|down| {
            let part = if down == 0 { part } else { part.with_y(1.0) };
            self.of_square(low - UVec3::Y * down, part, place, cells)
        })
    }

    /// The probes at the corners of a cube of the lattice that a place of it sees, with weights for
    /// the place's part of the way from the lowest corner to the highest.
    fn of_square(
        &self,
        low: UVec3,
        part: Vec3,
        place: Vec3,
        cells: &Cells,
    ) -> Option<Vec<(usize, f32)>> {
        let corner = |i: u32| UVec3::new(i & 1, i >> 1 & 1, i >> 2);
        let found: [Option<usize>; 8] = std::array::from_fn(|i| self.probe(low + corner(i as u32)));
        let weight = |i: usize| {
            let high = corner(i as u32).as_vec3();
            (high * part + (1.0 - high) * (1.0 - part)).element_product()
        };
        let space = |at: Vec3| cells.at(at).map(|cell| cells.cells[cell.0 as usize].space);
        // A client that fetches a world in pieces may know a single space only.
        let here = space(place).filter(|_| cells.spaces.len() > 1);
        let is_beside = |i: &usize| {
            here.is_some()
                && found[*i].is_some()
                && space(self.point(low + corner(*i as u32))) == here
        };
        let present = || (0..8).filter(|i| found[*i].is_some());
        let mut seen = present().filter(is_beside).fold(0u8, |seen, i| seen | 1 << i);
        if seen == 0 {
            seen = 1 << present().max_by(|a, b| weight(*a).total_cmp(&weight(*b)))?;
        }
        let seen = self.linked(&found, seen);
        let corners = present().filter(|i| seen >> i & 1 == 1);
        let corners: Vec<(usize, f32)> =
            corners.filter_map(|i| Some((found[i]?, weight(i)))).collect();
        let all: f32 = corners.iter().map(|(_, weight)| weight).sum();
        let even = 1.0 / corners.len() as f32;
        let share = |weight: f32| if all < WEIGHT_MIN { even } else { weight / all };
        Some(corners.into_iter().map(|(index, weight)| (index, share(weight))).collect())
    }

    /// The corners of a cube that are linked to some of them, as bits.
    fn linked(&self, found: &[Option<usize>; 8], mut seen: u8) -> u8 {
        loop {
            let before = seen;
            for (low, axis) in (0..8).flat_map(|low| (0..3).map(move |axis| (low, axis))) {
                let high = low | 1 << axis;
                if high == low || found[high].is_none() {
                    continue;
                }
                let links = found[low].map_or(0, |probe| self.probes[probe].links);
                if links >> axis & 1 == 1 && (seen >> low | seen >> high) & 1 == 1 {
                    seen |= 1 << low | 1 << high;
                }
            }
            if seen == before {
                return seen;
            }
        }
    }

    /// The probe at a point of the lattice.
    fn probe(&self, at: UVec3) -> Option<usize> {
        let inside = at.cmplt(self.size).all();
        inside.then(|| self.places.binary_search(&self.index(at)).ok()).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        cells::{Cell, CellId, Node, Space},
        geometry::{Aabb, Axes},
    };

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

    #[test]
    fn a_probe_keeps_light_within_three_per_cent() {
        let sides =
            [0.004, 0.05, 0.3, 1.0, 7.0, 12.0].map(|light| Vec3::new(1.0, 0.8, 0.5) * light);
        let light = lit(Probe::new(&sides, 12.0, 0));
        let found = light.arriving(&light.grid.probes[0]);
        for (side, known) in found.sides.iter().zip(sides) {
            let away = (found.tint * *side - known).abs() / known;
            assert!(away.max_element() < 0.03, "{side} {known}");
        }
        let dark = Probe::new(&[Vec3::ZERO; 6], 12.0, 0);
        assert_eq!((dark.levels, dark.tint), ([0; 6], [0; 3]));
    }

    /// A world with one probe everywhere.
    fn lit(probe: Probe) -> BakedLight {
        let size = UVec3::new(4, 3, 2);
        let grid = ProbeGrid {
            origin: Vec3::ZERO,
            spacing: 1.0,
            size,
            places: (0..24).collect(),
            probes: vec![probe; 24],
        };
        BakedLight { exposure: 1.0, brightest: 12.0, sky: None, grid }
    }

    /// Two spaces that meet at x = 1.5.
    fn two_spaces() -> Cells {
        let all = Aabb::new(Vec3::splat(-1.0), Vec3::splat(9.0));
        let mut cells = Cells::whole(all);
        let (left, right) = (all.max.with_x(1.5), all.min.with_x(1.5));
        let sides = [Aabb::new(all.min, left), Aabb::new(right, all.max)];
        cells.axes = Axes::WORLD;
        cells.tree = vec![
            Node::Axial { axis: 0, at: 1.5, sides: [1, 2] },
            Node::Leaf(CellId(0)),
            Node::Leaf(CellId(1)),
        ];
        cells.cells = (0..2)
            .map(|i| Cell { bounds: sides[i], space: i as u32, portals: Vec::new() })
            .collect();
        cells.spaces = (0..2u32)
            .map(|i| Space { bounds: sides[i as usize], cells: i..i + 1, gates: Vec::new() })
            .collect();
        cells
    }

    #[test]
    fn probes_behind_a_wall_do_not_count() {
        let [dark, bright] = [0.1, 10.0].map(|light| Probe::new(&[Vec3::splat(light); 6], 12.0, 7));
        let mut light = lit(dark);
        for index in 0..24 {
            let x = light.grid.coordinates(index).x;
            let wall = if x == 1 { 6 } else { 7 };
            light.grid.probes[index as usize] =
                Probe { links: wall, ..if x < 2 { dark } else { bright } };
        }
        let cells = two_spaces();
        let at = |x: f32| light.at(Vec3::new(x, 0.7, 0.4), &cells).expect("there are probes");
        for (x, known) in [(1.1, 0.1), (1.45, 0.1), (1.55, 10.0), (2.4, 10.0)] {
            let found = at(x).sides[0];
            assert!((found / known - 1.0).abs() < 0.05, "{x}: {found}");
        }
        // With the wall gone, light changes evenly.
        light.grid.probes.iter_mut().for_each(|probe| probe.links = 7);
        let found: Vec<f32> = (0..=20)
            .map(|i| light.at(Vec3::new(1.0 + i as f32 / 20.0, 0.7, 0.4), &cells))
            .map(|found| found.expect("there are probes").sides[0])
            .collect();
        assert!(found.windows(2).all(|two| (two[1] - two[0] - 0.495).abs() < 0.05), "{found:?}");
    }

    #[test]
    fn places_without_probes_take_those_below_or_the_sky() {
        let probe = Probe::new(&[Vec3::ONE; 6], 12.0, 7);
        let mut light = lit(probe);
        light.grid.size = UVec3::new(4, 7, 2);
        light.grid.places = vec![0];
        light.grid.probes.truncate(1);
        let cells = two_spaces();
        let at = |light: &BakedLight, place: [f32; 3]| light.at(place.into(), &cells);
        assert!(at(&light, [0.9, 2.9, 0.9]).is_some() && at(&light, [0.9, 4.1, 0.9]).is_none());
        assert!(at(&light, [2.1, 0.1, 0.1]).is_none());
        light.sky = Some(Probe::new(&[Vec3::splat(3.0); 6], 12.0, 0));
        let open = at(&light, [f32::NAN, 1.0e9, -1.0e9]).expect("the sky is lit");
        assert!((open.sides[3] - 3.0).abs() < 0.1, "{open:?}");
    }
}
