//! The scan-line method: the rows of elements that facets cover, without the bands of their borders
//! (Lim 1999, Appendix 3).

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::{
    depths::hidden_from,
    faces::{CubeFace, NEAR_DEPTH_M},
    patches::PatchMesh,
    raster::{ROUNDING, elements, rows},
};

/// A run of elements in a row, and the plane that has their depths.
pub(super) struct ElementRun {
    pub(super) from: u32,
    pub(super) to: u32,
    pub(super) plane: u32,
}

/// The plane of a patch or facet in a face's coordinates, relative to the middle of the box of
/// eyes.
pub(super) struct FacePlane {
    pub(super) normal: DVec3,
    pub(super) offset: f64,
    /// The least and the greatest depth of its corners.
    pub(super) nearest: f64,
    pub(super) farthest: f64,
}

/// The depths of a plane along a row of elements.
pub(super) struct RowDepths {
    /// The least and the greatest reciprocal of the depth at the left end.
    ends: [f64; 2],
    /// By how much the reciprocal grows from element to element.
    growth: f64,
    nearest: f64,
    farthest: f64,
}

impl RowDepths {
    /// The least depth in an element, or less where the plane is seen edge-on.
    #[inline]
    pub(super) fn least(&self, column: usize) -> f64 {
        let inverse = self.ends[1] + self.growth * column as f64;
        let is_ahead = self.ends[0] + self.growth * column as f64 > 0.0;
        if is_ahead { (1.0 / inverse).max(self.nearest) } else { self.nearest }
    }

    /// The greatest depth in an element.
    #[inline]
    pub(super) fn most(&self, column: usize) -> f64 {
        let inverse = self.ends[0] + self.growth * column as f64;
        if inverse > 0.0 { (1.0 / inverse).min(self.farthest) } else { self.farthest }
    }
}

/// The rows of a face while a sub-surface is projected, kept from one to the next to save
/// allocations.
pub(super) struct FaceRows {
    /// For each row the runs that facets cover.
    runs: Vec<Vec<ElementRun>>,
    /// For each row the first and last elements that bands of the border cover.
    border: Vec<Vec<[u32; 2]>>,
    /// The rows with runs.
    touched: Range<usize>,
    /// For each row the places where the outline of a facet crosses its middle, and how far along
    /// the row each is.
    crossings: Vec<Vec<(f64, DVec3)>>,
    pub(super) planes: Vec<FacePlane>,
    /// The depths of one row.
    depths: Vec<f64>,
}

impl FacePlane {
    /// The plane of a patch.
    pub(super) fn of(mesh: &PatchMesh, patch: usize, middle: DVec3, face: CubeFace) -> Self {
        let depths = mesh.corners(patch).map(|corner| face.turned(corner - middle).z);
        let patch = mesh.patch(patch);
        Self {
            normal: face.turned(patch.normal),
            offset: patch.offset - patch.normal.dot(middle),
            nearest: depths.clone().fold(f64::INFINITY, f64::min),
            farthest: depths.fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// The depths along a row of a face with `size` × `size` elements.
    pub(super) fn row(&self, row: usize, size: usize) -> RowDepths {
        let step = 2.0 / size as f64;
        let at = |column: f64, row: f64| {
            let direction = DVec3::new(column * step - 1.0, row * step - 1.0, 1.0);
            self.normal.dot(direction) / self.offset
        };
        let [above, below] = [row as f64, (row + 1) as f64].map(|row| at(0.0, row));
        let growth = self.normal.x * step / self.offset;
        let ends = [above.min(below) + growth.min(0.0), above.max(below) + growth.max(0.0)];
        RowDepths { ends, growth, nearest: self.nearest.max(0.0), farthest: self.farthest }
    }

    /// Whether something hides a patch in this plane in all elements that the patch meets.
    pub(super) fn is_behind(&self, polygon: &[DVec2], depths: &[f32], size: usize) -> bool {
        let mut is_behind = true;
        rows(polygon, size, ROUNDING, |row, from, to| {
            let inverse = self.row(row, size);
            let depths = &depths[row * size..][from..=to];
            is_behind = is_behind
                && (from..=to)
                    .zip(depths)
                    .all(|(column, depth)| *depth < hidden_from(inverse.least(column)));
        });
        is_behind
    }
}

impl FaceRows {
    pub(super) fn new(size: usize) -> Self {
        Self {
            runs: (0..size).map(|_| Vec::new()).collect(),
            border: vec![Vec::new(); size],
            touched: 0..0,
            crossings: vec![Vec::new(); size],
            planes: Vec::new(),
            depths: vec![f64::NEG_INFINITY; size],
        }
    }

    /// Adds a run of elements, from its first to its last.
    pub(super) fn add(&mut self, row: usize, [from, to]: [usize; 2], plane: u32) {
        debug_assert!(from <= to && (plane as usize) < self.planes.len());
        self.runs[row].push(ElementRun { from: from as u32, to: to as u32, plane });
        self.touch(row);
    }

    /// Adds, for each row, the parts of the line through its middle that lie in a facet. They are
    /// between the places where the outline crosses the line.
    pub(super) fn cross(
        &mut self,
        plane: u32,
        ends: impl Iterator<Item = [DVec3; 2]>,
        size: usize,
    ) {
        let FacePlane { normal, .. } = self.planes[plane as usize];
        let place = |row: usize| (row as f64 + 0.5) * (2.0 / size as f64) - 1.0;
        let mut touched = size..0;
        for [from, to] in ends {
            // A line that reaches behind the eye may cross any row.
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

    /// Excludes the band of an edge from what is merged.
    pub(super) fn erase(&mut self, polygon: &[DVec2], size: usize) {
        rows(polygon, size, 4.0 * ROUNDING, |row, from, to| {
            if self.touched.contains(&row) {
                self.border[row].push([from as u32, to as u32]);
            }
        });
    }

    /// Merges all rows into a buffer: in each row the depths of the facets, without the bands of
    /// the border, where they are nearer.
    pub(super) fn merge_into(&mut self, nearest: &mut [f32], size: usize) {
        for row in std::mem::replace(&mut self.touched, 0..0) {
            let runs = &mut self.runs[row];
            let first = runs.iter().map(|run| run.from as usize).min().unwrap_or(size);
            let last = runs.iter().map(|run| run.to as usize).max().unwrap_or(0);
            for ElementRun { from, to, plane } in runs.drain(..) {
                let inverse = self.planes[plane as usize].row(row, size);
                let columns = from as usize..=to as usize;
                for (column, depth) in columns.clone().zip(&mut self.depths[columns]) {
                    *depth = depth.max(inverse.most(column));
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
