//! The occluders of an octree: rectangles of opaque voxels without a gap.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use sightline_visibility::fuzzy::{SurfaceError, Surfaces};
use sightline_world::octree::{Cursor, Octree};

/// Rectangles are made of squares that are at least this wide, in metres, and at least two voxels.
const SQUARE_M: f32 = 0.06;
/// Squares are at most two to the power of this many voxels wide.
const SQUARE_LEVELS_MAX: u8 = 4;
/// Narrower rectangles, in metres, are left out: they hide almost nothing.
const NARROW_M: f32 = 0.25;

/// A layer of voxels: the axis across it, and the number of voxels before it.
type LayerKey = (usize, u32);
/// A rectangle of squares, by its least corner and the corner beyond its greatest square.
type Rectangle = [[u32; 2]; 2];

/// The squares of opaque voxels in each layer.
struct Squares {
    layers: BTreeMap<LayerKey, BTreeSet<[u32; 2]>>,
    /// Squares are two to the power of this many voxels wide.
    levels: u8,
    /// The first material that is glass.
    glass_from: usize,
}

/// The occluders of an octree, as surfaces through the middles of opaque voxels. A line that meets
/// a surface meets the voxel around that place.
pub(super) fn find(octree: &Octree) -> Result<Surfaces, SurfaceError> {
    let levels = (SQUARE_M / octree.voxel()).log2().ceil().max(1.0) as u8;
    let levels = levels.min(SQUARE_LEVELS_MAX).min(octree.depth);
    let mut squares = Squares { layers: BTreeMap::new(), levels, glass_from: octree.first_glass() };
    let square = octree.voxel() * (1u32 << levels) as f32;
    let narrow = ((NARROW_M / square).ceil() as u32).max(1);
    if let Some(root) = octree.root() {
        squares.collect(root, [0; 3], octree.depth - levels);
    }
    let mut mesh = SurfaceMesh::default();
    for (&(axis, layer), places) in &squares.layers {
        let rectangles: Vec<Rectangle> = rectangles(places)
            .into_iter()
            .filter(|[min, max]| (0..2).all(|side| max[side] - min[side] >= narrow))
            .collect();
        let across = octree.origin[axis] + (layer as f32 + 0.5) * octree.voxel();
        mesh.add(&rectangles, |[u, v]: [u32; 2]| {
            let mut corner = Vec3::splat(across);
            corner[(axis + 1) % 3] = octree.origin[(axis + 1) % 3] + u as f32 * square;
            corner[(axis + 2) % 3] = octree.origin[(axis + 2) % 3] + v as f32 * square;
            corner
        });
    }
    Surfaces::new(&mesh.corners, &mesh.patches)
}

impl Squares {
    /// Collects whole layers of opaque voxels from the nodes of a level that are below a node. The
    /// node's place is counted in nodes of its own size.
    fn collect(&mut self, node: Cursor<'_>, at: [u32; 3], level: u8) {
        if node.level() < level {
            for (octant, child) in node.children() {
                let at = [0, 1, 2].map(|axis| 2 * at[axis] + u32::from(octant >> axis & 1));
                self.collect(child, at, level);
            }
            return;
        }
        assert!(self.levels <= SQUARE_LEVELS_MAX, "{} levels", self.levels);
        let mut counts = [[0u32; 1 << SQUARE_LEVELS_MAX]; 3];
        count(node, [0; 3], self.glass_from, &mut counts);
        let width = 1u32 << self.levels;
        for (axis, counts) in counts.iter().enumerate() {
            for (before, _) in counts.iter().enumerate().filter(|(_, n)| **n == width * width) {
                let layer = (axis, at[axis] * width + before as u32);
                let place = [at[(axis + 1) % 3], at[(axis + 2) % 3]];
                self.layers.entry(layer).or_default().insert(place);
            }
        }
    }
}

/// Counts the opaque voxels below a node, for each layer across each axis.
fn count(node: Cursor<'_>, at: [usize; 3], glass: usize, counts: &mut [[u32; 16]; 3]) {
    if node.is_leaf() {
        if usize::from(node.material_index()) < glass {
            counts.iter_mut().zip(at).for_each(|(counts, at)| counts[at] += 1);
        }
        return;
    }
    for (octant, child) in node.children() {
        let at = [0, 1, 2].map(|axis| 2 * at[axis] + usize::from(octant >> axis & 1));
        count(child, at, glass, counts);
    }
}

