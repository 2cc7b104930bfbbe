//! Exits: gates as seen from one of the two spaces they join.

use glam::{Vec3A, Vec4};
use sightline_world::{geometry::Aabb, tolerance::GATE_WIDENING_M};

use super::simd_box::SimdBox;

/// The direction in which lines leave by an exit. Below [`AXIAL_DIRECTIONS`] it is twice the axis,
/// plus one if coordinates grow; the gate then fills its box. Any other value less
/// `AXIAL_DIRECTIONS` is an index into the flood's normals.
pub(super) type ExitDirection = u32;

/// The number of axial directions: down and up each axis.
pub(super) const AXIAL_DIRECTIONS: ExitDirection = 6;

/// A gate out of a space, packed into half a cache line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exit {
    /// The least corner of the box around the gate. The last lane holds the bits of the index of
    /// the space beyond.
    low: Vec4,
    /// The greatest corner. The last lane holds the bits of the exit's direction.
    high: Vec4,
}

impl Exit {
    pub(super) fn new(gate: &Aabb, beyond: u32, direction: ExitDirection) -> Self {
        debug_assert!(!gate.is_empty(), "a gate has corners");
        let gate = gate.grown(GATE_WIDENING_M);
        Self {
            low: gate.min.extend(f32::from_bits(beyond)),
            high: gate.max.extend(f32::from_bits(direction)),
        }
    }

    /// The box around the gate, enlarged by [`GATE_WIDENING_M`].
    pub(super) fn gate(&self) -> SimdBox {
        SimdBox { low: Vec3A::from_vec4(self.low), high: Vec3A::from_vec4(self.high) }
    }

    /// The index of the space beyond the gate.
    pub(super) fn beyond(&self) -> u32 {
        self.low.w.to_bits()
    }

    pub(super) fn direction(&self) -> ExitDirection {
        self.high.w.to_bits()
    }
}
