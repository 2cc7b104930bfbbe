//! Eye-to-cell visibility: what can be seen from a box of eyes in some directions (Teller and
//! Séquin 1991).

use std::{borrow::Cow, ops::Range};

use glam::{DVec3, Vec3};
use roaring::RoaringBitmap;
use sightline_world::{
    CellId,
    geometry::{Aabb, Frustum},
    tolerance::{ASTRAY_M, WIDENING_M},
};

use super::{
    daabb::DAabb,
    scratch::{EyeScratch, FlowScratch},
    sightlines::{Query, Sightlines},
};
use crate::HalfSpace;

impl Sightlines<'_> {
    /// The cells of which some point may be visible to an eye somewhere in a box: never too few.
    /// With a frustum, only what is inside the frustum of some eye counts. The box is given in the
    /// world's axes.
    ///
    /// If the box overlaps several spaces, each has a search of its own, from the part of the box
    /// in it. The result lies within the PVS of the cells that the box overlaps, so the subdivision
    /// must have its PVS.
    ///
    /// A box that lies in something solid stands for eyes in the nearest cell, if one is within
    /// [`ASTRAY_M`] of its centre. A box out of bounds stands for eyes on the boundary. Nothing is
    /// seen from an empty box.
    ///
    /// Keep `scratch` from one call to the next: then little memory is allocated besides the
    /// result.
    ///
    /// ```
    /// use glam::Vec3;
    /// use sightline_visibility::portal_flow::{FlowScratch, Sightlines};
    /// use sightline_world::{
    ///     Cells,
    ///     geometry::{Aabb, Frustum},
    /// };
    ///
    /// let cells = Cells::whole(Aabb::new(Vec3::ZERO, Vec3::splat(4.0)));
    /// let lines = Sightlines::new(&cells);
    /// let mut scratch = FlowScratch::default();
    /// // An eye within 10 cm of a point. It looks along -z with angles of 90 and 65 degrees.
    /// let viewpoint = Aabb::around(Vec3::new(2.0, 1.6, 2.0), 0.1);
    /// let frustum = Frustum::new(0.0, 0.0, 90f32.to_radians(), 65f32.to_radians());
    /// let seen = lines.visible_from(&mut scratch, &viewpoint, Some(&frustum));
    /// assert!(seen.contains(0));
    /// ```
    pub fn visible_from(
        &self,
        scratch: &mut FlowScratch,
        viewpoint: &Aabb,
        frustum: Option<&Frustum>,
    ) -> RoaringBitmap {
        let is_box = viewpoint.min.is_finite() && viewpoint.max.is_finite();
        if viewpoint.is_empty() || !is_box {
            return RoaringBitmap::new();
        }
        debug_assert_eq!(self.cells.pvs.len(), self.cells.cells.len(), "the PVS is there");
        let mut eye = std::mem::take(&mut scratch.eye);
        let eyes = self.own_eyes(viewpoint, &mut eye.cells);
        let mut found = RoaringBitmap::new();
        let mut next = 0;
        while let Some(&CellId(first)) = eye.cells.get(next) {
            // The cells of a space have consecutive indices.
            let space = self.cells.cells[first as usize].space;
            let of_space = &self.cells.spaces[space as usize].cells;
            let more = eye.cells[next..].iter().take_while(|cell| of_space.contains(&cell.0));
            let part = next..next + more.count();
            next = part.end;
            found |= self.visible_from_space(scratch, &mut eye, space, part, &eyes, frustum);
        }
        scratch.eye = eye;
        found
    }

    /// The box of eyes in own axes. Finds the cells it overlaps, or the nearest cell.
    fn own_eyes(&self, viewpoint: &Aabb, cells: &mut Vec<CellId>) -> Aabb {
        let axes = &self.cells.axes;
        let mut eyes = axes.own_box(viewpoint);
        if axes.turn() != 0.0 {
            // An eye on the boundary of the box may be rounded to a place outside the rounded box.
            let far = eyes.min.abs().max(eyes.max.abs()).max_element();
            eyes = eyes.grown(2.0 * f32::EPSILON * far);
        }
        cells.clear();
        self.cells.overlapping(&eyes, cells);
        if cells.is_empty() {
            cells.extend(self.cells.near_own(eyes.centre()));
            eyes = eyes.grown(ASTRAY_M);
        }
        eyes
    }

    /// The cells that may be visible from the part of the box in one space. `eye.cells[part]` are
    /// the cells of that space which the box overlaps.
    fn visible_from_space(
        &self,
        scratch: &mut FlowScratch,
        eye: &mut EyeScratch,
        space: u32,
        part: Range<usize>,
        eyes: &Aabb,
        frustum: Option<&Frustum>,
    ) -> RoaringBitmap {
        let mut source = Aabb::EMPTY;
        // A single row, the usual case, is not copied.
        let mut rows = Cow::Owned(RoaringBitmap::new());
        for (index, cell) in eye.cells[part].iter().enumerate() {
            let bounds = &self.cells.cells[cell.0 as usize].bounds;
            // Eyes out of bounds look in from the boundary.
            let clamped = |corner: Vec3| corner.clamp(bounds.min, bounds.max);
            source = source.union(&Aabb::new(clamped(eyes.min), clamped(eyes.max)));
            let row = &self.cells.pvs[cell.0 as usize];
            if index == 0 {
                rows = Cow::Borrowed(row);
            } else {
                *rows.to_mut() |= row;
            }
        }
        eye.spaces.clear();
        for cell in rows.iter() {
            let of = self.cells.cells[cell as usize].space;
            if eye.spaces.last() != Some(&of) {
                eye.spaces.push(of);
            }
        }
        let source = DAabb::around(&source, WIDENING_M);
        eye.frustum.clear();
        for &outwards in frustum.map_or(&[][..], Frustum::outwards) {
            eye.frustum.push(swept(self.cells.axes.own_exact(outwards), &source));
        }
        let query = Query { space, source, spaces: Some(&eye.spaces), frustum: &eye.frustum };
        let mut seen = self.cells(scratch, &query);
        seen.retain(|cell| rows.contains(*cell));
        seen.sort_unstable();
        RoaringBitmap::from_sorted_iter(seen).expect("sorted, and each once")
    }
}

/// The half-space inside a side of a frustum, for an apex anywhere in a box.
fn swept(outwards: DVec3, apexes: &DAabb) -> HalfSpace {
    let distance = (outwards * apexes.min).max(outwards * apexes.max).element_sum();
    HalfSpace { normal: outwards, distance }
}
