//! Eye to cell: what can be seen from anywhere in a box of eyes, in some directions.

use std::{borrow::Cow, ops::Range};

use glam::{DVec3, Vec3};
use roaring::RoaringBitmap;

use super::{DAabb, FlowScratch, HalfSpace, Query, Sightlines};
use sightline_world::{
    CellId,
    geometry::{Aabb, Frustum},
    tolerance::{ASTRAY_M, WIDENING_M},
};

/// What a call needs memory for; kept from one to the next.
#[derive(Default)]
pub(super) struct EyeScratch {
    /// That the viewpoint box overlaps.
    cells: Vec<CellId>,
    /// That these see.
    spaces: Vec<u32>,
    frustum: Vec<HalfSpace>,
}

impl Sightlines<'_> {
    /// The cells of which some point may be visible to an eye somewhere in a box, and when there is
    /// a frustum, one that looks as that does: never too few. The box is given in the world's axes.
    ///
    /// The box may lie in several spaces, each of which has a search of its own from the part of the box
    /// in it. No more is found than the PVS rows of the cells that the box overlaps hold. A box that lies
    /// in something solid altogether stands for eyes in the nearest cell, if one is a hand's breadth
    /// from its centre; what is out of bounds, for eyes on the boundary. Nothing is seen from an
    /// empty box.
    ///
    /// The subdivision needs its PVS. `scratch` can be kept from one call to the next: then little
    /// is allocated but what is found.
    ///
    /// ```
    /// use glam::Vec3;
    /// use sightline_shared::{
    ///     geometry::{Aabb, Frustum},
    ///     world::{Cells, stab::{Scratch, Sightlines}},
    /// };
    ///
    /// let cells = Cells::whole(Aabb::new(Vec3::ZERO, Vec3::splat(4.0)));
    /// let lines = Sightlines::new(&cells);
    /// let mut scratch = Scratch::default();
    /// // An eye that is within 10 cm, and looks along -z with 90 and 65 degrees.
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
        let mut room = std::mem::take(&mut scratch.room_of_eye);
        let eyes = self.own_eyes(viewpoint, &mut room.cells);
        let mut found = RoaringBitmap::new();
        let mut next = 0;
        while let Some(&CellId(first)) = room.cells.get(next) {
            // The cells of a space follow one another.
            let space = self.cells.cells[first as usize].space;
            let of_space = &self.cells.spaces[space as usize].cells;
            let more = room.cells[next..].iter().take_while(|cell| of_space.contains(&cell.0));
            let part = next..next + more.count();
            next = part.end;
            found |= self.visible_from_space(scratch, &mut room, space, part, &eyes, frustum);
        }
        scratch.room_of_eye = room;
        found
    }

    /// The box of eyes in own axes, and the cells it overlaps.
    fn own_eyes(&self, viewpoint: &Aabb, cells: &mut Vec<CellId>) -> Aabb {
        let axes = &self.cells.axes;
        let mut eyes = axes.own_box(viewpoint);
        if axes.turn() != 0.0 {
            // An eye of the box may be rounded to a place beside the box's rounded corners.
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

    /// Likewise, of the part of the box in one space: in `room.cells[part]`.
    fn visible_from_space(
        &self,
        scratch: &mut FlowScratch,
        room: &mut EyeScratch,
        space: u32,
        part: Range<usize>,
        eyes: &Aabb,
        frustum: Option<&Frustum>,
    ) -> RoaringBitmap {
        let mut source = Aabb::EMPTY;
        // One row, as most often, is not copied.
        let mut rows = Cow::Owned(RoaringBitmap::new());
        for (index, cell) in room.cells[part].iter().enumerate() {
            let bounds = &self.cells.cells[cell.0 as usize].bounds;
            // What is out of bounds looks in from the boundary.
            let clamped = |corner: Vec3| corner.clamp(bounds.min, bounds.max);
            source = source.union(&Aabb::new(clamped(eyes.min), clamped(eyes.max)));
            let row = &self.cells.pvs[cell.0 as usize];
            if index == 0 {
                rows = Cow::Borrowed(row);
            } else {
                *rows.to_mut() |= row;
            }
        }
        room.spaces.clear();
        for cell in rows.iter() {
            let of = self.cells.cells[cell as usize].space;
            if room.spaces.last() != Some(&of) {
                room.spaces.push(of);
            }
        }
        let source = DAabb::around(&source, WIDENING_M);
        room.frustum.clear();
        for &outwards in frustum.map_or(&[][..], Frustum::outwards) {
            room.frustum.push(swept(self.cells.axes.own_exact(outwards), &source));
        }
        let query = Query { space, source, spaces: Some(&room.spaces), frustum: &room.frustum };
        let mut seen = self.cells(scratch, &query);
        seen.retain(|cell| rows.contains(*cell));
        seen.sort_unstable();
        RoaringBitmap::from_sorted_iter(seen).expect("sorted, and each once")
    }
}

/// What a side of a frustum leaves, wherever in a box its apex is.
fn swept(outwards: DVec3, apexes: &DAabb) -> HalfSpace {
    let limit = (outwards * apexes.min).max(outwards * apexes.max).element_sum();
    HalfSpace { normal: outwards, limit }
}
