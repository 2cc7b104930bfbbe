//! Invisibility: how far the nearest non-fuzzy region is in every direction.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::{
    Class, Surfaces, Viewpoints,
    faces::{Face, projected, region, spans},
    raster::{ROUNDING, elements, rows},
};
use crate::geometry::Aabb;

/// What lies no farther behind counts as not hidden, in metres: patches touch what they belong to.
const BEHIND_M: f64 = 1e-3;
/// The same as a part of the distance, for what single precision leaves open.
const BEHIND_SHARE: f64 = 1e-5;

/// For every direction, how far the nearest surface is at the most that hides what is behind it from
/// all eyes of a box, as seen from the middle of it.
#[derive(Clone, Debug)]
pub struct Buffer {
    size: usize,
    middle: DVec3,
    /// By [`Face::index`]; `None` where a face is inactive.
    faces: [Option<Depths>; 6],
    /// There are no eyes to see anything.
    is_blind: bool,
}

/// Depths along a face's axis, and of 2 × 2 of them the greatest, and so on.
#[derive(Clone, Debug)]
struct Depths {
    levels: Vec<Vec<f32>>,
}

/// Interconnected patches that all face all eyes.
#[derive(Default)]
struct Sheet {
    patches: Vec<usize>,
    /// Its border: a patch and an edge of it.
    border: Vec<(usize, usize)>,
}

/// A run of elements of a row, and the plane whose depths they have.
struct Span {
    from: u32,
    to: u32,
    plane: u32,
}

/// A patch's plane in a face's coordinates, relative to the middle of the eyes.
struct Plane {
    normal: DVec3,
    offset: f64,
    nearest: f64,
    farthest: f64,
}

/// One face's rows while a sheet is projected, kept from one to the next.
struct Rows {
    spans: Vec<Vec<Span>>,
    border: Vec<Vec<[u32; 2]>>,
    touched: Range<usize>,
    planes: Vec<Plane>,
    depths: Vec<f64>,
}

impl Buffer {
    /// Projects all surfaces that are wide enough to hide anything. Faces have `size` × `size` elements, from
    /// 1 to 4,096 each way.
    pub fn new(surfaces: &Surfaces, viewpoints: &Viewpoints, size: usize) -> Self {
        let size = size.clamp(1, 4_096);
        let mut buffer = Self {
            size,
            middle: viewpoints.middle(),
            faces: Default::default(),
            is_blind: viewpoints.is_empty(),
        };
        if buffer.is_blind {
            return buffer;
        }
        let eyes = viewpoints.corners();
        let sheets = sheets(surfaces, &eyes, viewpoints.eyes().size().min_element());
        let (mut rows, mut spare) = (Rows::new(size), Vec::new());
        for face in viewpoints.faces() {
            let mut nearest = vec![f32::INFINITY; size * size];
            for sheet in &sheets {
                buffer.scan(face, sheet, surfaces, &mut rows, &mut spare);
                for &(patch, edge) in &sheet.border {
                    let ends = surfaces.ends(patch, edge);
                    rows.erase(&region(face, &ends, &eyes, size as f64, &mut spare), size);
                }
                rows.merge_into(&mut nearest, size);
            }
            buffer.faces[face.index()] = Some(Depths::new(nearest, size));
        }
        buffer
    }

    /// How many elements each way a face has.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Whether no eye sees anything of a box, since what is nearer hides it.
    pub fn hides(&self, bounds: &Aabb) -> bool {
        self.is_blind
            || bounds.is_empty()
            || Face::ALL.into_iter().all(|face| self.hides_on(face, bounds))
    }

    fn hides_on(&self, face: Face, bounds: &Aabb) -> bool {
        let [low, high] =
            [bounds.min, bounds.max].map(|at| face.turned(at.as_dvec3() - self.middle));
        let (low, high) = (low.with_z(low.z.min(high.z)), high.with_z(low.z.max(high.z)));
        let aside = low.max(-high).max(DVec3::ZERO).truncate();
        if high.z <= 0.0 || aside.max_element() > high.z {
            return true;
        }
        let Some(depths) = &self.faces[face.index()] else { return false };
        let Some([across, down]) = spans(low, high) else { return true };
        let half = 0.5 * self.size as f64;
        let of = |[low, high]: [f64; 2]| {
            elements((low + 1.0) * half, (high + 1.0) * half, self.size, ROUNDING)
        };
        let Some((columns, rows)) = of(across).zip(of(down)) else { return true };
        // On this face nothing is nearer along its axis than it is aside.
        let nearest = low.z.max(aside.max_element());
        depths.are_before(columns, rows, hidden_from(nearest))
    }

