//! Invisibility: how far the nearest non-fuzzy region is in every direction.

use std::ops::Range;

use glam::{DVec2, DVec3};
use rustc_hash::FxHashMap;

use super::{
    Class, Surfaces, Viewpoints,
    faces::{Face, NEAR_DEPTH_M, projected, region, spans},
    facets::Facet,
    raster::{ROUNDING, elements, rows},
    surfaces::{Group, side},
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

/// Depths along a face's axis, and of 2 × 2 of them the least and the greatest, and so on.
#[derive(Clone, Debug)]
struct Depths {
    levels: Vec<Vec<[f32; 2]>>,
}

/// What a buffer says of what is in a box.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Hidden {
    All,
    Nothing,
    Perhaps,
}

/// What meets fewer elements each way is not worth projecting.
const ELEMENTS_MIN: f64 = 4.0;
/// Sheets that are not so many times wider than the box of eyes have next to no non-fuzzy region.
const WIDER_MIN: f32 = 4.0;

/// Interconnected facets that all face all eyes.
struct Sheet {
    bounds: Aabb,
    facets: Vec<usize>,
    /// Its border.
    border: Vec<[DVec3; 2]>,
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
    /// Where the outline of a facet crosses each row, and how far along the facet.
    crossings: Vec<Vec<(f64, DVec3)>>,
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
        let width_m = viewpoints.eyes().size().min_element();
        let mut worthy: Vec<(f64, &Group)> = surfaces
            .groups()
            .iter()
            .map(|group| (buffer.distance(&group.bounds), group))
            .filter(|(distance, group)| buffer.is_worthy(*distance, &group.bounds, width_m))
            .collect();
        worthy.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut sheets = Sheets::new(surfaces, viewpoints, width_m, size);
        for face in viewpoints.faces() {
            buffer.project_all(face, &worthy, &mut sheets);
        }
        buffer
    }

    /// How far it is to a box along the axis that says most.
    fn distance(&self, bounds: &Aabb) -> f64 {
        let (below, above) =
            (bounds.min.as_dvec3() - self.middle, self.middle - bounds.max.as_dvec3());
        below.max(above).max(DVec3::ZERO).max_element()
    }

    /// Whether something may have a non-fuzzy region worth having.
    fn is_worthy(&self, distance: f64, bounds: &Aabb, width_m: f32) -> bool {
        let width = bounds.size().max_element();
        width > WIDER_MIN * width_m
            && f64::from(width) * self.size as f64 > 2.0 * ELEMENTS_MIN * distance
    }

    /// Fills in a face: first with what is around the eyes, then with the rest, nearest first, as far
    /// as that does not hide it.
    fn project_all(&mut self, face: Face, worthy: &[(f64, &Group)], sheets: &mut Sheets<'_>) {
        let size = self.size;
        let mut nearest = vec![f32::INFINITY; size * size];
        let around = worthy.partition_point(|(distance, _)| *distance == 0.0);
        for (_, group) in &worthy[..around] {
            self.project_group(face, group, sheets, &mut nearest);
        }
        self.faces[face.index()] = Some(Depths::new(&nearest, size));
        let mut is_new = false;
        for (_, group) in &worthy[around..] {
            if self.look_on(face, &group.bounds).is_some_and(|hidden| hidden != Hidden::All) {
                self.project_group(face, group, sheets, &mut nearest);
                is_new = true;
            }
        }
        if is_new {
            self.faces[face.index()] = Some(Depths::new(&nearest, size));
        }
    }

    fn project_group(&self, face: Face, group: &Group, of: &mut Sheets<'_>, nearest: &mut [f32]) {
        let surfaces = of.surfaces;
        let found = of.take(group);
        for sheet in &found {
            let distance = self.distance(&sheet.bounds);
            if !self.is_worthy(distance, &sheet.bounds, of.width_m) {
                continue;
            }
            self.scan(face, sheet, surfaces, &mut of.rows, &mut of.spare);
            for ends in &sheet.border {
                let band = region(face, ends, &of.eyes, self.size as f64, &mut of.spare);
                of.rows.erase(&band, self.size);
            }
            of.rows.merge_into(nearest, self.size);
        }
        of.found.insert(group.facets.start, found);
    }

    /// How many elements each way a face has.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Whether no eye sees anything of a box, since what is nearer hides it.
    pub fn hides(&self, bounds: &Aabb) -> bool {
        self.is_blind || bounds.is_empty() || self.look(bounds) == Hidden::All
    }

    fn look(&self, bounds: &Aabb) -> Hidden {
        if !(bounds.min.is_finite() && bounds.max.is_finite()) {
            return Hidden::Nothing;
        }
        let mut all = Hidden::All;
        let mut is_one = true;
        for face in Face::ALL {
            let Some(found) = self.look_on(face, bounds) else { continue };
            all = if is_one || all == found { found } else { Hidden::Perhaps };
            is_one = false;
        }
        all
    }

    /// The same of what projects onto one face; `None` when nothing does.
    fn look_on(&self, face: Face, bounds: &Aabb) -> Option<Hidden> {
        let [low, high] =
            [bounds.min, bounds.max].map(|at| face.turned(at.as_dvec3() - self.middle));
        let (low, high) = (low.with_z(low.z.min(high.z)), high.with_z(low.z.max(high.z)));
        let aside = low.max(-high).max(DVec3::ZERO).truncate();
        if high.z <= 0.0 || aside.max_element() > high.z {
            return None;
        }
        let [across, down] = spans(low, high)?;
        let half = 0.5 * self.size as f64;
        let of = |[low, high]: [f64; 2]| {
            elements((low + 1.0) * half, (high + 1.0) * half, self.size, ROUNDING)
        };
        let (columns, rows) = of(across).zip(of(down))?;
        let Some(depths) = &self.faces[face.index()] else { return Some(Hidden::Nothing) };
        // On this face nothing is nearer along its axis than it is aside.
        let nearest = low.z.max(aside.max_element());
        Some(depths.look(columns, rows, [hidden_from(nearest), hidden_from(high.z)]))
    }

    /// Whether no eye sees anything of a patch.
    fn hides_patch(&self, surfaces: &Surfaces, patch: usize) -> bool {
        let mut spare = Vec::new();
        Face::ALL.into_iter().all(|face| {
            let polygon = self.project(face, surfaces, patch, &mut spare);
            if polygon.is_empty() {
                return true;
            }
            let Some(depths) = &self.faces[face.index()] else { return false };
            let plane = Plane::of(surfaces, patch, self.middle, face);
            plane.is_behind(&polygon, &depths.levels[0], self.size)
        })
    }

    /// Marks the patches that no eye sees, of those that are not settled. `classes` are those of all
    /// patches, in their order.
    pub fn find_hidden(&self, surfaces: &Surfaces, classes: &mut [Class]) {
        for (run, bounds) in surfaces.clusters() {
            let all = if self.is_blind { Hidden::All } else { self.look(bounds) };
            if all == Hidden::Nothing {
                continue;
            }
            for patch in run {
                if classes.get(patch) != Some(&Class::Remaining) {
                    continue;
                }
                let hidden = match all {
                    Hidden::All => true,
                    _ => match self.look(&surfaces.patch(patch).bounds) {
                        Hidden::All => true,
                        Hidden::Nothing => false,
                        Hidden::Perhaps => self.hides_patch(surfaces, patch),
                    },
                };
                if hidden {
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

    /// Puts the facets of a sheet into rows.
    fn scan(
        &self,
        face: Face,
        sheet: &Sheet,
        surfaces: &Surfaces,
        rows_of: &mut Rows,
        spare: &mut Vec<DVec3>,
    ) {
        for facet in sheet.facets.iter().map(|facet| surfaces.facet(*facet)) {
            let ends =
                facet.edges.iter().map(|edge| edge.ends.map(|end| face.turned(end - self.middle)));
            let plane = rows_of.planes.len() as u32;
            let depths = ends.clone().flatten().map(|end| end.z);
            rows_of.planes.push(Plane {
                normal: face.turned(facet.normal),
                offset: facet.offset - facet.normal.dot(self.middle),
                nearest: depths.clone().fold(f64::INFINITY, f64::min),
                farthest: depths.fold(f64::NEG_INFINITY, f64::max),
            });
            rows_of.cross(plane, ends.clone(), self.size);
            // Next to its outline it may meet an element and not the line through the middle of it.
            for [from, to] in ends {
                let line = projected(&mut vec![from, to], self.size as f64, spare);
                rows(&line, self.size, ROUNDING, |row, from, to| {
                    rows_of.add(row, [from, to], plane)
                });
            }
        }
    }
}

/// The depth from which on what is behind counts as hidden: less is nearer than `nearest`.
fn hidden_from(nearest: f64) -> f32 {
    ((nearest - BEHIND_M) * (1.0 - BEHIND_SHARE)) as f32
}

/// Interconnected patches of a surface that all face all eyes, on either side, found when they are needed.
struct Sheets<'a> {
    surfaces: &'a Surfaces,
    eyes: [DVec3; 8],
    width_m: f32,
    /// By the first facet of a surface.
    found: FxHashMap<usize, Vec<Sheet>>,
    /// Of each facet, where the eyes are.
    sides: Vec<i8>,
    is_done: Vec<bool>,
    rows: Rows,
    spare: Vec<DVec3>,
}

impl<'a> Sheets<'a> {
    fn new(surfaces: &'a Surfaces, viewpoints: &Viewpoints, width_m: f32, size: usize) -> Self {
        Self {
            surfaces,
            eyes: viewpoints.corners(),
            width_m,
            found: FxHashMap::default(),
            sides: vec![0; surfaces.facets()],
            is_done: vec![false; surfaces.facets()],
            rows: Rows::new(size),
            spare: Vec::new(),
        }
    }

    fn take(&mut self, group: &Group) -> Vec<Sheet> {
        if let Some(found) = self.found.remove(&group.facets.start) {
            return found;
        }
        for facet in group.facets.clone() {
            let Facet { normal, offset, .. } = self.surfaces.facet(facet);
            self.sides[facet] = side(*normal, *offset, &self.eyes);
        }
        let mut sheets = Vec::new();
        for facet in group.facets.clone() {
            if self.sides[facet] != 0 && !std::mem::replace(&mut self.is_done[facet], true) {
                sheets.push(self.grow(facet));
            }
        }
        sheets
    }

    /// All that is joined to a facet and faces the eyes as it does.
    fn grow(&mut self, first: usize) -> Sheet {
        let mut sheet = Sheet { bounds: Aabb::EMPTY, facets: vec![first], border: Vec::new() };
        let mut next = 0;
        while let Some(&number) = sheet.facets.get(next) {
            next += 1;
            let facet = self.surfaces.facet(number);
            sheet.bounds = sheet.bounds.union(&facet.bounds);
            for edge in &facet.edges {
                let joined = edge.join.filter(|(other, same_way)| {
                    let other = self.sides[*other as usize];
                    other != 0 && (other == self.sides[number]) == *same_way
                });
                match joined {
                    None => sheet.border.push(edge.ends),
                    Some((other, _)) => {
                        if !std::mem::replace(&mut self.is_done[other as usize], true) {
                            sheet.facets.push(other as usize);
                        }
                    }
                }
            }
        }
        sheet
    }
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

impl Plane {
    /// Whether in all elements that a patch in this plane meets something is before it.
    fn is_behind(&self, polygon: &[DVec2], depths: &[[f32; 2]], size: usize) -> bool {
        let mut is_behind = true;
        rows(polygon, size, ROUNDING, |row, from, to| {
            is_behind = is_behind
                && (from..=to).all(|column| {
                    let [depth, _] = self.depths(column, row, size);
                    depths[row * size + column][1] < hidden_from(depth)
                });
        });
        is_behind
    }
}

impl Rows {
    fn new(size: usize) -> Self {
        Self {
            spans: (0..size).map(|_| Vec::new()).collect(),
            border: vec![Vec::new(); size],
            touched: 0..0,
            crossings: vec![Vec::new(); size],
            planes: Vec::new(),
            depths: vec![f64::NEG_INFINITY; size],
        }
    }

    fn add(&mut self, row: usize, [from, to]: [usize; 2], plane: u32) {
        self.spans[row].push(Span { from: from as u32, to: to as u32, plane });
        self.touch(row);
    }

    /// Adds what lies in a facet of the line through the middle of each row, by where the outline crosses it.
    fn cross(&mut self, plane: u32, ends: impl Iterator<Item = [DVec3; 2]>, size: usize) {
        let Plane { normal, .. } = self.planes[plane as usize];
        let place = |row: usize| (row as f64 + 0.5) * (2.0 / size as f64) - 1.0;
        let mut touched = size..0;
        for [from, to] in ends {
            // Beyond an eye's side a line may cross any row.
            let is_ahead = from.z > NEAR_DEPTH_M && to.z > NEAR_DEPTH_M;
            let at = |end: DVec3| (end.y / end.z + 1.0) * 0.5 * size as f64;
            let (low, high) = (at(from).min(at(to)), at(from).max(at(to)));
            let span = if is_ahead { elements(low, high, size, 1.0) } else { Some([0, size - 1]) };
            let Some([first, last]) = span else { continue };
            for row in first..=last {
                let upright = place(row);
                let heights = [from, to].map(|end| end.y - upright * end.z);
                if (heights[0] < 0.0) == (heights[1] < 0.0) {
                    continue;
                }
                let meeting = from + (to - from) * (heights[0] / (heights[0] - heights[1]));
                let along =
                    DVec3::new(-normal.y * upright - normal.z, normal.x * upright, normal.x);
                self.crossings[row].push((meeting.dot(along), meeting));
                touched = touched.start.min(row)..touched.end.max(row + 1);
            }
        }
        for row in touched {
            let mut crossings = std::mem::take(&mut self.crossings[row]);
            crossings.sort_unstable_by(|one, other| one.0.total_cmp(&other.0));
            for pair in crossings.chunks_exact(2) {
                if let Some(span) = across(pair[0].1, pair[1].1, size) {
                    self.add(row, span, plane);
                }
            }
            crossings.clear();
            self.crossings[row] = crossings;
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
}

/// The elements of a row that a line in it meets.
fn across(from: DVec3, to: DVec3, size: usize) -> Option<[usize; 2]> {
    let (near, far) = if from.z < to.z { (from, to) } else { (to, from) };
    if far.z <= NEAR_DEPTH_M {
        return None;
    }
    let share = ((NEAR_DEPTH_M - near.z) / (far.z - near.z)).max(0.0);
    let near = if near.z < NEAR_DEPTH_M { near.lerp(far, share) } else { near };
    let at = |point: DVec3| (point.x / point.z + 1.0) * 0.5 * size as f64;
    let (low, high) = (at(near).min(at(far)), at(near).max(at(far)));
    elements(low, high, size, ROUNDING)
}

impl Depths {
    fn new(nearest: &[f32], size: usize) -> Self {
        let first: Vec<[f32; 2]> = nearest.iter().map(|depth| [*depth; 2]).collect();
        let (mut levels, mut width) = (vec![first], size);
        while width > 1 {
            let (below, half) = (&levels[levels.len() - 1], width.div_ceil(2));
            let mut level = vec![[f32::INFINITY, f32::NEG_INFINITY]; half * half];
            for (row, depths) in below.chunks_exact(width).enumerate() {
                let above = &mut level[row / 2 * half..][..half];
                for (pair, [least, most]) in depths.chunks(2).zip(above) {
                    for depth in pair {
                        (*least, *most) = (least.min(depth[0]), most.max(depth[1]));
                    }
                }
            }
            levels.push(level);
            width = half;
        }
        Self { levels }
    }

    /// What depths there are in a rectangle: all less than one, or none less than another.
    fn look(&self, columns: [usize; 2], rows: [usize; 2], [near, far]: [f32; 2]) -> Hidden {
        // Where the rectangle is no more than two or three wide.
        let widest = (columns[1] - columns[0]).max(rows[1] - rows[0]) + 1;
        let level = (widest.ilog2() as usize).min(self.levels.len() - 1);
        let width = self.width(level);
        let (mut all, mut none) = (true, true);
        for row in rows[0] >> level..=rows[1] >> level {
            for column in columns[0] >> level..=columns[1] >> level {
                let [least, most] = self.levels[level][row * width + column];
                all = all
                    && (most < near || self.are_before(level, [column, row], columns, rows, near));
                none &= least >= far;
            }
        }
        match (all, none) {
            (true, _) => Hidden::All,
            (false, true) => Hidden::Nothing,
            (false, false) => Hidden::Perhaps,
        }
    }

    /// Whether all depths in the part of a rectangle that an entry of a level is for are less.
    fn are_before(
        &self,
        level: usize,
        at: [usize; 2],
        columns: [usize; 2],
        rows: [usize; 2],
        depth: f32,
    ) -> bool {
        if self.levels[level][at[1] * self.width(level) + at[0]][1] < depth {
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
                .all(|column| self.are_before(level - 1, [column, row], columns, rows, depth))
        })
    }

    fn width(&self, level: usize) -> usize {
        self.levels[level].len().isqrt()
    }
}
