//! Convex occluders, and the lines that meet one.

use glam::{DVec3, Vec3};
use sightline_world::{geometry::Aabb, tolerance::OCCLUDER_INSET_M};

use crate::HalfSpace;

/// A convex piece of what blocks sight, in own axes.
#[derive(Clone, Debug)]
pub(super) enum ConvexOccluder {
    /// An axis-aligned box, which may be flat.
    Box(Aabb),
    /// The intersection of some half-spaces.
    Behind {
        /// A box around the intersection.
        bounds: Aabb,
        /// The half-spaces.
        sides: Box<[HalfSpace]>,
    },
}

/// The line between two boxes that misses an occluder by most.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// By what share of its length the line has left the occluder on one side before it enters it
    /// on another. Smaller is better.
    pub by: f64,
    /// The corners that the line joins, one of each box, as numbers in [`Aabb::corners`].
    pub corners: [usize; 2],
    /// A bit for each axis along which narrower boxes would narrow the gap.
    pub axes: usize,
}

impl ConvexOccluder {
    /// A solid box, set back.
    pub fn solid(region: &Aabb) -> Self {
        let inset = inset(region);
        Self::Box(Aabb::new(region.min + inset, region.max - inset))
    }

    /// A flat convex polygon, set back, with its corners in order. None if it has no area.
    pub fn flat(corners: &[DVec3]) -> Option<Self> {
        let [a, b, c, ..] = *corners else { return None };
        let normal = (b - a).cross(c - a).try_normalize()?;
        let bounds = Aabb::from_points(corners.iter().map(|corner| corner.as_vec3()));
        if let Some(axis) = (0..3).find(|&axis| bounds.min[axis] == bounds.max[axis])
            && corners.len() == 4
        {
            let mut inset = inset(&bounds);
            inset[axis] = 0.0;
            return Some(Self::Box(Aabb::new(bounds.min + inset, bounds.max - inset)));
        }
        let distance = normal.dot(corners.iter().sum::<DVec3>() / corners.len() as f64);
        // The intersection of these two is the polygon's plane.
        let mut sides = vec![
            HalfSpace { normal, distance },
            HalfSpace { normal: -normal, distance: -distance },
        ];
        for (i, from) in corners.iter().enumerate() {
            let along = corners[(i + 1) % corners.len()] - from;
            let outwards = along.cross(normal).try_normalize()?;
            sides.push(set_back(HalfSpace { normal: outwards, distance: outwards.dot(*from) }));
        }
        Some(Self::Behind {
            bounds: bounds.grown(inset(&bounds).max_element()),
            sides: sides.into(),
        })
    }

    /// A solid intersection of half-spaces, set back, which lies in the given box.
    pub fn behind(bounds: Aabb, sides: Vec<HalfSpace>) -> Self {
        assert!(!sides.is_empty(), "a solid has sides");
        Self::Behind { bounds, sides: sides.into_iter().map(set_back).collect() }
    }

    /// A box around the occluder.
    pub fn bounds(&self) -> &Aabb {
        match self {
            Self::Box(bounds) | Self::Behind { bounds, .. } => bounds,
        }
    }

    /// Memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        let sides = match self {
            Self::Box(_) => 0,
            Self::Behind { sides, .. } => sides.len(),
        };
        size_of::<Self>() + sides * size_of::<HalfSpace>()
    }

    /// The middle of the part of a line that is inside, as a share of its length from 0 to 1. None
    /// if the line misses the occluder.
    pub fn meets(&self, from: Vec3, to: Vec3) -> Option<f64> {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        let mut cut = |(low, high): (f64, f64)| (enter, leave) = (enter.max(low), leave.min(high));
        match self {
            Self::Box(bounds) => {
                (0..3).for_each(|axis| cut(inside(bounds, axis, from[axis], to[axis])));
            }
            Self::Behind { sides, .. } => {
                let (from, to) = (from.as_dvec3(), to.as_dvec3());
                sides.iter().for_each(|side| cut(behind(side.height(from), side.height(to))));
            }
        }
        (enter <= leave).then_some((enter + leave) * 0.5)
    }

    /// Whether every line from one box to another meets the occluder.
    ///
    /// # Errors
    /// The line from corner to corner that misses the occluder by most.
    pub fn blocks_all(&self, from: &Aabb, to: &Aabb) -> Result<(), Gap> {
        match self {
            Self::Box(bounds) => box_blocks_all(bounds, from, to),
            Self::Behind { sides, .. } => sides_block_all(sides, from, to),
        }
    }
}

