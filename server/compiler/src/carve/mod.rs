//! Carving: from any model to an axial one, and what was cut off (Lei and Ouhyoung 1999,
//! seeds/carving.txt, sections 3 and 4).
//!
//! Coplanar triangles merge to polygons, which are axial, semi-axial or non-axial. Non-axial
//! polygons that share edges make *clusters*, or by non-axial edges alone the smaller *elements*.
//! From each such carving unit, the box of its non-axial edges is subtracted, in the part of the
//! model that hangs together with the unit inside the box. What was in the box is a *cutting*: a
//! detail object, still drawn and still in the oracle's mesh, but no occluder. What is left has
//! only axial and semi-axial polygons.
//!
//! ```
//! use glam::DVec3;
//! use sightline_compiler::carve::{self, CarveOptions, Class};
//!
//! // A gable: a wall of two triangles, and a third on top of it.
//! let [a, b, c, d, top] = [[0., 0.], [4., 0.], [4., 3.], [0., 3.], [2., 4.]]
//!     .map(|[x, y]| DVec3::new(x, y, 0.0));
//! let carved = carve::carve(&[[a, b, c], [a, c, d], [d, c, top]], &[], &CarveOptions::default());
//! assert_eq!(carved.report.before, Class::NonAxial);
//! assert_eq!(carved.report.after, Class::Axial);
//! assert_eq!((carved.report.elements, carved.report.clusters), (1, 1));
//! ```
//!
//! # What may be used as an occluder
//!
//! [`CarvedModel::polygons`] always: each is a part of the original polygons, to within the tolerance
//! of welding, so whatever it blocks was blocked before. Merging moves no corner of what is handed
//! out. Cuttings whose plane is axial, too, for who can use them; to leave them out makes the PVS
//! larger, never wrong.
//!
//! [`CarvedModel::added`] only where [`CapPolygon::sealed`]. These polygons close the hole that a box leaves
//! in a solid, and lie inside of what was solid. In a model whose surfaces do not close, inside and
//! outside are a guess, and the polygon may stand in the open. It is sealed where the surface that
//! was cut is a closed 2-manifold, and all of the polygon is inside of the model's closed surfaces,
//! counting cavities: then a line of sight between two points outside of all solids that crosses the
//! polygon enters the solid first, so it crosses the original surface and was blocked before.
//! (Points inside of a solid wall are different: who counts them as places to be must not use what
//! was added.)
//!
//! # What bounds the loss
//!
//! The box of a large cluster, say a terrain, would take all axial walls that are joined to it. A
//! unit takes at most [`LOSS_MAX`] times its own area of polygons that are not its own, and more
//! than [`FREE_LOSS_M2`] only where what closes the hole, and is sealed, makes up for it: so carving
//! does not cost more occluders than it gives. Where a cluster would take more, its elements are the
//! units; where one of these would, nothing but the unit's own polygons is cut, and nothing added.
//! What is left is axial all the same.

mod bin_a;
mod classify;
mod polygons;
mod sealing;
mod topology;
mod turn;
mod volume;

use std::ops::ControlFlow;

use glam::DVec3;
use serde::Serialize;

pub use classify::Class;
pub use turn::dominant_orientation;

use classify::{Groups, classes};
use polygons::Polygons;
use volume::{Carver, Carving};

/// A carving unit takes at most this times its own area of polygons that are not its own.
pub const LOSS_MAX: f64 = 2.0;
/// A carving unit may take this much of others whatever is added, in square metres.
pub const FREE_LOSS_M2: f64 = 1.0;
/// The share of the work that is done when triangles are merged to polygons, roughly.
const MERGED: f32 = 0.5;
/// The share that is done when carving units are known.
const GROUPED: f32 = 0.7;

/// What the author chooses.
#[derive(Clone, Copy, Debug, Default)]
pub struct CarveOptions {
    /// What is carved at a time.
    pub units: CarvingUnits,
}

/// How large carving units are (carving, Fig. 6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CarvingUnits {
    /// As large as possible: fewer portals.
    #[default]
    Clusters,
    /// As small as possible: more portals, but smaller ones.
    Elements,
}

/// A model after carving. Coordinates are those of the triangles that were carved.
#[derive(Clone, Debug)]
pub struct CarvedModel {
    /// AoutB: what is left of the model's polygons; axial and semi-axial.
    pub polygons: Vec<Polygon>,
    /// BinA: what closes the holes; see [`CapPolygon::sealed`].
    pub added: Vec<CapPolygon>,
    /// AinB and AonB: what was in the boxes.
    pub cuttings: Vec<Polygon>,
    /// How many of what.
    pub report: CarveReport,
}

