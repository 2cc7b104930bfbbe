//! Every margin of length, derived from one quantum.
//!
//! Geometry passes through rounding at four scales, and each scale has margins of its own:
//!
//! | scale | what rounds | margins |
//! | --- | --- | --- |
//! | below a quantum | sums and cuts in double precision | [`SLIVER_M`] to [`ON_PLANE_F64_M`] |
//! | a few quanta | corners in single precision | [`ON_PLANE_F32_M`] to [`CLOSED_M`] |
//! | ten quanta and more | chains of operations in single precision | [`TOUCH_M`] to [`RAY_LIFT_M`] |
//! | two millimetres and more | poses on the wire, bodies | [`WIRE_BOUNDARY_M`] to [`ASTRAY_M`] |
//!
//! Numbers in single precision are 2⁻²³ of the next lower power of two apart: 7.6e-6 m from 64 m,
//! 1.5e-5 m from 128 m, 6.1e-5 m from 512 m to 1,024 m. Rounding moves a coordinate by half of
//! that.
//!
//! A margin in single precision has the type `f32`, one in double precision `f64`.

/// The quantum: a hundredth of a millimetre. It exceeds the 7.6e-6 m by which rounding to single
/// precision moves a coordinate up to 256 m from the origin.
pub const QUANTUM_M: f64 = quanta(1);

const QUANTA_PER_METRE: f64 = 100_000.0;

/// A multiple of the quantum. The division is exact but for its last bit, so that `quanta(20)` is
/// the number nearest to 0.0002, which `20.0 * QUANTUM_M` need not be.
const fn quanta(count: u32) -> f64 {
    count as f64 / QUANTA_PER_METRE
}

/// A fraction of the quantum.
const fn quantum_divided_by(parts: u32) -> f64 {
    1.0 / (QUANTA_PER_METRE * parts as f64)
}

// Double precision. Near 1 km the spacing is 1.1e-13 m; intersections lose some digits more.

/// Whatever is thinner is left over by cuts in double precision, and is nothing. It is thousands of
/// times the spacing at 1 km, and thousands of times below what single precision can store.
pub const SLIVER_M: f64 = quantum_divided_by(10_000);
/// The squared length below which a segment is a point, in square metres: a micrometre, which is
/// below the spacing of single precision for all but points near the origin.
pub const POINT_M2: f32 = 1e-12;
/// A volume that is thinner is degenerate; boxes that are closer have no separating planes worth
/// finding, since rounding alone would define these.
pub const DEGENERATE_M: f64 = quantum_divided_by(100);
/// A point that was computed in double precision lies on a plane when it is this close. A line
/// also has to cross a convex body for longer than this to be blocked by it.
pub const ON_PLANE_F64_M: f64 = quantum_divided_by(10);

// Coordinates that were stored once in single precision.

/// A corner that was stored in single precision lies on its plane when it is this close.
pub const ON_PLANE_F32_M: f64 = QUANTUM_M;
/// Boxes swept in double precision grow by this before they are rounded to single precision; far
/// from the origin they grow by [`SWEPT_SHARE`] of their coordinates too.
pub const SWEPT_M: f64 = QUANTUM_M;
/// Rounding moves a coordinate by at most 2⁻²⁴ of it, 6e-8; this is more than three times as much.
pub const SWEPT_SHARE: f64 = 2e-7;
/// A Quake map's brushes grow by this before lines are tested against them, so that lines along the
/// seam of two brushes do not slip through.
pub const BRUSH_GROWTH_M: f64 = QUANTUM_M;
/// Corners that are no farther apart are one point: both ends of a distance may be rounded. Farther
/// than 84 m from the origin, the compiler welds within two units in the last place instead.
pub const WELD_M: f64 = quanta(2);
/// Triangles lie in one plane when each corner is this close to it.
pub const COPLANAR_M: f64 = WELD_M;
/// A free sight line must be free at this distance beside it too: a ray that slips along the common
/// edge of two triangles, by rounding alone, is not a sight line.
pub const BESIDE_RAY_M: f32 = WELD_M as f32;
/// Axial planes that are no farther apart are one plane. A quarter turn of a node adds one more
/// rounding to the two that [`WELD_M`] covers.
pub const AXIAL_PLANE_M: f64 = quanta(3);
/// Sums and differences of a few coordinates in single precision lose less: four roundings.
pub const SUM_F32_M: f32 = quanta(4) as f32;
/// Gaps that are narrower count as closed. Where two walls meet, each has up to two rounded
/// corners.
pub const CLOSED_M: f64 = quanta(5);

// Chains of operations in single precision, and what several programs rounded in turn.

