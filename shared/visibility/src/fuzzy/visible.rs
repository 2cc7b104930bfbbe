//! Visibility: the modified method, with homogeneous indicators and lists of projected patches.

use glam::DVec3;
use sightline_world::tolerance::NEAR_PLANE_M;

use super::{
    PatchVisibility, Surfaces, ViewpointBox,
    faces::{CubeFace, region},
    raster::{ROUNDING, rows},
};

/// What the fuzzy regions of patches make of an element.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ElementContent {
    /// No patch's is here.
    Nothing,
    /// Those of one surface only; the patches that may be visible are in a list that ends with the
    /// number of an entry.
    One {
        kin: u64,
        list: u32,
    },
    Several,
}

const END: u32 = u32::MAX;

/// A face, and for each element what was met.
struct Homogeneity {
    size: usize,
    elements: Vec<ElementContent>,
    /// Projected patches, and the entry before in the same list.
    entries: Vec<(u32, u32)>,
}

/// Marks the patches of which every eye sees all and which hide nothing, among those that are not
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
        .map(|patch| (patch, surfaces.side(patch, &eyes)))
        .collect();
    for (patch, side) in &there {
        is_clear[*patch] &= *side != 0;
        if surfaces.patch(*patch).bounds.intersects(&around) {
            // It may be before any other, whichever way an eye looks.
            return;
        }
    }
    let faces: Vec<CubeFace> = viewpoints.faces().collect();
    let mut spare = Vec::new();
    for face in &faces {
        let mut homogeneity = Homogeneity::new(size);
        for &(patch, side) in &there {
            let corners: Vec<DVec3> = surfaces.corners(patch).collect();
            let polygon = region(*face, &corners, &eyes, size as f64, &mut spare);
            // Those that are seen from both sides are of no surface but their own.
            let kin = match side {
                0 => 1 << 63 | patch as u64,
                side => u64::from(surfaces.patch(patch).kin) << 1 | u64::from(side > 0),
            };
            rows(&polygon, size, 4.0 * ROUNDING, |row, from, to| {
                for column in from..=to {
                    homogeneity.add(row * size + column, (patch, kin), &mut is_clear);
                }
            });
        }
    }
    let inactive: Vec<CubeFace> =
        CubeFace::ALL.into_iter().filter(|face| !faces.contains(face)).collect();
    for (patch, _) in there.into_iter().filter(|(patch, _)| is_clear[*patch]) {
        let corners: Vec<DVec3> = surfaces.corners(patch).collect();
        // What reaches beyond the field of view was not looked at in whole.
        let reaches = |face: &CubeFace| {
            !region(*face, &corners, &eyes, size as f64, &mut spare.clone()).is_empty()
        };
        if !inactive.iter().any(reaches) {
            classes[patch] = PatchVisibility::Visible;
        }
    }
}

impl Homogeneity {
    fn new(size: usize) -> Self {
        Self { size, elements: vec![ElementContent::Nothing; size * size], entries: Vec::new() }
    }

    /// Takes in that a patch's fuzzy region meets an element.
    fn add(&mut self, element: usize, (patch, kin): (usize, u64), is_clear: &mut [bool]) {
        debug_assert!(element < self.size * self.size);
        let met = &mut self.elements[element];
        let list = match *met {
            ElementContent::Nothing => END,
            ElementContent::One { kin: known, list } if known == kin => list,
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
        *met = ElementContent::One { kin, list };
    }

    /// None of the patches of a list is visible in whole.
    fn reset(&self, mut list: u32, is_clear: &mut [bool]) {
        while list != END {
            let (patch, before) = self.entries[list as usize];
            is_clear[patch as usize] = false;
            list = before;
        }
    }
}