/// A polygon, or what was left of one.
#[derive(Clone, Debug)]
pub struct Polygon {
    /// Of a cutting: that of the polygon that it was a part of.
    pub class: Class,
    /// In which it lies.
    pub plane: Plane,
    /// What it covers. They overlap only where the model's did.
    pub triangles: Vec<[DVec3; 3]>,
    /// Of a cutting: which carving unit cut it off.
    pub unit: Option<u32>,
}

/// A polygon of a carving volume that lies inside of what was solid.
#[derive(Clone, Debug)]
pub struct CapPolygon {
    /// In which it lies; the normal points out of what is still solid, into the box.
    pub plane: Plane,
    /// What it covers, without overlap.
    pub triangles: Vec<[DVec3; 3]>,
    /// Which carving unit's hole it closes.
    pub unit: u32,
    /// Whether it certainly lies inside of a solid, and so may be an occluder.
    pub sealed: bool,
}

/// Points whose product with the normal is the distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Of unit length, towards the front. Of what is axial to within the tolerance, it is exactly
    /// an axis.
    pub normal: DVec3,
    /// From the origin along the normal, in metres.
    pub distance: f64,
}

impl Plane {
    /// The plane of a triangle; across an axis, or upright, exactly, when it is nearly so.
    fn through(triangle: &[DVec3; 3], normal: DVec3, near: f64) -> Self {
        let centre = triangle.iter().sum::<DVec3>() / 3.0;
        let [a, b, c] = *triangle;
        let size = a.max(b).max(c) - a.min(b).min(c);
        let n = normal.abs();
        let main = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        let mut normal = normal;
        if size[main] <= near && n[main] > 0.9 {
            normal = DVec3::AXES[main] * normal[main].signum();
        } else if n.y * size.y <= near && n.y < 0.01 {
            normal = normal.with_y(0.0).normalize_or_zero();
        }
        Self { normal, distance: normal.dot(centre) }
    }

    /// The axis that it is exactly across, if any.
    pub fn axis(&self) -> Option<usize> {
        (0..3).find(|&axis| self.normal[axis].abs() == 1.0)
    }

    /// How far before the plane a point is, in metres; negative behind.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }
}

/// How many of what.
#[derive(Clone, Debug, Serialize)]
pub struct CarveReport {
    /// Polygons of the model, merged.
    pub polygons: usize,
    /// Of these, axial.
    pub axial: usize,
    /// Of these, semi-axial.
    pub semi_axial: usize,
    /// Of these, non-axial.
    pub non_axial: usize,
    /// Of the non-axial, those connected by non-axial edges.
    pub elements: usize,
    /// Of the non-axial, those connected by any edges.
    pub clusters: usize,
    /// Boxes that were carved.
    pub units: usize,
    /// Of these, how many took the unit's own polygons only.
    pub confined: usize,
    /// Polygons in the cuttings.
    pub cuttings: usize,
    /// Polygons added to close holes.
    pub added: usize,
    /// Of these, certainly inside of a solid.
    pub sealed: usize,
    /// Polygons of the model of which nothing is left.
    pub removed: usize,
    /// Triangles without area, which were left out.
    pub degenerate: usize,
    /// The class of the model.
    pub before: Class,
    /// The class of the carved model.
    pub after: Class,
}

/// Carves a model: triangles whose front is where their corners run anticlockwise, with y up.
/// `surfaces` tells which surface each is of, or is empty: triangles of two surfaces do not merge.
///
/// Corners closer than 0.02 mm count as one. The time is nearly linear in the triangles.
pub fn carve(triangles: &[[DVec3; 3]], surfaces: &[u32], options: &CarveOptions) -> CarvedModel {
    carve_with_progress(triangles, surfaces, options, &mut |_| ControlFlow::Continue(()))
        .expect("nobody breaks it")
}

/// The same, with `progress` told the share done, from 0 to 1. None when it breaks.
pub fn carve_with_progress(
    triangles: &[[DVec3; 3]],
    surfaces: &[u32],
    options: &CarveOptions,
    progress: &mut dyn FnMut(f32) -> ControlFlow<()>,
) -> Option<CarvedModel> {
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
    let Carving { kept, cuttings, added, .. } = carving;
    Some(CarvedModel { polygons: kept, added, cuttings, report })
}

/// Carves a unit as a whole if that does not cost others too much, else element by element.
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

fn report(
    polygons: &Polygons,
    classes: &[Class],
    groups: &Groups,
    carving: &Carving,
) -> CarveReport {
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
        added: carving.added.len(),
        sealed: carving.added.iter().filter(|added| added.sealed).count(),
        removed: polygons.len() - carving.kept.len(),
        degenerate: polygons.degenerate.len(),
        before: worst(&mut classes.iter().copied()),
        after: worst(&mut carving.kept.iter().map(|polygon| polygon.class)),
    }
}

#[cfg(test)]
mod tests;
