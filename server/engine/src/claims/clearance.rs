//! Clearance: which gates a body fits through.
//!
//! Window panes, slits, and strips left open over lintels are open to sight and closed to bodies.

use glam::Vec3;
use sightline_world::{Polygon, World, geometry::Aabb, motion::Body, tolerance::WIRE_POSE_M};

use crate::bit_set::BitSet;

/// The step along the ground between eye positions that are tried in a gate, in metres.
const ASIDE_M: f32 = 0.05;
/// The step in height between eye positions that are tried in a gate, in metres.
const UP_M: f32 = 0.2;
/// How far a body moves between two tests of what is in its way, in metres.
const STRIDE_M: f32 = 0.04;
/// The most eye positions that are tried in a gate. Larger gates, of 10 m² and more, count as wide
/// enough.
const POSITIONS_MAX: usize = 1_000;
/// No number of positions is a multiple of this prime, so its multiples visit all of them.
const PRIME: usize = 7_919;

/// The gates that are too narrow for a body.
///
/// A gate is too narrow if at every eye position in it something solid is in the part of the body
/// that is sure to need room: the body, less what is uncertain about it. Other programs may collide
/// with surfaces rather than with voxels, and knees and feet may be on a step. If it is not sure
/// that a gate is too narrow, it counts as wide enough. That is so for slanted gates, and for all
/// gates of Quake maps, whose voxels are of all that is drawn, cobwebs and water included.
///
/// The same gates bound the [regions](crate::regions) and the [ways](super::walkability) of claims,
/// so nobody is believed to be where its region is not. All gates are tested when the engine is
/// made: 30 µs for each in the mean, of which one bit is kept.
#[derive(Clone, Debug, Default)]
pub(crate) struct Clearance {
    /// The part of a body that is free wherever it walked to, about its eye; `None` where voxels
    /// are too coarse to tell.
    free: Option<Aabb>,
    narrow_gates: BitSet,
}

impl Clearance {
    pub(crate) fn new(world: &World) -> Self {
        let margin_m = world.octree.voxel().max(STRIDE_M) + WIRE_POSE_M;
        let sure = sure_part(&world.body, margin_m);
        if sure.is_empty() || world.origin.is_some() {
            return Self::default();
        }
        let mut narrow_gates = BitSet::default();
        for (gate, index) in world.cells.gates.iter().zip(0..) {
            if !may_pass(world, &gate.polygon, &sure) {
                narrow_gates.insert(index);
            }
        }
        let free = standing(&world.body).around(Vec3::ZERO).grown(-WIRE_POSE_M);
        Self { free: Some(free), narrow_gates }
    }

    /// The clearance when just these gates are too narrow.
    #[cfg(test)]
    pub(crate) fn with_narrow_gates(narrow_gates: BitSet) -> Self {
        Self { free: None, narrow_gates }
    }

    /// Whether a body may fit through a gate.
    pub(crate) fn admits_gate(&self, gate: u32) -> bool {
        !self.narrow_gates.contains(gate)
    }

    /// Whether a body has room with its eye at a point of the world. A body without room did not
    /// walk there: the host put it there.
    pub(crate) fn has_room(&self, world: &World, eye: Vec3) -> bool {
        let around = |free: &Aabb| Aabb::new(free.min + eye, free.max + eye);
        !self.free.as_ref().is_some_and(|free| world.octree.solid_in(&around(free)))
    }
}

/// A body without knees and feet, which may be on a step.
fn standing(body: &Body) -> Body {
    Body { below_eye: body.below_eye - body.step_height(), ..*body }
}

/// The part of a body that is sure to be free of voxels wherever it goes, about its eye. It is
/// sure for all eye positions that are represented by one that is tried.
fn sure_part(body: &Body, margin_m: f32) -> Aabb {
    let Aabb { min, max } = standing(body).around(Vec3::ZERO);
    // Gates may be turned against the world's axes, and level ones extend in two directions.
    let aside = 0.5 * ASIDE_M * std::f32::consts::SQRT_2;
    let less = Vec3::new(aside, 0.5 * UP_M, aside) + margin_m;
    Aabb::new(min + less, max - less)
}

