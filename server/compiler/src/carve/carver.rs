//! Carving one unit after the other.

use std::collections::{HashSet, VecDeque};

use super::{
    caps::cap_polygons,
    carved_model::{CapPolygon, Class, Polygon},
    plane::{Facing, Plane},
    polygons::{Border, Polygons},
    sealing::Sealing,
    topology::FastMap,
    volume::{Triangle, Volume, area},
};

/// A carving unit takes at most this times its own area of other polygons.
pub const LOSS_MAX: f64 = 2.0;

/// A carving unit may take this much of other polygons without caps in return, in square metres.
pub const FREE_LOSS_M2: f64 = 1.0;

/// A model that is being carved.
pub(super) struct Carver<'a> {
    triangles: &'a [Triangle],
    polygons: &'a Polygons,
    classes: &'a [Class],
    sealing: Sealing<'a>,
    /// What is left of each polygon that was cut.
    left: FastMap<u32, Vec<Triangle>>,
    /// The attempt at which each polygon was last visited.
    seen: Vec<u32>,
    attempts: u32,
    carving: Carving,
}

/// The result of carving, as it grows.
#[derive(Default)]
pub(super) struct Carving {
    pub kept: Vec<Polygon>,
    pub cuttings: Vec<Polygon>,
    pub caps: Vec<CapPolygon>,
    pub units: usize,
    pub confined: usize,
}

/// A polygon split by a volume.
struct Split {
    polygon: u32,
    outside: Vec<Triangle>,
    inside: Vec<Triangle>,
}

impl<'a> Carver<'a> {
    pub(super) fn new(
        triangles: &'a [Triangle],
        polygons: &'a Polygons,
        classes: &'a [Class],
    ) -> Self {
        assert_eq!(classes.len(), polygons.len(), "a class for each polygon");
        Self {
            triangles,
            polygons,
            classes,
            sealing: Sealing::new(triangles, polygons),
            left: FastMap::default(),
            seen: vec![0; polygons.len()],
            attempts: 0,
            carving: Carving::default(),
        }
    }

    /// Carves a unit. Does nothing and returns false when it would take too much of other polygons.
    pub(super) fn carve(&mut self, unit: &[u32]) -> bool {
        let volume = Volume::of(self.polygons, unit);
        let Some((splits, lost)) = self.splits(unit, &volume) else { return false };
        let caps = self.caps(&volume, &splits);
        let gained: f64 =
            caps.iter().filter(|cap| cap.sealed).map(|cap| area(&cap.triangles)).sum();
        if lost > FREE_LOSS_M2.max(gained) {
            return false;
        }
        self.carving.caps.extend(caps);
        self.take(splits);
        true
    }

    /// The caps that close the hole of a unit.
    fn caps(&self, volume: &Volume, splits: &[Split]) -> Vec<CapPolygon> {
        let unit = self.carving.units as u32;
        let cutting: Vec<Triangle> =
            splits.iter().flat_map(|split| split.inside.iter().copied()).collect();
        let cut: HashSet<u32> = splits.iter().map(|split| split.polygon).collect();
        let is_closed = cut.iter().all(|&polygon| self.sealing.is_closed(polygon));
        let caps = cap_polygons(volume, &cutting, self.polygons.tolerance).into_iter();
        let seal = |(plane, triangles): (Plane, Vec<Triangle>)| {
            let sealed = is_closed && self.sealing.holds(&triangles, plane.normal, &cut);
            CapPolygon { plane, triangles, unit, sealed }
        };
        caps.map(seal).collect()
    }

    /// Carves only the polygons of the unit itself.
    pub(super) fn carve_confined(&mut self, unit: &[u32]) {
        let volume = Volume::of(self.polygons, unit);
        let splits = unit.iter().map(|&polygon| self.split(polygon, &volume)).collect();
        self.take(splits);
        self.carving.confined += 1;
    }

    /// Splits the polygons that are connected to the unit inside the volume (Lei and Ouhyoung 1999,
    /// section 4.2.1, Fig. 8), and gives how much of the inside is not the unit's, in square
    /// metres. None when that is too much.
    fn splits(&mut self, unit: &[u32], volume: &Volume) -> Option<(Vec<Split>, f64)> {
        self.attempts += 1;
        let mut pool: VecDeque<u32> = unit.iter().copied().collect();
        for &polygon in unit {
            self.seen[polygon as usize] = self.attempts;
        }
        let (mut own, mut lost) = (0.0, 0.0);
        let mut splits = Vec::new();
        let mut taken = 0;
        while let Some(polygon) = pool.pop_front() {
            taken += 1;
            let split = self.split(polygon, volume);
            let inside = area(&split.inside);
            // A polygon that only touches the volume is not in it.
            if inside <= volume.near * volume.near {
                continue;
            }
            // Polygons of the unit come first, so that all of their area is known before others
            // count.
            if taken <= unit.len() {
                own += inside;
            } else {
                lost += inside;
            }
            if lost > LOSS_MAX * own {
                return None;
            }
            for border in self.polygons.borders_of(polygon) {
                if volume.meets(self.polygons.segment(border)) {
                    self.pool_neighbours(border, &mut pool);
                }
            }
            splits.push(split);
        }
        Some((splits, lost))
    }

    /// Adds unvisited polygons on the edge of a border.
    fn pool_neighbours(&mut self, border: &Border, pool: &mut VecDeque<u32>) {
        for other in self.polygons.on_edge(border) {
            let seen = &mut self.seen[other.polygon as usize];
            if *seen != self.attempts {
                *seen = self.attempts;
                pool.push_back(other.polygon);
            }
        }
    }

    /// Splits what is left of a polygon.
    fn split(&self, polygon: u32, volume: &Volume) -> Split {
        let (mut outside, mut inside) = (Vec::new(), Vec::new());
        let mut split = |triangle: &Triangle| volume.split(triangle, &mut outside, &mut inside);
        match self.left.get(&polygon) {
            Some(left) => left.iter().for_each(&mut split),
            None => self.polygons.triangles[polygon as usize]
                .iter()
                .for_each(|&triangle| split(&self.triangles[triangle as usize])),
        }
        Split { polygon, outside, inside }
    }

    /// Removes the inside parts from the model.
    fn take(&mut self, splits: Vec<Split>) {
        let unit = Some(self.carving.units as u32);
        self.carving.units += 1;
        for Split { polygon, outside, inside } in splits {
            let (class, plane) =
                (self.classes[polygon as usize], self.polygons.planes[polygon as usize]);
            if !inside.is_empty() {
                self.carving.cuttings.push(Polygon { class, plane, triangles: inside, unit });
            }
            self.left.insert(polygon, outside);
        }
    }

    /// The result, with what is left of the polygons of the model.
    pub(super) fn finish(mut self) -> Carving {
        for polygon in 0..self.polygons.len() as u32 {
            let triangles = match self.left.remove(&polygon) {
                Some(left) => left,
                None => self.polygons.triangles[polygon as usize]
                    .iter()
                    .map(|&triangle| self.triangles[triangle as usize])
                    .collect(),
            };
            if triangles.is_empty() {
                continue;
            }
            let plane = self.polygons.planes[polygon as usize];
            let class =
                match (self.classes[polygon as usize], self.polygons.facings[polygon as usize]) {
                    // All non-axial edges of the polygon were in the volume.
                    (Class::NonAxial, Facing::Axis(_)) => Class::Axial,
                    (Class::NonAxial, Facing::Upright) => Class::SemiAxial,
                    (class, _) => class,
                };
            self.carving.kept.push(Polygon { class, plane, triangles, unit: None });
        }
        self.carving
    }
}