/// Boxes that overlap by no more only touch.
pub const TOUCH_M: f32 = quanta(10) as f32;
/// A box reaches a slanted plane when it is this close. It covers the rounding of the box itself,
/// 6.1e-5 m within a kilometre.
pub const SLANTED_PLANE_M: f64 = quanta(10);
/// Boxes in a search tree grow by this, so that no test of a line against them fails by rounding.
pub const TREE_MARGIN_M: f32 = quanta(10) as f32;
/// A sampled eye is this far from every brush. No real eye is closer to a wall, and rounding moves
/// points and planes by far less.
pub const EYE_CLEARANCE_M: f64 = quanta(10);
/// A line that is inside a grown brush for no longer than this merely grazes it. At a right angle
/// the growth itself accounts for two quanta; at a flat one for some more.
pub const GRAZE_M: f64 = quanta(10);
/// Portals and sources of sight grow by this on each side. It exceeds the sum of what importers,
/// the compiler ([`CLOSED_M`]) and single precision (6.1e-5 m within a kilometre) move a surface
/// by.
pub const WIDENING_M: f64 = quanta(20);
/// [`WIDENING_M`] for gates in single precision.
pub const GATE_WIDENING_M: f32 = WIDENING_M as f32;
/// Occluders shrink by this on each side, by the argument of [`WIDENING_M`]: a line that slips
/// along an edge counts as free.
pub const OCCLUDER_INSET_M: f64 = WIDENING_M;
/// A point this close to a room's boundary may be on either side of it. Single precision loses less
/// within two kilometres.
pub const ROOM_BOUNDARY_M: f32 = WIDENING_M as f32;
/// A point clamped to turned bounds ends this far inside. Two rotations in single precision move it
/// by less within several kilometres.
pub const INWARD_M: f32 = quanta(100) as f32;
/// Bounds of brushes grow by this: corners are intersections of three planes, which lose digits
/// where the planes are nearly parallel.
pub const BRUSH_CORNER_M: f32 = quanta(100) as f32;
/// This close to a plane, single precision does not tell on which side a point is.
pub const UNSURE_SIDE_M: f32 = quanta(100) as f32;
/// Cells whose boxes share no more than this do not overlap.
pub const CELL_OVERLAP_M: f64 = quanta(100);
/// Corners in an author's file that are closer are one point: editors write millimetres.
pub const AUTHORED_POINT_M: f32 = quanta(100) as f32;
/// Rectangles of a surface occluder grow from a seed with this half width: well above [`CLOSED_M`],
/// and far below the smallest occluder.
pub const SEED_M: f64 = quanta(100);
/// Nothing closer to an eye is projected by the fuzzy buffer: no wall is so close to an eye.
pub const NEAR_PLANE_M: f64 = quanta(100);
/// The fuzzy buffer hides only what is farther than this behind a patch: surfaces touch the objects
/// that they belong to.
pub const BEHIND_M: f64 = quanta(100);
/// Light rays begin this far off the surface, beyond all rounding of the surface itself.
pub const RAY_LIFT_M: f32 = quanta(200) as f32;

// The wire and moving bodies.

/// Positions on the wire are multiples of this share of a metre.
pub const WIRE_UNITS_PER_METRE: f32 = 512.0;
/// The step of positions on the wire, in metres: about two millimetres.
pub const WIRE_UNIT_M: f32 = 1.0 / WIRE_UNITS_PER_METRE;
/// A reported eye may be this far on the other side of a boundary. Rounding on the wire moves it by
/// half a unit on each axis; this is two units.
pub const WIRE_BOUNDARY_M: f32 = quanta(400) as f32;
/// A reported eye may differ by this from where its motion puts it: rounding on the wire of both
/// ends, and of the velocity for the time in between.
pub const WIRE_POSE_M: f32 = quanta(1_000) as f32;
/// A surface belongs to a solid if there is one this far from it: well beyond all rounding, and
/// within the thinnest wall.
pub const BESIDE_SURFACE_M: f64 = quanta(1_000);
/// A movement budget begins with this much: [`WIRE_POSE_M`] at both ends of a movement.
pub const BUDGET_ROUNDING_M: f64 = quanta(2_000);
/// Walks around walls may be longer by this than the movement budget: each corner on the way adds
/// rounding of its own.
pub const WALK_SPARE_M: f64 = quanta(5_000);
/// An avatar that begins this close to a spawn point begins at it.
pub const AT_SPAWN_M: f32 = quanta(5_000) as f32;
/// Rooms may overlap by this, and corners of windows lie off their planes: authors measure by hand.
pub const AUTHORED_M: f32 = quanta(5_000) as f32;
/// A body may reach this far into a solid: clients collide against voxels, which stand off the
/// surface by up to one edge (5 cm by default), and [`WIRE_POSE_M`] comes on top.
pub const POKE_M: f32 = quanta(6_000) as f32;
/// An eye in a solid belongs to a cell that is no farther away: bodies are pressed against walls,
/// and those are thicker than [`POKE_M`].
pub const ASTRAY_M: f32 = quanta(25_000) as f32;

