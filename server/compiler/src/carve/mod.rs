//! Carving: from any model to an axial one, and the parts that were cut off (Lei and Ouhyoung 1999,
//! sections 3 and 4).
//!
//! Coplanar triangles merge to polygons, which are axial, semi-axial or non-axial. Non-axial
//! polygons that share edges make *clusters*; those that share non-axial edges make the smaller
//! *elements*. Each cluster or element is a carving unit. From the model, the box of the non-axial
//! edges of the unit is subtracted, but only in the part of the model that is connected to the unit
//! inside the box. What was in the box is a *cutting*: a detail object, still drawn and still in
//! the oracle's mesh, but no occluder. What is left has only axial and semi-axial polygons.
//!
//! ```
//! use glam::DVec3;
//! use sightline_compiler::carve::{self, CarveOptions, Class};
//!
//! // A gable: a wall of two triangles, and a third on top of it.
//! let [a, b, c, d, top] = [[0., 0.], [4., 0.], [4., 3.], [0., 3.], [2., 4.]]
//!     .map(|[x, y]| DVec3::new(x, y, 0.0));
//! let triangles = [[a, b, c], [a, c, d], [d, c, top]];
//! let carved = carve::carve(&triangles, &[], &CarveOptions::default());
//! assert_eq!(carved.report.before, Class::NonAxial);
//! assert_eq!(carved.report.after, Class::Axial);
//! assert_eq!((carved.report.elements, carved.report.clusters), (1, 1));
//! ```
//!
//! # What may be used as an occluder
//!
//! [`CarvedModel::polygons`] may always be used. Each is a part of an original polygon, to within
//! the tolerance of welding, so whatever it blocks was blocked before. Merging moves no corner of
//! the triangles in it. Cuttings in an axial plane may be used too; to leave them out makes the PVS
//! larger, never wrong.
//!
//! [`CarvedModel::caps`] may be used only where [`CapPolygon::sealed`]. Caps close the hole that a
//! box leaves in a solid, and lie inside what was solid. In a model whose surfaces do not close,
//! inside and outside are a guess, and a cap may stand in the open. A cap is sealed when the
//! surface that was cut is a closed 2-manifold, and all of the cap is inside the closed surfaces of
//! the model, cavities counted. A line of sight between two points outside all solids that crosses
//! a sealed cap enters the solid first. It crosses the original surface there, so it was blocked
//! before. (Points inside a solid wall are different: a caller that counts them as places to be
//! must not use caps.)
//!
//! # What bounds the loss
//!
//! The box of a large cluster, such as a terrain, would take all axial walls that are joined to it.
//! So a unit takes at most [`LOSS_MAX`] times its own area of other polygons. It takes more than
//! [`FREE_LOSS_M2`] only where sealed caps make up for it. Thus carving does not cost more
//! occluders than it gives. Where a cluster would take more, its elements are the units. Where an
//! element would take more, only its own polygons are cut and no cap is added. What is left is
//! axial all the same.

mod caps;
mod carved_model;
mod carver;
mod classes;
mod orientation;
mod plane;
mod polygons;
mod sealing;
mod topology;
mod union;
mod volume;

use std::ops::ControlFlow;

use glam::DVec3;

use carver::{Carver, Carving};
use classes::{Groups, classes};
use polygons::Polygons;

pub use carved_model::{CapPolygon, CarveReport, CarvedModel, Class, Polygon};
pub use carver::{FREE_LOSS_M2, LOSS_MAX};
pub use orientation::dominant_orientation;
pub use plane::Plane;

/// About this share of the work is done when triangles are merged to polygons.
const MERGED: f32 = 0.5;
/// About this share of the work is done when the carving units are known.
const GROUPED: f32 = 0.7;

/// How a model is carved.
#[derive(Clone, Copy, Debug, Default)]
pub struct CarveOptions {
    /// What is carved at a time.
    pub units: CarvingUnits,
}