    /// Whether no eye sees anything of a patch.
    fn hides_patch(&self, surfaces: &Surfaces, patch: usize, rows: &mut Rows) -> bool {
        let mut spare = Vec::new();
        Face::ALL.into_iter().all(|face| {
            let polygon = self.project(face, surfaces, patch, &mut spare);
            if polygon.is_empty() {
                return true;
            }
            let Some(depths) = &self.faces[face.index()] else { return false };
            let plane = Plane::of(surfaces, patch, self.middle, face);
            rows.hides(&polygon, &plane, &depths.levels[0], self.size)
        })
    }

    /// Marks the patches that no eye sees.
    pub(super) fn find_hidden(&self, surfaces: &Surfaces, classes: &mut [Class]) {
        let mut rows = Rows::new(0);
        for (run, bounds) in surfaces.clusters() {
            let all = self.hides(bounds);
            for patch in run {
                if classes[patch] != Class::Remaining {
                    continue;
                }
                let bounds = &surfaces.patch(patch).bounds;
                if all || self.hides(bounds) || self.hides_patch(surfaces, patch, &mut rows) {
                    classes[patch] = Class::Invisible;
                }
            }
        }
    }

    /// What of a patch the eye in the middle sees on a face, in elements.
    fn project(
        &self,
        face: Face,
        surfaces: &Surfaces,
        patch: usize,
        spare: &mut Vec<DVec3>,
    ) -> Vec<DVec2> {
        let corners = surfaces.corners(patch).map(|corner| face.turned(corner - self.middle));
        projected(&mut corners.collect(), self.size as f64, spare)
    }

    /// Puts the patches of a sheet into rows.
    fn scan(
        &self,
        face: Face,
        sheet: &Sheet,
        surfaces: &Surfaces,
        rows_of: &mut Rows,
        spare: &mut Vec<DVec3>,
    ) {
        for &patch in &sheet.patches {
            let polygon = self.project(face, surfaces, patch, spare);
            if polygon.is_empty() {
                continue;
            }
            let plane = rows_of.planes.len() as u32;
            rows_of.planes.push(Plane::of(surfaces, patch, self.middle, face));
            rows(&polygon, self.size, ROUNDING, |row, from, to| {
                let span = Span { from: from as u32, to: to as u32, plane };
                rows_of.spans[row].push(span);
                rows_of.touch(row);
            });
        }
    }
}

/// The depth from which on what is behind counts as hidden: less is nearer than `nearest`.
fn hidden_from(nearest: f64) -> f32 {
    ((nearest - BEHIND_M) * (1.0 - BEHIND_SHARE)) as f32
}

/// Groups the patches that face all eyes, on either side, with those next to them that do so too.
/// Those that are narrower than the box of eyes have no non-fuzzy region.
fn sheets(surfaces: &Surfaces, eyes: &[DVec3; 8], width_m: f32) -> Vec<Sheet> {
    let sides: Vec<i8> = (0..surfaces.len()).map(|patch| surfaces.side(patch, eyes)).collect();
    let mut is_done: Vec<bool> = sides.iter().map(|side| *side == 0).collect();
    let (mut sheets, mut waiting) = (Vec::new(), Vec::new());
    for first in 0..surfaces.len() {
        if is_done[first] {
            continue;
        }
        let (mut sheet, mut bounds) = (Sheet::default(), Aabb::EMPTY);
        is_done[first] = true;
        waiting.push(first);
        while let Some(patch) = waiting.pop() {
            sheet.patches.push(patch);
            bounds = bounds.union(&surfaces.patch(patch).bounds);
            for edge in surfaces.edges(patch) {
                let next = surfaces.join_at(edge).filter(|join| {
                    let other = sides[join.patch as usize];
                    other != 0 && (other == sides[patch]) == join.same_way
                });
                match next {
                    None => sheet.border.push((patch, edge)),
                    Some(join) if !is_done[join.patch as usize] => {
                        is_done[join.patch as usize] = true;
                        waiting.push(join.patch as usize);
                    }
                    Some(_) => {}
                }
            }
        }
        if bounds.size().max_element() > width_m {
            sheets.push(sheet);
        }
    }
    sheets
}