/// Rectangles that cover each of some squares once: runs of squares, joined with equal runs in the
/// rows that follow.
fn rectangles(places: &BTreeSet<[u32; 2]>) -> Vec<Rectangle> {
    let mut done: Vec<Rectangle> = Vec::new();
    // The first row of each open rectangle, by where its run begins and ends.
    let mut open: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut row_before = None;
    let mut runs: Vec<(u32, [u32; 2])> = Vec::new();
    for &[row, at] in places {
        match runs.last_mut() {
            Some((of, [_, end])) if *of == row && *end == at => *end += 1,
            _ => runs.push((row, [at, at + 1])),
        }
    }
    for of_row in runs.chunk_by(|one, other| one.0 == other.0) {
        let row = of_row[0].0;
        let close = |[from, to]: [u32; 2], first: u32, last: u32| [[first, from], [last, to]];
        let before = std::mem::take(&mut open);
        let follows = row_before.is_some_and(|before: u32| before + 1 == row);
        for (span, first) in before {
            if follows && of_row.iter().any(|(_, run)| *run == span) {
                open.insert(span, first);
            } else {
                done.push(close(span, first, row_before.map_or(row, |before| before + 1)));
            }
        }
        for (_, run) in of_row {
            open.entry(*run).or_insert(row);
        }
        row_before = Some(row);
    }
    let end = row_before.map_or(0, |row| row + 1);
    done.extend(open.into_iter().map(|([from, to], first)| [[first, from], [end, to]]));
    done
}

/// Surfaces of patches. A patch has a corner wherever another patch has one, so that neighbours
/// share edges.
#[derive(Default)]
struct SurfaceMesh {
    corners: Vec<Vec3>,
    patches: Vec<(u32, Vec<u32>)>,
    surfaces: u32,
}

impl SurfaceMesh {
    /// Adds the rectangles of a layer. Rectangles that touch form one surface.
    fn add(&mut self, rectangles: &[Rectangle], corner: impl Fn([u32; 2]) -> Vec3) {
        let mut lines: [BTreeMap<u32, BTreeSet<u32>>; 2] = Default::default();
        for [min, max] in rectangles {
            for [u, v] in [*min, [max[0], min[1]], *max, [min[0], max[1]]] {
                lines[0].entry(u).or_default().insert(v);
                lines[1].entry(v).or_default().insert(u);
            }
        }
        let mut corners: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let outlines: Vec<Vec<u32>> = rectangles
            .iter()
            .map(|rectangle| {
                let around = outline(rectangle, &lines);
                let number = |place: [u32; 2]| {
                    *corners.entry(place).or_insert_with(|| {
                        self.corners.push(corner(place));
                        self.corners.len() as u32 - 1
                    })
                };
                around.into_iter().map(number).collect()
            })
            .collect();
        let numbers = surfaces(&outlines);
        let first = self.surfaces;
        self.surfaces += numbers.iter().max().map_or(0, |last| last + 1);
        self.patches.extend(numbers.into_iter().map(|number| first + number).zip(outlines));
    }
}

/// The corners on the outline of a rectangle, in order: its own, and those of others on its edges.
/// `lines` has the corners on each line.
fn outline([min, max]: &Rectangle, lines: &[BTreeMap<u32, BTreeSet<u32>>; 2]) -> Vec<[u32; 2]> {
    let on = |axis: usize, line: u32, from: u32, to: u32| {
        lines[axis].get(&line).into_iter().flat_map(move |line| line.range(from..to)).copied()
    };
    let back = |axis: usize, line: u32, from: u32, to: u32| {
        let mut places: Vec<u32> = on(axis, line, to + 1, from + 1).collect();
        places.reverse();
        places
    };
    let mut around: Vec<[u32; 2]> = on(1, min[1], min[0], max[0]).map(|u| [u, min[1]]).collect();
    around.extend(on(0, max[0], min[1], max[1]).map(|v| [max[0], v]));
    around.extend(back(1, max[1], max[0], min[0]).into_iter().map(|u| [u, max[1]]));
    around.extend(back(0, min[0], max[1], min[1]).into_iter().map(|v| [min[0], v]));
    around
}

/// Numbers the surfaces of some outlines, from 0 on: outlines that share corners get the same
/// number.
fn surfaces(outlines: &[Vec<u32>]) -> Vec<u32> {
    let mut of_corner: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (at, outline) in outlines.iter().enumerate() {
        outline.iter().for_each(|corner| of_corner.entry(*corner).or_default().push(at));
    }
    let mut numbers = vec![u32::MAX; outlines.len()];
    let mut next = 0;
    for start in 0..outlines.len() {
        if numbers[start] != u32::MAX {
            continue;
        }
        let mut waiting = vec![start];
        numbers[start] = next;
        while let Some(at) = waiting.pop() {
            for other in outlines[at].iter().flat_map(|corner| &of_corner[corner]) {
                if numbers[*other] == u32::MAX {
                    numbers[*other] = next;
                    waiting.push(*other);
                }
            }
        }
        next += 1;
    }
    numbers
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn rectangles_cover_each_square_once(
            places in prop::collection::btree_set(prop::array::uniform2(0u32..9), 0..70),
        ) {
            let mut covered = Vec::new();
            for [min, max] in rectangles(&places) {
                for u in min[0]..max[0] {
                    covered.extend((min[1]..max[1]).map(|v| [u, v]));
                }
            }
            covered.sort_unstable();
            prop_assert_eq!(covered, places.into_iter().collect::<Vec<_>>());
        }
    }
}