fn may_pass(world: &World, polygon: &Polygon, sure: &Aabb) -> bool {
    let Polygon::Rectangle { bounds, .. } = polygon else { return true };
    let size = bounds.size();
    let steps = Vec3::new(ASIDE_M, UP_M, ASIDE_M);
    let counts = (size / steps).ceil().max(Vec3::ONE).as_usizevec3();
    let positions = counts.element_product();
    if positions > POSITIONS_MAX {
        return true;
    }
    let step = size / counts.as_vec3();
    // This order soon visits every part of the gate.
    (0..positions).map(|i| i * PRIME % positions).any(|i| {
        let [x, y] = [i % counts.x, i / counts.x % counts.y];
        let z = i / counts.x / counts.y;
        let own = bounds.min + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * step;
        let eye = world.cells.axes.world(own);
        !world.octree.solid_in(&Aabb::new(sure.min + eye, sure.max + eye))
    })
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use proptest::prelude::*;
    use sightline_world::octree::{Material, Octree, Voxel, morton};

    use super::*;
    use crate::tests::stage;

    const VOXEL_M: f32 = 0.05;
    /// The gate's rectangle, in voxels: z and y.
    const GATE: [u32; 2] = [20, 60];

    /// Two rooms with a gate of 1 m by 3 m. A pane fills the gate except for some holes, each given
    /// by its range of z and of y in voxels.
    fn with_pane(holes: &[[[u32; 2]; 2]]) -> World {
        let mut world = stage::row(2);
        stage::narrow(&mut world, 0, 2, [0.0, 1.0]);
        let is_open = |z: u32, y: u32| {
            holes
                .iter()
                .any(|[along, up]| (along[0]..along[1]).contains(&z) && (up[0]..up[1]).contains(&y))
        };
        let places = (0..GATE[0]).flat_map(|z| (0..GATE[1]).map(move |y| (z, y)));
        let voxels = places.filter(|(z, y)| !is_open(*z, *y)).map(|(z, y)| {
            let key = morton(UVec3::new(200, y, z));
            Voxel { key, flags: Material::GLASS, ..Voxel::default() }
        });
        world.octree =
            Octree::from_voxels(Vec3::ZERO, VOXEL_M, 9, voxels.collect()).expect("small");
        world
    }

    fn is_wide_enough(world: &World) -> bool {
        Clearance::new(world).admits_gate(0)
    }

    #[test]
    fn bodies_fit_through_doors_and_not_through_panes_slits_and_gaps() {
        for (hole, is_wide) in [
            ([[0, 0], [0, 0]], false),
            ([[0, 20], [0, 60]], true),
            // A gap of 40 cm is as wide as a body; one of 15 cm is not.
            ([[6, 14], [0, 60]], true),
            ([[8, 11], [0, 60]], false),
            // A hatch, the opening over a lintel, a window, and a window down to the floor.
            ([[0, 20], [14, 28]], false),
            ([[0, 20], [50, 60]], false),
            ([[0, 20], [20, 38]], false),
            ([[0, 20], [7, 42]], true),
        ] {
            assert_eq!(is_wide_enough(&with_pane(&[hole])), is_wide, "{hole:?}");
        }
    }

    proptest! {
        /// A gate is wide wherever the reference model, which tries every other centimetre, finds
        /// room for a body.
        #[test]
        fn where_a_body_fits_it_may_pass(
            holes in prop::collection::vec((0..20_u32, 0..20_u32, 0..40_u32, 10..60_u32), 1..4),
        ) {
            let hole = |(z, wide, y, high): (u32, u32, u32, u32)| [[z, z + wide], [y, y + high]];
            let world = with_pane(&holes.into_iter().map(hole).collect::<Vec<_>>());
            let mut places = (0..50).flat_map(|z| (0..150).map(move |y| [z, y]));
            let has_room = places.any(|[z, y]| {
                let eye = Vec3::new(10.0, y as f32 * 0.02, z as f32 * 0.02);
                !world.octree.solid_in(&world.body.around(eye))
            });
            prop_assert!(!has_room || is_wide_enough(&world));
        }
    }
}
