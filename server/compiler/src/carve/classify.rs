//! Axial, semi-axial, non-axial: polygons, and the elements and clusters of those that are not
//! (carving, sections 3 and 4.1).

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;
use serde::Serialize;

use super::{
    Plane,
    polygons::{Border, Polygons},
};

/// A quarter of a degree: edges of a horizontal polygon that differ by less run the same way.
const SAME_DIRECTION: f64 = FRAC_PI_2 / 360.0;
/// The normal of what stands upright rises by less than this.
const UPRIGHT: f64 = 1e-6;

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

/// How a polygon's plane lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facing {
    /// Across an axis.
    Axis(usize),
    /// Upright, but across no axis.
    Upright,
    Oblique,
}

impl Facing {
    pub fn of(plane: &Plane) -> Self {
        match plane.axis() {
            Some(axis) => Self::Axis(axis),
            None if plane.normal.y.abs() < UPRIGHT => Self::Upright,
            None => Self::Oblique,
        }
    }
}

/// Whether an edge is such as a rectangle in this plane could have whose sides are parallel to
/// axes or, upright, to the floor and to the vertical. All others are what the paper calls
/// non-axial edges; it counts the level edges of turned walls with them, but these would make the
/// carving volume of an arch in such a wall as large as the wall.
pub(super) fn is_regular(facing: Facing, along: DVec3, weld: f64) -> bool {
    let a = along.abs();
    let stray = match facing {
        Facing::Axis(0) => a.y.min(a.z),
        Facing::Axis(1) => a.x.min(a.z),
        Facing::Axis(_) => a.x.min(a.y),
        Facing::Upright => a.y.min(a.x.hypot(a.z)),
        Facing::Oblique => a.y.hypot(a.z).min(a.x.hypot(a.z)).min(a.x.hypot(a.y)),
    };
    // Of the short parts into which corners split a slanted edge, none strays far.
    stray <= weld * 2.0 && (stray <= along.length() * 0.02 || along.length() <= weld * 10.0)
}

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
        // The longer the edge, the less rounding turns it.
        let stray = off.min(FRAC_PI_2 - off) * along.length();
        if off.min(FRAC_PI_2 - off) > SAME_DIRECTION || stray > weld * 10.0 {
            return false;
        }
    }
    true
}

/// Non-axial polygons by what connects them (carving, section 4.1, Fig. 5).
pub(super) struct Groups {
    /// The polygons of each element: connected by non-axial edges.
    pub elements: Vec<Vec<u32>>,
    /// The polygons of each cluster: connected by any edges.
    pub clusters: Vec<Vec<u32>>,
}

impl Groups {
    /// For each of so many polygons, its element; `u32::MAX` of one that is in none.
    pub fn element_of(&self, polygons: usize) -> Vec<u32> {
        let mut element_of = vec![u32::MAX; polygons];
        for (index, element) in (0..).zip(&self.elements) {
            element.iter().for_each(|&polygon| element_of[polygon as usize] = index);
        }
        element_of
    }

    pub fn of(polygons: &Polygons, classes: &[Class]) -> Self {
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

/// Which things are connected.
pub(super) struct Union {
    parent: Vec<u32>,
}

impl Union {
    pub fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect() }
    }

    pub fn root(&mut self, mut of: u32) -> u32 {
        while self.parent[of as usize] != of {
            let above = self.parent[self.parent[of as usize] as usize];
            self.parent[of as usize] = above;
            of = above;
        }
        of
    }

    /// The least of what is connected is its root, so that the order of joining does not matter.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    fn groups(mut self, members: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
        let mut index_of = std::collections::HashMap::new();
        let mut groups: Vec<Vec<u32>> = Vec::new();
        for member in members {
            let index = *index_of.entry(self.root(member)).or_insert_with(|| {
                groups.push(Vec::new());
                groups.len() - 1
            });
            groups[index].push(member);
        }
        groups
    }
}
