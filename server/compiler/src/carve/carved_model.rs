//! What carving makes of a model.

use glam::DVec3;
use serde::Serialize;

use super::plane::Plane;

/// How generally a polygon, or a model, lies (carving, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// Its normal and all its edges are parallel to axes: a union of rectangles. Of a model: it has
    /// no others.
    Axial,
    /// It stands upright at any angle and its edges are level or upright, or it is level and its
    /// edges are parallel to two directions at a right angle. Of a model: it has none that is
    /// non-axial, but some that is not axial.
    SemiAxial,
    /// Anything else. Of a model: it has some that is.
    NonAxial,
}

/// A model after carving. Coordinates are those of the triangles that were carved.
#[derive(Clone, Debug)]
pub struct CarvedModel {
    /// AoutB: what is left of the model's polygons; axial and semi-axial.
    pub polygons: Vec<Polygon>,
    /// BinA: what closes the holes; see [`CapPolygon::sealed`].
    pub caps: Vec<CapPolygon>,
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