/// How large carving units are (Lei and Ouhyoung 1999, Fig. 6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CarvingUnits {
    /// Clusters, which are as large as possible: fewer portals.
    #[default]
    Clusters,
    /// Elements, which are as small as possible: more portals, but smaller ones.
    Elements,
}

/// Carves a model of triangles, with y up. Corners run anticlockwise seen from the front.
///
/// `surfaces` gives the surface of each triangle, or is empty; triangles of two surfaces do not
/// merge. Corners closer than 0.02 mm count as one. The time is nearly linear in the number of
/// triangles.
pub fn carve(triangles: &[[DVec3; 3]], surfaces: &[u32], options: &CarveOptions) -> CarvedModel {
    carve_with_progress(triangles, surfaces, options, &mut |_| ControlFlow::Continue(()))
        .expect("this progress never breaks")
}

/// Carves a model as [`carve()`] does, and reports the share that is done, from 0 to 1. When
/// `progress` breaks, the result is `None`.
pub fn carve_with_progress(
    triangles: &[[DVec3; 3]],
    surfaces: &[u32],
    options: &CarveOptions,
    progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
) -> Option<CarvedModel> {
    assert!(
        surfaces.is_empty() || surfaces.len() == triangles.len(),
        "a surface for each triangle"
    );
    let mut goes_on = |share| progress(share).is_continue().then_some(());
    let polygons = Polygons::merge(triangles, surfaces);
    goes_on(MERGED)?;
    let classes = classes(&polygons);
    let groups = Groups::of(&polygons, &classes);
    let mut carver = Carver::new(triangles, &polygons, &classes);
    let units = match options.units {
        CarvingUnits::Clusters => &groups.clusters,
        CarvingUnits::Elements => &groups.elements,
    };
    let element_of = groups.element_of(polygons.len());
    goes_on(GROUPED)?;
    for (index, unit) in units.iter().enumerate() {
        if index % 16 == 0 {
            goes_on(GROUPED + (1.0 - GROUPED) * index as f32 / units.len() as f32)?;
        }
        carve_unit(&mut carver, unit, &groups, &element_of);
    }
    let carving = carver.finish();
    let report = report(&polygons, &classes, &groups, &carving);
    let Carving { kept, cuttings, caps, .. } = carving;
    Some(CarvedModel { polygons: kept, caps, cuttings, report })
}

/// Carves a unit as a whole, or element by element when the whole would take too much of others.
fn carve_unit(carver: &mut Carver<'_>, unit: &[u32], groups: &Groups, element_of: &[u32]) {
    if carver.carve(unit) {
        return;
    }
    let mut elements: Vec<u32> = unit.iter().map(|&p| element_of[p as usize]).collect();
    elements.sort_unstable();
    elements.dedup();
    for element in elements {
        let element = &groups.elements[element as usize];
        if !carver.carve(element) {
            carver.carve_confined(element);
        }
    }
}

/// Counts what carving did.
fn report(
    polygons: &Polygons,
    classes: &[Class],
    groups: &Groups,
    carving: &Carving,
) -> CarveReport {
    assert!(carving.kept.len() <= polygons.len(), "carving adds no polygon");
    let count = |class| classes.iter().filter(|&&c| c == class).count();
    let worst = |classes: &mut dyn Iterator<Item = Class>| classes.max().unwrap_or(Class::Axial);
    CarveReport {
        polygons: polygons.len(),
        axial: count(Class::Axial),
        semi_axial: count(Class::SemiAxial),
        non_axial: count(Class::NonAxial),
        elements: groups.elements.len(),
        clusters: groups.clusters.len(),
        units: carving.units,
        confined: carving.confined,
        cuttings: carving.cuttings.len(),
        added: carving.caps.len(),
        sealed: carving.caps.iter().filter(|added| added.sealed).count(),
        removed: polygons.len() - carving.kept.len(),
        degenerate: polygons.degenerate.len(),
        before: worst(&mut classes.iter().copied()),
        after: worst(&mut carving.kept.iter().map(|polygon| polygon.class)),
    }
}

#[cfg(test)]
mod tests;
