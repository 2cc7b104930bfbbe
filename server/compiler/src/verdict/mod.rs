//! The verdict on a compiled world, in plain words: how much walls hide, which of them hide nobody
//! and why, and what was probably not meant.
//!
//! * `walls`: which walls hide people, and the reason why others do not.
//! * `places`: which standing places see each other, and what no opening leads to.
//! * `doors`: doors that stand closed.

mod doors;
mod places;
#[cfg(test)]
mod tests;
mod walls;

use glam::Vec3;
use serde::Serialize;
use sightline_world::World;

use crate::model::Model;
use places::Places;
pub use walls::{Idle, Reason, WallMark, WallSides};

/// Less than this is not worth a sentence, in square metres.
const WORTH_A_WORD_M2: f32 = 2.0;

/// What a compiled world is like.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// The share of pairs of standing places that see each other, from 0 to 1. None when there are
    /// fewer than two places.
    pub seen_share: Option<f64>,
    /// The area of walls that hide people, in square metres, each side of a wall counted.
    pub hiding_m2: f32,
    /// Walls that hide nobody, by reason.
    pub idle: Vec<Idle>,
    /// Closed places in which one could stand, but which no opening leads to: a point of each, and
    /// its floor in square metres. The largest come first.
    pub unreachable: Vec<(Vec3, f32)>,
    /// Nodes that are named doors and fill an opening.
    pub closed_doors: Vec<String>,
    /// The share of what is below a roof that has no floor, from 0 to 1.
    pub floorless_share: f32,
    /// The walls, to be drawn on a plan.
    #[serde(skip)]
    pub walls: Vec<WallMark>,
}

impl Verdict {
    /// Judges a world that was compiled from a model.
    pub fn new(model: &Model, world: &World) -> Self {
        let sides = walls::judged(model, world);
        let places = Places::find(world);
        let verdict = Self {
            seen_share: places.seen_share(world),
            hiding_m2: sides.hiding_m2,
            idle: sides.idle,
            unreachable: places.unreachable(world),
            closed_doors: doors::closed(model, world),
            floorless_share: places.floorless_share,
            walls: sides.marks,
        };
        assert!(verdict.seen_share.is_none_or(|share| (0.0..=1.0).contains(&share)));
        verdict
    }

    /// The verdict in sentences, one line each.
    pub fn sentences(&self) -> Vec<String> {
        let mut said = Vec::new();
        if let Some(share) = self.seen_share {
            let judged = match share {
                ..0.3 => "walls hide most people from each other",
                ..0.7 => "walls hide some people from each other",
                _ => "walls hide hardly anybody",
            };
            let percent = share * 100.0;
            said.push(format!(
                "{percent:.0} % of pairs of standing places see each other: {judged}"
            ));
        }
        if self.hiding_m2 >= WORTH_A_WORD_M2 {
            said.push(format!("{:.0} m2 of wall hide people", self.hiding_m2));
        }
        let told = self.idle.iter().filter(|idle| idle.area_m2 >= WORTH_A_WORD_M2);
        said.extend(told.map(Idle::sentence));
        if let Some((at, _)) = self.unreachable.first() {
            let floor: f32 = self.unreachable.iter().map(|(_, floor)| floor).sum();
            said.push(format!(
                "{} closed places of {floor:.0} m2 have no opening, the largest near {}: if they \
                 are rooms, open their doors with --open-doors PATTERN",
                self.unreachable.len(),
                shown(*at)
            ));
        }
        if let Some(first) = self.closed_doors.first() {
            said.push(format!(
                "{} doors stand closed, such as {first:?}: --open-doors {first:?} takes it for open",
                self.closed_doors.len()
            ));
        }
        if self.floorless_share > places::FLOORLESS_MIN {
            said.push(format!(
                "{:.0} % of what is below a roof has no floor: a slab may be missing in the model",
                self.floorless_share * 100.0
            ));
        }
        said
    }
}

/// A point as a person types it.
fn shown(at: Vec3) -> String {
    format!("{:.1},{:.1},{:.1}", at.x, at.y, at.z)
}
