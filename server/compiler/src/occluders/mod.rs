//! The surfaces that occlude, grouped by plane: along these planes space is split into cells.
//!
//! A triangle is axial when its three corners agree on one coordinate. Planes are axial, or
//! vertical at any other angle. A triangle in another plane is left out: that makes the PVS larger,
//! never wrong.

mod coverage;
mod plane;
mod planes;
mod rectangle;

pub(crate) use coverage::uncovered;
pub(crate) use plane::OccluderPlane;
pub(crate) use planes::{OccluderTriangle, planes};
pub(crate) use rectangle::{PlaneRect, PlaneTriangle};

use crate::carve::{CarvedModel, Class};

/// The triangles of a carved model that may be occluders. Level surfaces with turned edges come
/// last: they leave no portal when space is split along everything upright before them.
pub(crate) fn occluder_triangles(carved: &CarvedModel) -> Vec<OccluderTriangle> {
    let kept = carved.polygons.iter().flat_map(|polygon| {
        let is_last = polygon.class == Class::SemiAxial && polygon.plane.axis() == Some(1);
        polygon.triangles.iter().map(move |&corners| OccluderTriangle { corners, is_last })
    });
    let sealed = carved.caps.iter().filter(|added| added.sealed);
    let added = sealed.flat_map(|added| &added.triangles);
    // A cutting in an axial plane occludes where it is, whatever its edges are.
    let flat = carved.cuttings.iter().filter(|cutting| cutting.plane.axis().is_some());
    let flat = flat.flat_map(|cutting| &cutting.triangles);
    let opaque = |&corners| OccluderTriangle { corners, is_last: false };
    kept.chain(added.chain(flat).map(opaque)).collect()
}
