//! The classes of polygons, and the elements and clusters of non-axial ones (Lei and Ouhyoung 1999,
//! sections 3 and 4.1).

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;

use super::{
    carved_model::Class,
    plane::{Facing, is_regular},
    polygons::{Border, Polygons},
    union::Union,
};

/// Edges of a level polygon that differ by less than this run the same way: a quarter of a degree.
const SAME_DIRECTION: f64 = FRAC_PI_2 / 360.0;

/// The class of every polygon.
pub(super) fn classes(polygons: &Polygons) -> Vec<Class> {
    (0..polygons.len() as u32).map(|polygon| class(polygons, polygon)).collect()
}

fn class(polygons: &Polygons, polygon: u32) -> Class {
    let facing = polygons.facings[polygon as usize];
    let weld = polygons.tolerance.weld;
    let edges = || {
        polygons.borders_of(polygon).map(|border| {
            let [from, to] = polygons.segment(border);
            to - from
        })
    };
    if facing == Facing::Oblique {
        return Class::NonAxial;
    }
    let mut irregular = edges().filter(|&along| !is_regular(facing, along, weld)).peekable();
    match (facing, irregular.peek()) {
        (Facing::Axis(_), None) => Class::Axial,
        (_, None) => Class::SemiAxial,
        (Facing::Axis(1), Some(_)) if is_turned_rectangle(edges(), weld) => Class::SemiAxial,
        (_, Some(_)) => Class::NonAxial,
    }
}

/// Whether all edges of a level polygon run in two directions at a right angle.
fn is_turned_rectangle(edges: impl Iterator<Item = DVec3>, weld: f64) -> bool {
    let mut first: Option<f64> = None;
    for along in edges.filter(|along| along.length() > weld * 10.0) {
        let turn = along.z.atan2(along.x);
        let off = (turn - *first.get_or_insert(turn)).rem_euclid(FRAC_PI_2);
        // Rounding turns a long edge less than a short one.
        let stray = off.min(FRAC_PI_2 - off) * along.length();
        if off.min(FRAC_PI_2 - off) > SAME_DIRECTION || stray > weld * 10.0 {
            return false;
        }
    }
    true
}

/// Non-axial polygons in groups (Lei and Ouhyoung 1999, section 4.1, Fig. 5).
pub(super) struct Groups {
    /// The polygons of each element: connected by non-axial edges.
    pub elements: Vec<Vec<u32>>,
    /// The polygons of each cluster: connected by any edges.
    pub clusters: Vec<Vec<u32>>,
}

impl Groups {
    /// The element of each of `polygons` polygons; `u32::MAX` for a polygon in none.
    pub(super) fn element_of(&self, polygons: usize) -> Vec<u32> {
        let mut element_of = vec![u32::MAX; polygons];
        for (index, element) in (0..).zip(&self.elements) {
            element.iter().for_each(|&polygon| element_of[polygon as usize] = index);
        }
        element_of
    }

    pub(super) fn of(polygons: &Polygons, classes: &[Class]) -> Self {
        let is_non_axial = |polygon: u32| classes[polygon as usize] == Class::NonAxial;
        let (mut elements, mut clusters) = (Union::new(polygons.len()), Union::new(polygons.len()));
        for edge in polygons.edges() {
            let mut here = edge.iter().filter(|border| is_non_axial(border.polygon));
            let Some(first) = here.next() else { continue };
            let slanted = edge
                .iter()
                .any(|border| is_non_axial(border.polygon) && is_irregular(polygons, border));
            for border in here {
                clusters.join(first.polygon, border.polygon);
                if slanted {
                    elements.join(first.polygon, border.polygon);
                }
            }
        }
        let members =
            |union: Union| union.groups((0..classes.len() as u32).filter(|&p| is_non_axial(p)));
        Self { elements: members(elements), clusters: members(clusters) }
    }
}

/// Whether a border is a non-axial edge of its polygon.
pub(super) fn is_irregular(polygons: &Polygons, border: &Border) -> bool {
    let [from, to] = polygons.segment(border);
    !is_regular(polygons.facings[border.polygon as usize], to - from, polygons.tolerance.weld)
}