/// How far the faces of a box are set back, in metres. Far from the origin, single precision moves
/// faces by more than the margin. A thin box becomes flat.
fn inset(region: &Aabb) -> Vec3 {
    let scale = region.min.abs().max(region.max.abs()).max_element();
    Vec3::splat(OCCLUDER_INSET_M as f32 + scale * f32::EPSILON).min(region.size() * 0.5)
}

fn set_back(side: HalfSpace) -> HalfSpace {
    debug_assert!((side.normal.length() - 1.0).abs() < 1e-6, "normals have unit length");
    side.moved(-OCCLUDER_INSET_M)
}

/// Whether a box meets all 64 lines from corner to corner. The three coordinates of a line are
/// independent, and three intervals share a point if each two of them do. So twelve intervals are
/// enough.
fn box_blocks_all(bounds: &Aabb, from: &Aabb, to: &Aabb) -> Result<(), Gap> {
    // Along each axis the last entry and the first exit, and the line that has it: a bit for each
    // end says which side of the box the line joins.
    let (mut enters, mut leaves) = ([(f64::NEG_INFINITY, 0); 3], [(f64::INFINITY, 0); 3]);
    for axis in 0..3 {
        for ends in 0..4 {
            let begin = [from.min, from.max][ends & 1][axis];
            let end = [to.min, to.max][ends >> 1][axis];
            let (low, high) = inside(bounds, axis, begin, end);
            if low > enters[axis].0 {
                enters[axis] = (low, ends);
            }
            if high < leaves[axis].0 {
                leaves[axis] = (high, ends);
            }
        }
    }
    let mut gap = Gap { by: 0.0, corners: [0; 2], axes: 0 };
    let mut widen = |by: f64, ends: [(usize, usize); 2]| {
        if by > gap.by {
            let corner = |shift: usize| {
                ends.iter().fold(0, |bits, (axis, ends)| bits | (ends >> shift & 1) << axis)
            };
            let axes = 1 << ends[0].0 | 1 << ends[1].0;
            gap = Gap { by, corners: [corner(0), corner(1)], axes };
        }
    };
    for a in 0..3 {
        let ((enter, last), (leave, first)) = (enters[a], leaves[a]);
        widen(enter - 1.0, [(a, last); 2]);
        widen(-leave, [(a, first); 2]);
        for b in (0..3).filter(|&b| b != a) {
            widen(enter - leaves[b].0, [(a, last), (b, leaves[b].1)]);
        }
    }
    if gap.by > 0.0 { Err(gap) } else { Ok(()) }
}

/// Whether an intersection of half-spaces meets all 64 lines from corner to corner, line by line.
fn sides_block_all(sides: &[HalfSpace], from: &Aabb, to: &Aabb) -> Result<(), Gap> {
    let corners = [from, to].map(|region| region.corners().map(|corner| corner.as_dvec3()));
    let (mut enters, mut leaves) = ([0.0f64; 64], [1.0f64; 64]);
    for side in sides {
        let [begins, ends] = corners.map(|corners| corners.map(|corner| side.height(corner)));
        for line in 0..64 {
            let (low, high) = behind(begins[line & 7], ends[line >> 3]);
            enters[line] = enters[line].max(low);
            leaves[line] = leaves[line].min(high);
        }
    }
    let mut gap = Gap { by: 0.0, corners: [0; 2], axes: 0 };
    for line in 0..64 {
        let by = enters[line] - leaves[line];
        if by > gap.by {
            gap = Gap { by, corners: [line & 7, line >> 3], axes: 7 };
        }
    }
    if gap.by > 0.0 { Err(gap) } else { Ok(()) }
}

/// The part of a line that is between the two faces of a box across an axis, as shares of its
/// length. A line in the plane of a flat box is never inside.
fn inside(bounds: &Aabb, axis: usize, from: f32, to: f32) -> (f64, f64) {
    let (min, max) = (f64::from(bounds.min[axis]), f64::from(bounds.max[axis]));
    let (from, to) = (f64::from(from), f64::from(to));
    let along = to - from;
    if along == 0.0 {
        let is_inside = min <= from && from <= max && min < max;
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        return if is_inside { all } else { (all.1, all.0) };
    }
    let (a, b) = ((min - from) / along, (max - from) / along);
    (a.min(b), a.max(b))
}

