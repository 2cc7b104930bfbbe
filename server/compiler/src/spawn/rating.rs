//! How well a place suits as the beginning of a visit, judged by rays to what is drawn.
//!
//! A building tells its rooms from its voids, plenums and roofs by what can be seen there: rooms
//! have roofs and walls, which show their fronts; many have furniture and a view out; and an attic
//! is above a room. Nothing here decides alone, because models have flipped triangles, missing
//! roofs and skies that are boxes.

use std::collections::HashSet;

use glam::{Quat, Vec3};
use sightline_oracle::{Hit, Oracle};
use sightline_world::Mesh;

use crate::model::{Model, Surface};

/// How many level directions are looked in.
pub(super) const DIRECTIONS: usize = 32;
/// What is nearer than the first encloses a place, in metres. What is farther than the second does
/// not: it may be a sky.
const ENCLOSING_M: [f32; 2] = [10.0, 30.0];
/// A room is at least this high, in metres. Plenums and crawl spaces often are lower.
const ROOM_HEIGHT_M: f32 = 2.0;
/// Rays end this far behind a pane before they go on, in metres.
const BEHIND_PANE_M: f32 = 0.02;
/// The most panes that a ray goes through.
const PANES_MAX: usize = 8;

/// What is drawn, for rays.
pub(super) struct Sight {
    oracle: Oracle,
    /// The triangles from here on let sight through.
    first_glass: u32,
}

/// What surrounds a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surroundings {
    /// How much the place has walls around it, from 0 to 1.
    pub(super) walled: f32,
    /// How much it has a roof, from 0 to 1.
    pub(super) roofed: f32,
    /// The share of the rays that meet something opaque which meet its back.
    pub(super) backs: f32,
    /// Whether some ray meets nothing opaque.
    pub(super) sees_out: bool,
    /// How many different triangles the rays meet.
    pub(super) triangles: usize,
}

impl Sight {
    pub(super) fn new(model: &Model) -> Self {
        let (glass, opaque): (Vec<&Surface>, Vec<&Surface>) =
            model.surfaces.iter().partition(|surface| surface.material.glass);
        let mut mesh = Mesh::default();
        let mut first_glass = 0;
        for (surfaces, are_opaque) in [(opaque, true), (glass, false)] {
            for surface in surfaces {
                let first = mesh.positions.len() as u32;
                mesh.positions.extend_from_slice(&surface.positions);
                mesh.triangles.extend(surface.triangles.iter().map(|t| t.map(|i| first + i)));
            }
            if are_opaque {
                first_glass = mesh.triangles.len() as u32;
            }
        }
        Self { oracle: Oracle::new(&mesh), first_glass }
    }

    /// How far one sees along a direction of unit length, through panes, in metres. `None` when
    /// nothing opaque is there.
    pub(super) fn distance(&self, eye: Vec3, along: Vec3) -> Option<f32> {
        self.opaque_hit(eye, along).map(|hit| hit.distance)
    }

    /// How far away the first thing is along a direction of unit length, panes included, in metres.
    pub(super) fn room_ahead(&self, eye: Vec3, along: Vec3) -> f32 {
        self.oracle.distance(eye, along).unwrap_or(f32::INFINITY)
    }

    fn opaque_hit(&self, eye: Vec3, along: Vec3) -> Option<Hit> {
        let mut gone = 0.0;
        for _ in 0..PANES_MAX {
            let hit = self.oracle.first_hit(eye + along * gone, along)?;
            let distance = gone + hit.distance;
            if hit.triangle < self.first_glass {
                return Some(Hit { distance, ..hit });
            }
            gone = distance + BEHIND_PANE_M;
        }
        None
    }

    /// Looks around from an eye: level, aslant upwards, and at the floor.
    pub(super) fn surroundings(&self, eye: Vec3) -> Surroundings {
        let look = |along| self.opaque_hit(eye, along);
        let level: Vec<_> = (0..DIRECTIONS).step_by(2).map(|i| look(direction(i))).collect();
        let aslant = |i| look((direction(i) + Vec3::Y).normalize());
        let upwards: Vec<_> =
            (0..DIRECTIONS).step_by(4).map(aslant).chain([look(Vec3::Y)]).collect();
        let enclosing = |hits: &[Option<Hit>]| {
            let near = hits.iter().map(|hit| hit.map_or(0.0, |hit| nearness(hit.distance)));
            near.sum::<f32>() / hits.len() as f32
        };
        let floor = look(Vec3::NEG_Y);
        let met: Vec<&Hit> = level.iter().chain(&upwards).chain([&floor]).flatten().collect();
        let backs = met.iter().filter(|hit| !hit.is_front).count();
        let triangles: HashSet<u32> = met.iter().map(|hit| hit.triangle).collect();
        Surroundings {
            walled: enclosing(&level),
            roofed: enclosing(&upwards),
            backs: backs as f32 / met.len().max(1) as f32,
            sees_out: level.iter().chain(&upwards).any(Option::is_none),
            triangles: triangles.len(),
        }
    }
}

/// How much something at a distance encloses a place, from 0 to 1.
fn nearness(distance: f32) -> f32 {
    let [near, far] = ENCLOSING_M;
    ((far - distance) / (far - near)).clamp(0.0, 1.0)
}

/// How well a place suits, from 0 to 1. `level` is the share of the floor around it that is on its
/// level, and `is_upper` tells that somebody can stand below it too.
pub(super) fn merit(around: &Surroundings, headroom: f32, level: f32, is_upper: bool) -> f32 {
    let Surroundings { walled, roofed, backs, .. } = *around;
    // Rooms have both, streets and yards have walls, and below a building on stilts there is a
    // roof.
    let sheltered = 0.02 + 0.48 * walled + 0.5 * roofed * walled.sqrt();
    let is_on_roof = is_upper && nearness(headroom) == 0.0;
    let below_sky = if is_on_roof { 0.1 } else { 1.0 };
    let high = if headroom >= ROOM_HEIGHT_M { 1.0 } else { 0.3 };
    // Inside of what is solid one sees backs only.
    let faced = ((0.8 - backs) / 0.4).clamp(0.05, 1.0);
    // Domes and hillsides can be climbed, but nobody stands there.
    sheltered * below_sky * high * faced * (0.2 + 0.8 * level)
}

/// One of [`DIRECTIONS`] level directions of unit length, anticlockwise seen from above.
pub(super) fn direction(index: usize) -> Vec3 {
    Quat::from_rotation_y(yaw(index)) * Vec3::NEG_Z
}

/// The heading of a direction, as in `Pose::yaw`.
pub(super) fn yaw(index: usize) -> f32 {
    let turn = (index % DIRECTIONS) as f32 / DIRECTIONS as f32 * std::f32::consts::TAU;
    if turn > std::f32::consts::PI { turn - std::f32::consts::TAU } else { turn }
}
