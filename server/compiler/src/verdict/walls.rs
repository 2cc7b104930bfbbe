//! Which walls hide people, and why others do not.
//!
//! A wall hides people where its two sides are not open to each other: one of them is solid, or
//! they are two spaces and no gate is there.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use sightline_world::World;

use super::shown;
use crate::model::Model;

/// A surface is a wall when its normal rises by less than this.
const STEEP: f32 = 0.7;
/// A wall is tilted when its normal rises by more than this.
const TILTED: f32 = 0.01;
/// Sides are looked at this far from a wall, in metres.
const BESIDE_M: f32 = 0.005;
/// A gate reaches this far beside its edge, in metres.
const BESIDE_GATE_M: f32 = 0.02;
/// A triangle that hides nobody is too small below this, in square metres.
const SMALL_M2: f32 = 0.5;
/// Walls are round when they face at least this many directions, about 10 degrees apart.
const ROUND_DIRECTIONS: usize = 6;
/// The cosine of the angle up to which a wall follows the building's own axes.
const ALONG_AXES: f32 = 0.999;

/// Why walls hide nobody.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// They are neither upright nor level.
    Tilted,
    /// Their outline is not along the axes, and they enclose nothing that could stand for them.
    NotClosed,
    /// They are made of small pieces.
    TooSmall,
    /// They are upright, made of small pieces, and face many directions.
    Round,
    /// They let light through.
    Transparent,
}

/// Walls that hide nobody for one reason.
#[derive(Clone, Debug, Serialize)]
pub struct Idle {
    /// The reason.
    pub reason: Reason,
    /// Their area, in square metres, each side counted.
    pub area_m2: f32,
    /// The middle of the largest triangle, in metres.
    pub near: Vec3,
}

/// An upright triangle on a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallMark {
    /// The corners, in metres.
    pub corners: [Vec3; 3],
    /// Whether it hides people.
    pub hides: bool,
}

/// All walls by what they do.
#[derive(Clone, Debug)]
pub struct WallSides {
    /// The area of walls that hide people, in square metres.
    pub hiding_m2: f32,
    /// Walls that hide nobody, by reason.
    pub idle: Vec<Idle>,
    /// The opaque walls.
    pub marks: Vec<WallMark>,
}

impl Idle {
    /// What it says, and what to do.
    pub(super) fn sentence(&self) -> String {
        let (why, advice) = match self.reason {
            Reason::Tilted => ("tilted", "put a box named occluder:NAME inside them"),
            Reason::NotClosed => (
                "of odd outline and not closed",
                "close the mesh, or put a box named occluder:NAME inside them",
            ),
            Reason::TooSmall => {
                ("in small pieces", "this is usual for furniture; name walls occluder:NAME")
            }
            Reason::Round => ("round", "put boxes named occluder:NAME inside them"),
            Reason::Transparent => {
                ("transparent", "make their material opaque if that is not meant")
            }
        };
        let (area, near) = (self.area_m2, shown(self.near));
        format!("{area:.0} m2 of wall hide nobody, because they are {why} (near {near}): {advice}")
    }
}

/// Judges all walls of a model.
pub(super) fn judged(model: &Model, world: &World) -> WallSides {
    let marks: Vec<WallMark> = model
        .opaque
        .par_iter()
        .filter(|corners| normal(corners).is_some_and(|normal| normal.y.abs() < STEEP))
        .map(|&corners| WallMark { corners, hides: hides(&corners, world) })
        .collect();
    let hiding_m2 = marks.iter().filter(|mark| mark.hides).map(|mark| area(&mark.corners)).sum();
    let is_round = faces_many_directions(&marks, world);
    let reason = |corners: &[Vec3; 3]| {
        let normal = normal(corners).unwrap_or(Vec3::X);
        let is_along = (0..3).any(|axis| world.cells.axes.own(normal)[axis].abs() > ALONG_AXES);
        if normal.y.abs() > TILTED {
            Reason::Tilted
        } else if is_round && !is_along {
            Reason::Round
        } else if area(corners) < SMALL_M2 {
            Reason::TooSmall
        } else {
            Reason::NotClosed
        }
    };
    let glass = model.surfaces.iter().filter(|surface| surface.material.glass);
    let glass = glass.filter(|surface| !surface.material.is_unseen());
    let glass = glass.flat_map(|surface| surface.corners());
    let glass = glass.filter(|corners| normal(corners).is_some_and(|n| n.y.abs() < STEEP));
    let idle = marks.iter().filter(|mark| !mark.hides).map(|mark| mark.corners);
    let with_reason = idle.map(|corners| (reason(&corners), corners));
    let all = with_reason.chain(glass.map(|corners| (Reason::Transparent, corners)));
    let mut found: Vec<(Idle, f32)> = Vec::new();
    for (reason, corners) in all {
        let (area, near) = (area(&corners), corners.iter().sum::<Vec3>() / 3.0);
        match found.iter_mut().find(|(idle, _)| idle.reason == reason) {
            Some((idle, largest)) => {
                idle.area_m2 += area;
                if area > *largest {
                    (idle.near, *largest) = (near, area);
                }
            }
            None => found.push((Idle { reason, area_m2: area, near }, area)),
        }
    }
    let mut idle: Vec<Idle> = found.into_iter().map(|(idle, _)| idle).collect();
    idle.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    WallSides { hiding_m2, idle, marks }
}

/// Whether upright walls that hide nobody are round: they face many directions off the axes.
fn faces_many_directions(marks: &[WallMark], world: &World) -> bool {
    let idle = marks.iter().filter(|mark| !mark.hides);
    let facing = idle.filter_map(|mark| normal(&mark.corners));
    let upright = facing.filter(|normal| normal.y.abs() <= TILTED);
    let own = upright.map(|normal| world.cells.axes.own(normal));
    let mut directions: Vec<i32> = own
        .filter(|own| own.x.abs().max(own.z.abs()) <= ALONG_AXES)
        .map(|own| (own.z.atan2(own.x).to_degrees() / 10.0).round() as i32)
        .collect();
    directions.sort_unstable();
    directions.dedup();
    directions.len() >= ROUND_DIRECTIONS
}

/// Whether most of a few points of a triangle hide what is behind them.
fn hides(corners: &[Vec3; 3], world: &World) -> bool {
    let centre = corners.iter().sum::<Vec3>() / 3.0;
    let Some(normal) = normal(corners) else { return false };
    let points = [centre, centre, corners[0], corners[1], corners[2]].map(|at| centre.midpoint(at));
    points.iter().filter(|point| hides_at(**point, normal, world)).count() > points.len() / 2
}

fn hides_at(point: Vec3, normal: Vec3, world: &World) -> bool {
    let cells = &world.cells;
    let [Some(before), Some(behind)] =
        [1.0, -1.0].map(|side| cells.at(point + normal * (side * BESIDE_M)))
    else {
        return true;
    };
    let [before, behind] = [before, behind].map(|cell| cells.cells[cell.0 as usize].space);
    let own = cells.axes.own(point);
    let is_open = |&gate: &u32| {
        let gate = &cells.gates[gate as usize];
        gate.spaces.contains(&behind) && gate.polygon.bounds().grown(BESIDE_GATE_M).contains(own)
    };
    before != behind && !cells.spaces[before as usize].gates.iter().any(is_open)
}

fn normal(corners: &[Vec3; 3]) -> Option<Vec3> {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()
}

fn area(corners: &[Vec3; 3]) -> f32 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() / 2.0
}