/// The part of a line that is in a half-space, as shares of its length. Given are the heights of
/// its ends.
fn behind(from: f64, to: f64) -> (f64, f64) {
    match (from > 0.0, to > 0.0) {
        (true, true) => (f64::INFINITY, f64::NEG_INFINITY),
        (true, false) => (from / (from - to), f64::INFINITY),
        (false, true) => (f64::NEG_INFINITY, from / (from - to)),
        (false, false) => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

/// The corner of a box with a number from 0 to 7, as in [`Aabb::corners`].
pub(super) fn corner(region: &Aabb, bits: usize) -> Vec3 {
    debug_assert!(bits < 8, "a box has eight corners");
    let pick = |axis: usize| [region.min, region.max][bits >> axis & 1][axis];
    Vec3::new(pick(0), pick(1), pick(2))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;

    fn point(rng: &mut SmallRng, within: &Aabb) -> Vec3 {
        within.min + within.size() * Vec3::new(rng.random(), rng.random(), rng.random())
    }

    fn region(rng: &mut SmallRng, centre: Vec3, widest: f32) -> Aabb {
        let half = Vec3::new(rng.random(), rng.random(), rng.random()) * widest * 0.5;
        let centre = centre + Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0;
        Aabb::new(centre - half, centre + half)
    }

    /// A box as the intersection of six half-spaces.
    fn as_planes(bounds: &Aabb) -> ConvexOccluder {
        let sides = (0..3).flat_map(|axis| {
            let normal = DVec3::AXES[axis];
            let [min, max] = [bounds.min[axis], bounds.max[axis]].map(f64::from);
            [HalfSpace { normal, distance: max }, HalfSpace { normal: -normal, distance: -min }]
        });
        ConvexOccluder::Behind { bounds: *bounds, sides: sides.collect() }
    }

    #[test]
    fn no_line_is_free_between_blocked_boxes_and_the_reported_line_is_free() {
        let mut rng = SmallRng::seed_from_u64(1);
        let (mut blocked, mut open) = (0, 0);
        for _ in 0..20_000 {
            let from = region(&mut rng, Vec3::new(-4.0, 0.0, 0.0), 2.0);
            let to = region(&mut rng, Vec3::new(4.0, 0.0, 0.0), 2.0);
            let mut bounds = region(&mut rng, Vec3::ZERO, 8.0);
            if rng.random_bool(0.3) {
                let axis = rng.random_range(0..3);
                bounds.max[axis] = bounds.min[axis];
            }
            let convex = ConvexOccluder::Box(bounds);
            let answer = convex.blocks_all(&from, &to);
            let other = as_planes(&bounds).blocks_all(&from, &to);
            assert_eq!(answer.is_ok(), other.is_ok(), "{bounds:?} {from:?} {to:?}");
            match answer {
                Ok(()) => {
                    blocked += 1;
                    for _ in 0..50 {
                        let (from, to) = (point(&mut rng, &from), point(&mut rng, &to));
                        assert!(convex.meets(from, to).is_some(), "{bounds:?} {from} {to}");
                    }
                }
                Err(gap) => {
                    open += 1;
                    for gap in [gap, other.unwrap_err()] {
                        let [a, b] = gap.corners;
                        let line = (corner(&from, a), corner(&to, b));
                        assert!(convex.meets(line.0, line.1).is_none(), "{bounds:?} {line:?}");
                    }
                }
            }
        }
        assert!(blocked > 500 && open > 500, "{blocked} {open}");
    }

    #[test]
    fn flat_occluders_block_only_inside_their_edges() {
        let corners = [(-1.0, 0.0), (0.0, -1.0), (1.0, 0.0), (0.0, 1.0)];
        let turned =
            ConvexOccluder::flat(&corners.map(|(y, z)| DVec3::new(0.3 * y, y, z))).unwrap();
        let meets = |y: f32, z: f32| turned.meets(Vec3::new(9.0, y, z), Vec3::new(-9.0, y, z));
        assert!((meets(0.0, 0.0).unwrap() - 0.5).abs() < 1e-6);
        assert!(meets(0.49, 0.5).is_some() && meets(0.51, 0.5).is_none());
        assert!(meets(0.4999, 0.5).is_none(), "edges are set back");
        assert!(turned.meets(Vec3::new(9.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0)).is_none());
        let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)];
        let upright = ConvexOccluder::flat(&corners.map(|(y, z)| DVec3::new(2.0, y, z))).unwrap();
        assert!(matches!(upright, ConvexOccluder::Box(_)));
        assert!(upright.meets(Vec3::new(0.0, 0.5, 0.5), Vec3::new(3.0, 0.9, 0.5)).is_some());
        assert!(upright.meets(Vec3::new(2.0, -1.0, 0.5), Vec3::new(2.0, 2.0, 0.5)).is_none());
        assert!(ConvexOccluder::flat(&[DVec3::ZERO; 4]).is_none());
    }
}
