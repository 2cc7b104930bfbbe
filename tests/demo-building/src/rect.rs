//! Rectangles of the floor plan, and their subdivision along shared coordinates.

/// A rectangle of the floor plan, in lattice units. Index 0 is x, index 1 is z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LatticeRect {
    /// The corner with the least coordinates.
    pub min: [i32; 2],
    /// The corner with the greatest coordinates.
    pub max: [i32; 2],
}

impl LatticeRect {
    pub(super) const fn new(min: [i32; 2], max: [i32; 2]) -> Self {
        Self { min, max }
    }

    /// The rectangle with these extents along `axis` and along the other axis.
    pub(super) fn spanning(axis: usize, along: [i32; 2], across: [i32; 2]) -> Self {
        let mut rect = Self::new([across[0]; 2], [across[1]; 2]);
        (rect.min[axis], rect.max[axis]) = (along[0], along[1]);
        rect
    }

    /// The extent along an axis.
    pub(super) fn span(&self, axis: usize) -> [i32; 2] {
        [self.min[axis], self.max[axis]]
    }

    /// The width along an axis.
    pub(super) fn size(&self, axis: usize) -> i32 {
        self.max[axis] - self.min[axis]
    }

    /// The rectangle with another extent along an axis.
    pub(super) fn with_span(mut self, axis: usize, span: [i32; 2]) -> Self {
        (self.min[axis], self.max[axis]) = (span[0], span[1]);
        self
    }

    pub(super) fn grown(self, margin: i32) -> Self {
        Self { min: self.min.map(|v| v - margin), max: self.max.map(|v| v + margin) }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.min[0] >= self.max[0] || self.min[1] >= self.max[1]
    }

    /// Whether two rectangles share more than a boundary.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.min[axis] < other.max[axis] && other.min[axis] < self.max[axis])
    }

    pub(super) fn contains(&self, point: [i32; 2]) -> bool {
        (0..2).all(|axis| self.min[axis] <= point[axis] && point[axis] < self.max[axis])
    }

    /// The middle, rounded down to the lattice.
    pub fn centre(&self) -> [i32; 2] {
        [0, 1].map(|axis| (self.min[axis] + self.max[axis]).div_euclid(2))
    }
}

/// A plan cut along every coordinate in it, so that each patch has one value.
pub(super) struct Patches<T> {
    /// The cutting coordinates along x and z, ascending.
    pub cuts: [Vec<i32>; 2],
    values: Vec<T>,
}

impl<T: Copy> Patches<T> {
    /// Paints rectangles over each other, in order, on a background of `outside`. A margin of one
    /// patch of `outside` surrounds them.
    pub fn paint(layers: &[(LatticeRect, T)], outside: T) -> Self {
        let cuts = [0, 1].map(|axis| {
            let mut cuts: Vec<i32> = layers.iter().flat_map(|(rect, _)| rect.span(axis)).collect();
            let (least, greatest) = (cuts.iter().min().copied(), cuts.iter().max().copied());
            cuts.extend(least.map(|v| v - 1).into_iter().chain(greatest.map(|v| v + 1)));
            cuts.sort_unstable();
            cuts.dedup();
            cuts
        });
        let mut patches = Self { values: vec![outside; count(&cuts[0]) * count(&cuts[1])], cuts };
        for (rect, value) in layers {
            patches.fill(rect, *value);
        }
        patches
    }

    fn fill(&mut self, rect: &LatticeRect, value: T) {
        if rect.is_empty() {
            return;
        }
        let [xs, zs] = [0, 1].map(|axis| {
            let find = |v: i32| self.cuts[axis].partition_point(|&cut| cut < v);
            find(rect.min[axis])..find(rect.max[axis])
        });
        let width = self.count(0);
        for z in zs {
            self.values[z * width + xs.start..z * width + xs.end].fill(value);
        }
    }

    /// The number of patches along an axis.
    pub fn count(&self, axis: usize) -> usize {
        count(&self.cuts[axis])
    }

    pub fn at(&self, x: usize, z: usize) -> T {
        self.values[z * self.count(0) + x]
    }
}

fn count(cuts: &[i32]) -> usize {
    cuts.len().saturating_sub(1)
}

/// Covers the labelled squares of a grid with few rectangles of one label each. Gives ranges as
/// `[column, row]`.
pub(super) fn merge<L: PartialEq + Copy>(
    columns: usize,
    rows: usize,
    label: impl Fn(usize, usize) -> Option<L>,
) -> Vec<([usize; 2], [usize; 2], L)> {
    let mut left: Vec<Option<L>> = (0..rows)
        .flat_map(|r| (0..columns).map(move |c| (c, r)))
        .map(|(c, r)| label(c, r))
        .collect();
    let mut merged = Vec::new();
    for row in 0..rows {
        let mut column = 0;
        while column < columns {
            let Some(value) = left[row * columns + column] else {
                column += 1;
                continue;
            };
            let alike = |l: &Option<L>| *l == Some(value);
            let end = column
                + left[row * columns + column..(row + 1) * columns]
                    .iter()
                    .take_while(|l| alike(l))
                    .count();
            let mut bottom = row + 1;
            while bottom < rows
                && left[bottom * columns + column..bottom * columns + end].iter().all(alike)
            {
                bottom += 1;
            }
            for r in row..bottom {
                left[r * columns + column..r * columns + end].fill(None);
            }
            merged.push(([column, row], [end, bottom], value));
            column = end;
        }
    }
    merged
}