impl Plane {
    fn of(surfaces: &Surfaces, patch: usize, middle: DVec3, face: Face) -> Self {
        let depths = surfaces.corners(patch).map(|corner| face.turned(corner - middle).z);
        let patch = surfaces.patch(patch);
        Self {
            normal: face.turned(patch.normal),
            offset: patch.offset - patch.normal.dot(middle),
            nearest: depths.clone().fold(f64::INFINITY, f64::min),
            farthest: depths.fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// The least and the greatest depth in an element.
    fn depths(&self, column: usize, row: usize, size: usize) -> [f64; 2] {
        let at = |corner: usize| {
            let place = DVec2::new((column + (corner & 1)) as f64, (row + (corner >> 1)) as f64);
            let direction = (place * (2.0 / size as f64) - 1.0).extend(1.0);
            self.offset / self.normal.dot(direction)
        };
        let depths = [0, 1, 2, 3].map(at);
        if depths.iter().all(|depth| *depth > 0.0 && depth.is_finite()) {
            let least = depths.into_iter().fold(f64::INFINITY, f64::min);
            let most = depths.into_iter().fold(0.0, f64::max);
            [least.max(self.nearest), most.min(self.farthest)]
        } else {
            // Seen along its plane.
            [self.nearest.max(0.0), self.farthest]
        }
    }
}

impl Rows {
    fn new(size: usize) -> Self {
        Self {
            spans: (0..size).map(|_| Vec::new()).collect(),
            border: vec![Vec::new(); size],
            touched: 0..0,
            planes: Vec::new(),
            depths: vec![f64::NEG_INFINITY; size],
        }
    }

    fn touch(&mut self, row: usize) {
        let Range { start, end } = self.touched;
        self.touched = if start == end { row..row + 1 } else { start.min(row)..end.max(row + 1) };
    }

    /// Takes the band of an edge out of what is to be merged.
    fn erase(&mut self, polygon: &[DVec2], size: usize) {
        rows(polygon, size, 4.0 * ROUNDING, |row, from, to| {
            if self.touched.contains(&row) {
                self.border[row].push([from as u32, to as u32]);
            }
        });
    }

    /// The scan-line method: in each row the patches' depths, without the border's bands, go into
    /// the buffer where they are nearer.
    fn merge_into(&mut self, nearest: &mut [f32], size: usize) {
        for row in std::mem::replace(&mut self.touched, 0..0) {
            let spans = &mut self.spans[row];
            let first = spans.iter().map(|span| span.from as usize).min().unwrap_or(size);
            let last = spans.iter().map(|span| span.to as usize).max().unwrap_or(0);
            for Span { from, to, plane } in spans.drain(..) {
                for column in from as usize..=to as usize {
                    let [_, farthest] = self.planes[plane as usize].depths(column, row, size);
                    self.depths[column] = self.depths[column].max(farthest);
                }
            }
            for [from, to] in self.border[row].drain(..) {
                self.depths[from as usize..=to as usize].fill(f64::NEG_INFINITY);
            }
            for column in first..=last.min(size - 1) {
                let depth = std::mem::replace(&mut self.depths[column], f64::NEG_INFINITY);
                if depth > 0.0 {
                    let element = &mut nearest[row * size + column];
                    *element = element.min((depth as f32).next_up());
                }
            }
        }
        self.planes.clear();
    }

    /// Whether in all elements that a patch meets something is before it.
    fn hides(&self, polygon: &[DVec2], plane: &Plane, nearest: &[f32], size: usize) -> bool {
        let mut hides = true;
        rows(polygon, size, ROUNDING, |row, from, to| {
            hides = hides
                && (from..=to).all(|column| {
                    let [depth, _] = plane.depths(column, row, size);
                    nearest[row * size + column] < hidden_from(depth)
                });
        });
        hides
    }
}

impl Depths {
    fn new(nearest: Vec<f32>, size: usize) -> Self {
        let (mut levels, mut width) = (vec![nearest], size);
        while width > 1 {
            let (below, half) = (&levels[levels.len() - 1], width.div_ceil(2));
            let mut level = vec![f32::NEG_INFINITY; half * half];
            for (i, depth) in below.iter().enumerate() {
                let above = &mut level[i / width / 2 * half + i % width / 2];
                *above = above.max(*depth);
            }
            levels.push(level);
            width = half;
        }
        Self { levels }
    }

    /// Whether all depths in a rectangle are less.
    fn are_before(&self, columns: [usize; 2], rows: [usize; 2], depth: f32) -> bool {
        self.is_before(self.levels.len() - 1, [0, 0], columns, rows, depth)
    }

    fn is_before(
        &self,
        level: usize,
        at: [usize; 2],
        columns: [usize; 2],
        rows: [usize; 2],
        depth: f32,
    ) -> bool {
        let width = self.width(level);
        if self.levels[level][at[1] * width + at[0]] < depth {
            return true;
        }
        if level == 0 {
            return false;
        }
        let below = self.width(level - 1);
        let within = |at: usize, span: [usize; 2]| {
            let (first, last) = (span[0] >> (level - 1), span[1] >> (level - 1));
            (2 * at).max(first)..=(2 * at + 1).min(last).min(below - 1)
        };
        within(at[1], rows).all(|row| {
            within(at[0], columns)
                .all(|column| self.is_before(level - 1, [column, row], columns, rows, depth))
        })
    }

    fn width(&self, level: usize) -> usize {
        self.levels[level].len().isqrt()
    }
}
