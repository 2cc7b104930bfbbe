//! Acuity: how far off its true pose an avatar may be shown, so that a viewer can hardly tell.

use sightline_world::{
    World,
    motion::{ACUITY_DISTANCES, Body},
};

/// The finest tolerance is this part of the half width of a body: 5 cm for a person.
const FINEST: f32 = 0.25;
/// A turn by the tolerance moves no part of a body farther than the tolerance of places. The
/// corners of a body are half again as far from its middle as its sides.
const CORNER: f32 = 1.5;

/// With more avatars than this around it, a viewer is in a crowd.
const CROWD: usize = 64;
/// What is nearer than this is shown as exactly in a crowd as elsewhere, in metres.
const CROWD_FROM_M: f32 = 10.0;
/// From this distance on the crowd counts in full, in metres.
const CROWD_FULL_M: f32 = 20.0;

/// By how much an avatar may be shown off its true pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Acuity {
    pub(crate) metres: f32,
    pub(crate) radians: f32,
}

impl Acuity {
    /// The acuity of a viewer at a distance in metres.
    pub(crate) fn at(world: &World, away_m: f32) -> Self {
        let (finest_m, coarsest_m) = (finest_m(&world.body), coarsest_m(&world.body));
        Self::of(&world.body, (away_m / ACUITY_DISTANCES).clamp(finest_m, coarsest_m))
    }

    /// The acuity of a viewer with a number of avatars around it, of one at a distance in metres.
    /// In a crowd, what is far away may be shown less exactly: its rate falls, and not that of what
    /// is near.
    pub(crate) fn in_crowd(world: &World, away_m: f32, avatars: usize) -> Self {
        let Self { metres, radians } = Self::at(world, away_m);
        let share = (away_m - CROWD_FROM_M) / (CROWD_FULL_M - CROWD_FROM_M);
        let most = (avatars as f32 / CROWD as f32).max(1.0).sqrt();
        let factor = 1.0 + share.clamp(0.0, 1.0) * (most - 1.0);
        Self { metres: metres * factor, radians: radians * factor }
    }

    /// The acuity where nobody sees the avatar.
    pub(crate) fn unseen(world: &World) -> Self {
        Self { metres: coarsest_m(&world.body), radians: std::f32::consts::PI }
    }

    /// The acuity with places as exact as sight tests need them of an avatar that is held or holds
    /// another. Regions grow by the tolerance.
    pub(crate) fn in_sight(self, world: &World) -> Self {
        Self { metres: self.metres.min(finest_m(&world.body)), ..self }
    }

    /// The acuity rounded down to one of a few steps, so that it changes seldom.
    pub(crate) fn stepped(self, world: &World) -> Self {
        let finest_m = finest_m(&world.body);
        let steps = (self.metres / finest_m).max(1.0).log2().mul_add(2.0, 1e-3).floor();
        let part = finest_m * (0.5 * steps).exp2() / self.metres;
        Self { metres: self.metres * part, radians: self.radians * part }
    }

    fn of(body: &Body, metres: f32) -> Self {
        Self { metres, radians: metres / (CORNER * body.half_width).max(0.01) }
    }
}

/// An eye that is no farther off its course is inside the body where the course leads, and so on
/// the same side of every wall. In metres.
fn coarsest_m(body: &Body) -> f32 {
    (0.9 * body.half_width).min(1.8 * body.above_eye).max(finest_m(body))
}

/// The finest tolerance, in metres.
fn finest_m(body: &Body) -> f32 {
    (FINEST * body.half_width).max(0.01)
}