// Unit vectors.

/// The squared length of a unit vector in double precision differs from one by less.
pub const UNIT_F64: f64 = 1e-6;
/// The squared length of a unit vector in a file of single-precision numbers differs from one by
/// less: exporters round to three and more digits.
pub const UNIT_F32: f64 = 1e-3;

/// Each scale must swallow what the finer ones leave. A change that breaks this does not compile.
const _: () = {
    assert!(POINT_M2 as f64 <= ON_PLANE_F64_M * ON_PLANE_F64_M * (1.0 + f32::EPSILON as f64));
    assert!(SLIVER_M < DEGENERATE_M && DEGENERATE_M < ON_PLANE_F64_M);
    assert!(ON_PLANE_F64_M < ON_PLANE_F32_M && ON_PLANE_F32_M <= QUANTUM_M);
    // Half the spacing of single precision at 256 m, and the spacing itself at 1 km.
    let (half_at_256_m, at_1_km) = (256.0 * f32::EPSILON / 4.0, 512.0 * f32::EPSILON);
    assert!(QUANTUM_M > half_at_256_m as f64);
    assert!(WELD_M >= 2.0 * ON_PLANE_F32_M && WELD_M < AXIAL_PLANE_M);
    assert!(AXIAL_PLANE_M < CLOSED_M && (SUM_F32_M as f64) < CLOSED_M);
    assert!(SWEPT_SHARE > f32::EPSILON as f64);
    assert!(SLANTED_PLANE_M > at_1_km as f64 && TREE_MARGIN_M > at_1_km);
    assert!(GRAZE_M > 2.0 * BRUSH_GROWTH_M);
    assert!(WIDENING_M > CLOSED_M + at_1_km as f64 && WIDENING_M > TOUCH_M as f64);
    assert!(GATE_WIDENING_M as f64 >= WIDENING_M * (1.0 - f32::EPSILON as f64));
    assert!(INWARD_M > GATE_WIDENING_M && BEHIND_M > WIDENING_M && SEED_M > CLOSED_M);
    assert!(RAY_LIFT_M > INWARD_M);
    assert!(WIRE_BOUNDARY_M > 2.0 * WIRE_UNIT_M && WIRE_POSE_M > WIRE_BOUNDARY_M);
    assert!(BUDGET_ROUNDING_M > WIRE_POSE_M as f64 && WALK_SPARE_M > BUDGET_ROUNDING_M);
    assert!(AT_SPAWN_M > WIRE_POSE_M && POKE_M > WIRE_POSE_M && ASTRAY_M > POKE_M);
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_are_the_nearest_numbers_to_their_decimals() {
        let double = [
            (SLIVER_M, 1e-9),
            (DEGENERATE_M, 1e-7),
            (ON_PLANE_F64_M, 1e-6),
            (QUANTUM_M, 1e-5),
            (WELD_M, 2e-5),
            (AXIAL_PLANE_M, 3e-5),
            (CLOSED_M, 5e-5),
            (SLANTED_PLANE_M, 1e-4),
            (WIDENING_M, 2e-4),
            (SEED_M, 1e-3),
            (BESIDE_SURFACE_M, 0.01),
            (BUDGET_ROUNDING_M, 0.02),
            (WALK_SPARE_M, 0.05),
        ];
        for (margin, decimal) in double {
            assert_eq!(margin.to_bits(), f64::to_bits(decimal), "{decimal}");
        }
        let single = [
            (SLIVER_M as f32, 1e-9),
            (DEGENERATE_M as f32, 1e-7),
            (BESIDE_RAY_M, 2e-5),
            (SUM_F32_M, 4e-5),
            (TOUCH_M, 1e-4),
            (GATE_WIDENING_M, 2e-4),
            (INWARD_M, 1e-3),
            (RAY_LIFT_M, 2e-3),
            (WIRE_BOUNDARY_M, 0.004),
            (WIRE_POSE_M, 0.01),
            (AT_SPAWN_M, 0.05),
            (POKE_M, 0.06),
            (ASTRAY_M, 0.25),
        ];
        for (margin, decimal) in single {
            assert_eq!(margin.to_bits(), f32::to_bits(decimal), "{decimal}");
        }
    }
}
