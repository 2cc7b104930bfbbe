//! Fuzzy projection: what no eye in a box can see, and what every eye in it sees whole. After Lim
//! 1999 (US Patent 5,914,721).
//!
//! **Directions, not places.** All eyes of a [viewpoint box](ViewpointBox) look at the six faces of
//! one cube. An *element* of a face stands for the directions that it covers, whichever eye looks
//! there. Seen from all eyes at once, the outline of a surface is not a line but a band, its *fuzzy
//! boundary*. Take a direction outside all such bands in which one eye sees the surface. Then all
//! eyes see the surface in that direction: it is in the surface's *non-fuzzy region*.
//!
//! **Why the depths of one eye are enough.** Let a direction be in the non-fuzzy region of a
//! surface whose patches all face the box. Let a point lie behind the surface in this direction, as
//! seen from one eye, and take any other eye of the box. The lines in this direction from all
//! places between the two eyes meet the surface. So in the plane of the two eyes and the point, the
//! surface is a curve from one line to the other, with the second eye before it and the point
//! behind it. The line from the second eye to the point crosses that curve.
//!
//! So the buffer keeps, for each element, the greatest distance at which the nearest such surface
//! can be, as seen from the middle of the box. What is farther from there is hidden from all eyes
//! ([`FuzzyBuffer::hides`]). The size of the box only makes the bands wider.
//!
//! **Surfaces** are patches that share edges. Patches are flat, convex polygons. An edge that
//! belongs to more than two patches counts as a boundary. Surfaces may cut each other, be thin and
//! be seen from either side. A patch whose plane meets the box turns away from some eyes and hides
//! nothing.
//!
//! **The band of an edge** is exact. The differences between the points of the edge and the eyes
//! fill the convex hull of sixteen points, and its projection is the convex hull of their
//! projections. The source's fuzzy extent is the rectangle around it, by equations (1) and (2) of
//! Appendix 2 ([`fuzzy_extent`]). It costs less and is looser, and nothing here uses it.
//!
//! **What every eye sees** ([`classify`]): a patch is visible if its elements are met by the fuzzy
//! regions of no surface but its own. It then hides nothing, and nothing hides it, if its surface
//! does not hide itself. Flat and convex surfaces do not. Any other surface is divided into its
//! planes.
//!
//! [`PackedVisibility`] stores the result: the smaller two of the three lists of patches, as
//! differences between indices, or the changes to the lists of a neighbouring box. What is settled
//! for a box is settled for every box inside it.
//!
//! The source's cache for elements is left out. A face of 400² elements takes 640 kB and is read in
//! rows, so it fits in today's second-level caches.

mod buffer;
mod classify;
mod depths;
mod faces;
mod facets;
mod packed;
mod patches;
mod raster;
mod scan;
mod sub_surfaces;
mod surfaces;
#[cfg(test)]
mod tests;
mod visibility;
mod visible;

pub use buffer::FuzzyBuffer;
pub use classify::classify;
pub use faces::{ViewpointBox, fuzzy_extent};
pub use packed::{PackedVisibility, UnpackError};
pub use patches::SurfaceError;
pub use surfaces::Surfaces;
pub use visibility::PatchVisibility;
