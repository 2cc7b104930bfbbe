//! Fuzzy projection: what no eye in a box can see, and what every eye in it sees unhindered.
//!
//! **Directions, not places.** All eyes of a [viewpoint box](ViewpointBox) look at the six faces of one
//! cube. A cell of a face (an *element*) stands for the directions that it covers, whichever eye
//! looks there. Seen from all eyes at once the outline of a surface is no line but a band, its
//! *fuzzy boundary*. A direction outside of all such bands, in which one eye sees the surface, is one in
//! which all do: it is in the surface's *non-fuzzy region*.
//!
//! **Why one eye's depths are enough.** Let a direction be in the non-fuzzy region of a surface all of
//! whose patches face the box, and let a point lie behind it, in this direction, as seen from one eye. Take
//! any other eye of the box. The lines in this direction through the places between both eyes all meet
//! the surface, so in the plane of the two eyes and the point it is a curve from the one line to the other,
//! with the second eye before it and the point behind it. The line from that eye to the point crosses it.
//! So the buffer keeps, for each element, how far the nearest such surface is at the most, seen from
//! the middle of the box, and what is farther from there is hidden from all eyes ([`FuzzyBuffer::hides`]).
//! Nothing need be added for the size of the box: that is in the bands alone.
//!
//! **Surfaces** are patches that share edges: flat, convex polygons of which an edge belongs to two at
//! most, or it counts as a boundary. They may cut each other, be thin, be seen from either side. What
//! turns away from some of the eyes (patches whose plane meets the box) hides nothing.
//!
//! **The band of an edge** is exact: the differences between its points and the eyes fill the convex hull
//! of sixteen points, whose projection is the hull of theirs. The paper's fuzzy extent, the rectangle
//! around it by equations (1) and (2), is [`fuzzy_extent`], for whoever wants less work and a looser answer: nothing here does.
//!
//! **What every eye sees** ([`classify`]): a patch all of whose elements are met by the fuzzy regions of
//! no surface but its own. It hides nothing, and nothing hides it, if its surface does not hide itself;
//! those that are flat or convex do not, and others are taken as one surface for each plane.
//!
//! [`PackedVisibility`] keep what was found: the smallest two of the three lists, as differences between ids or
//! as changes to a neighbour's. What is settled for a box is settled for every box inside of it.
//!
//! A cache for elements, as the patent has it, is left out: a face of 400² elements is 640 kB, and what is
//! read of it one after another is in rows, so that today's second-level caches hold it already.

mod buffer;
mod depths;
mod faces;
mod facets;
mod packed;
mod raster;
mod scan;
mod sub_surfaces;
mod surfaces;
mod visible;

pub use buffer::FuzzyBuffer;
pub use faces::{ViewpointBox, fuzzy_extent};
pub use packed::{PackedVisibility, UnpackError};
pub use surfaces::{SurfaceError, Surfaces};

/// What a box of eyes makes of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PatchVisibility {
    /// No eye sees any of it.
    Invisible,
    /// Every eye sees all of it, and it hides nothing that is not invisible.
    Visible,
    /// Neither is sure.
    Remaining,
}

/// Sorts the patches of all surfaces, in their order, with faces of `size` × `size` elements.
/// [`FuzzyBuffer::find_hidden`] does the first half of it, which is the cheaper and mostly the better one.
///
/// What was settled for a box around this one may be given, and stays settled.
///
/// ```
/// use glam::Vec3;
/// use sightline_visibility::fuzzy::{PatchVisibility, Surfaces, ViewpointBox, classify};
/// use sightline_world::geometry::Aabb;
///
/// // A wall of 4 m by 4 m, and a tile of 0.2 m behind it.
/// let square = |z: f32, half: f32| {
///     [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| Vec3::new(x, y, z))
/// };
/// let corners = [square(-2.0, 2.0), square(-3.0, 0.1)].concat();
/// let patches = [(0, vec![0, 1, 2, 3]), (1, vec![4, 5, 6, 7])];
/// let surfaces = Surfaces::new(&corners, &patches)?;
/// let eyes = ViewpointBox::all_round(Aabb::around(Vec3::ZERO, 0.25));
/// assert_eq!(classify(&surfaces, &eyes, 128, None), [PatchVisibility::Visible, PatchVisibility::Invisible]);
/// # Ok::<(), sightline_visibility::fuzzy::SurfaceError>(())
/// ```
pub fn classify(
    surfaces: &Surfaces,
    viewpoints: &ViewpointBox,
    size: usize,
    settled: Option<&[PatchVisibility]>,
) -> Vec<PatchVisibility> {
    let mut classes = match settled {
        Some(settled) if settled.len() == surfaces.len() => settled.to_vec(),
        _ => vec![PatchVisibility::Remaining; surfaces.len()],
    };
    let buffer = FuzzyBuffer::new(surfaces, viewpoints, size);
    buffer.find_hidden(surfaces, &mut classes);
    visible::find(surfaces, viewpoints, buffer.size(), &mut classes);
    classes
}

#[cfg(test)]
mod tests;
