//! What carving makes of a model.

use glam::DVec3;
use serde::Serialize;

use super::plane::Plane;

/// How a polygon, or a whole model, lies to the axes (Lei and Ouhyoung 1999, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// The normal and all edges are parallel to axes: a union of rectangles. An axial model has
    /// axial polygons only.
    Axial,
    /// The polygon is upright at any angle, with level or upright edges; or it is level, with edges
    /// in two directions at a right angle. A semi-axial model has no non-axial polygon.
    SemiAxial,
    /// Any other polygon. A non-axial model has at least one.
    NonAxial,
}

/// A model after carving. Coordinates are those of the triangles that were carved.
#[derive(Clone, Debug)]
pub struct CarvedModel {
    /// What is left of the polygons of the model: axial and semi-axial (AoutB in the paper).
    pub polygons: Vec<Polygon>,
    /// The polygons that close the holes (BinA in the paper); see [`CapPolygon::sealed`].
    pub caps: Vec<CapPolygon>,
    /// What was in the boxes (AinB and AonB in the paper).
    pub cuttings: Vec<Polygon>,
    /// Counts of polygons and units.
    pub report: CarveReport,
}

/// A polygon, or what is left of one.
#[derive(Clone, Debug)]
pub struct Polygon {
    /// The class. A cutting has the class of the polygon that it was part of.
    pub class: Class,
    /// The plane in which the polygon lies.
    pub plane: Plane,
    /// The triangles that it covers. They overlap only where those of the model did.
    pub triangles: Vec<[DVec3; 3]>,
    /// The carving unit that cut off a cutting.
    pub unit: Option<u32>,
}

/// A side of a carving volume that closes the hole in a solid.
#[derive(Clone, Debug)]
pub struct CapPolygon {
    /// The plane in which the cap lies. The normal points out of the solid, into the box.
    pub plane: Plane,
    /// The triangles that it covers, without overlap.
    pub triangles: Vec<[DVec3; 3]>,
    /// The carving unit whose hole it closes.
    pub unit: u32,
    /// Whether it certainly lies inside a solid, and so may be an occluder.
    pub sealed: bool,
}

/// Counts of polygons and units.
#[derive(Clone, Debug, Serialize)]
pub struct CarveReport {
    /// Polygons of the model, after merging.
    pub polygons: usize,
    /// Axial polygons of the model.
    pub axial: usize,
    /// Semi-axial polygons of the model.
    pub semi_axial: usize,
    /// Non-axial polygons of the model.
    pub non_axial: usize,
    /// Groups of non-axial polygons that share non-axial edges.
    pub elements: usize,
    /// Groups of non-axial polygons that share any edges.
    pub clusters: usize,
    /// Boxes that were carved.
    pub units: usize,
    /// Boxes that took only the polygons of their own unit.
    pub confined: usize,
    /// Polygons in the cuttings.
    pub cuttings: usize,
    /// Caps that were added to close holes.
    pub added: usize,
    /// Caps that certainly lie inside a solid.
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
