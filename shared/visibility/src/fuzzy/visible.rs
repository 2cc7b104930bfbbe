//! Visible patches, by the modified visibility method (Lim 1999): homogeneity indicators and lists
//! of projected patches for each element.

use glam::DVec3;
use sightline_world::tolerance::NEAR_PLANE_M;

use super::{
    faces::{CubeFace, ViewpointBox, region},
    raster::{ROUNDING, rows},
    surfaces::Surfaces,
    visibility::PatchVisibility,
};

/// Whose fuzzy regions meet an element.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ElementContent {
    /// No patch's.
    Nothing,
    /// Patches of one group only. Those that may be visible are in a list, given by the index of
    /// its last entry.
    One { group: u64, list: u32 },
    /// Patches of several groups.
    Several,
}

/// The index of no entry, which ends a list.
const END: u32 = u32::MAX;

/// A face, with the content of each element.
struct Homogeneity {
    size: usize,
    elements: Vec<ElementContent>,
    /// A projected patch, and the index of the entry before it in the same list.
    entries: Vec<(u32, u32)>,
}

/// Marks the patches that every eye sees whole and that hide nothing, among those that are not
/// settled.
pub(super) fn find(
    surfaces: &Surfaces,
    viewpoints: &ViewpointBox,
    size: usize,
    classes: &mut [PatchVisibility],
) {
    if viewpoints.is_empty() {
        return;
    }
    let eyes = viewpoints.corners();
    let around = viewpoints.eyes().grown(NEAR_PLANE_M as f32);
    let mut is_clear: Vec<bool> =
        classes.iter().map(|class| *class != PatchVisibility::Invisible).collect();
    let there: Vec<(usize, i8)> = (0..surfaces.len())
        .filter(|patch| is_clear[*patch])
        .map(|patch| (patch, surfaces.mesh.side(patch, &eyes)))
        .collect();
    for (patch, side) in &there {
        is_clear[*patch] &= *side != 0;
        if surfaces.mesh.patch(*patch).bounds.intersects(&around) {
            // This patch may hide any other one, whichever way an eye looks.
            return;
        }
    }
    let faces: Vec<CubeFace> = viewpoints.faces().collect();
    let mut spare = Vec::new();
    for face in &faces {
        let mut homogeneity = Homogeneity::new(size);
        for &(patch, side) in &there {
            let corners: Vec<DVec3> = surfaces.mesh.corners(patch).collect();
            let polygon = region(*face, &corners, &eyes, size as f64, &mut spare);
            // A patch that eyes see from both sides is a group of its own.
            let group = match side {
                0 => 1 << 63 | patch as u64,
                side => u64::from(surfaces.mesh.patch(patch).group) << 1 | u64::from(side > 0),
            };
            let member = GroupMember { patch, group };
            rows(&polygon, size, 4.0 * ROUNDING, |row, from, to| {
                for column in from..=to {
                    homogeneity.add(row * size + column, &member, &mut is_clear);
                }
            });
        }
    }
    let inactive: Vec<CubeFace> =
        CubeFace::ALL.into_iter().filter(|face| !faces.contains(face)).collect();
    for (patch, _) in there.into_iter().filter(|(patch, _)| is_clear[*patch]) {
        let corners: Vec<DVec3> = surfaces.mesh.corners(patch).collect();
        // A patch that reaches beyond the field of view was not tested in whole.
        let reaches = |face: &CubeFace| {
            !region(*face, &corners, &eyes, size as f64, &mut spare.clone()).is_empty()
        };
        if !inactive.iter().any(reaches) {
            classes[patch] = PatchVisibility::Visible;
        }
    }
}

/// A patch, and the group of patches it belongs to that do not hide each other.
struct GroupMember {
    patch: usize,
    group: u64,
}

impl Homogeneity {
    fn new(size: usize) -> Self {
        Self { size, elements: vec![ElementContent::Nothing; size * size], entries: Vec::new() }
    }

    /// Notes that a patch's fuzzy region meets an element.
    fn add(&mut self, element: usize, member: &GroupMember, is_clear: &mut [bool]) {
        let &GroupMember { patch, group } = member;
        debug_assert!(element < self.size * self.size);
        let met = &mut self.elements[element];
        let list = match *met {
            ElementContent::Nothing => END,
            ElementContent::One { group: known, list } if known == group => list,
            ElementContent::One { list, .. } => {
                *met = ElementContent::Several;
                self.reset(list, is_clear);
                is_clear[patch] = false;
                return;
            }
            ElementContent::Several => {
                is_clear[patch] = false;
                return;
            }
        };
        let list = if is_clear[patch] {
            self.entries.push((patch as u32, list));
            self.entries.len() as u32 - 1
        } else {
            list
        };
        *met = ElementContent::One { group, list };
    }

    /// Marks the patches of a list as not visible whole.
    fn reset(&self, mut list: u32, is_clear: &mut [bool]) {
        while list != END {
            let (patch, before) = self.entries[list as usize];
            is_clear[patch as usize] = false;
            list = before;
        }
    }
}
