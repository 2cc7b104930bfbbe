//! Tolerances: how much a live client may leave unsaid.

use std::time::Duration;

use sightline_world::motion::Tolerance;

use super::Silencing;
use crate::{
    acuity::Acuity, messages::Output, population::Avatar, slot::Slot, tick_context::TickContext,
};

/// A coarser tolerance is ordered no sooner after the last order than this.
const COARSEN_AFTER: Duration = Duration::from_secs(1);
/// The time ahead is rounded up to a multiple of this.
const AHEAD_STEP: Duration = Duration::from_millis(25);
/// A client needs a new order when the time ahead that it should have exceeds the ordered one by
/// more than the ordered one divided by this number.
const AHEAD_PARTS: u32 = 4;

impl Silencing<'_> {
    /// Orders a client to be live with the tolerance that suits its avatar. The caller sends the
    /// order.
    pub(super) fn order_live(&mut self, slot: Slot) -> Output {
        let avatar = self.population.at_mut(slot);
        let tolerance = wanted(self.context, avatar);
        if avatar.is_guest() {
            avatar.orders.send_ask(tolerance);
        } else {
            avatar.orders.send_live(tolerance);
        }
        avatar.ordered_at = self.context.now;
        Output::Live { to: avatar.id, tolerance }
    }

    /// Whether a live client needs another order: a finer tolerance at once, a coarser one before
    /// long.
    pub(super) fn needs_order(&self, slot: Slot) -> bool {
        let TickContext { config, now, .. } = self.context;
        let avatar = self.population.at(slot);
        if avatar.orders.is_quiet() {
            return true;
        }
        if !config.reports_by_exception() {
            return false;
        }
        let (told, wanted) = (avatar.orders.told(), wanted(self.context, avatar));
        if told.is_none() {
            return true;
        }
        let is_too_coarse = told.metres > wanted.metres || told.radians > wanted.radians;
        // Other stations know how far ahead this one looks.
        let is_too_short =
            !avatar.is_guest() && told.ahead + told.ahead / AHEAD_PARTS < wanted.ahead;
        let is_too_fine = told.metres < wanted.metres || told.radians < wanted.radians;
        is_too_coarse || is_too_short || is_too_fine && now >= avatar.ordered_at + COARSEN_AFTER
    }
}

/// The tolerance that suits an avatar: what the nearest viewer that holds it can hardly tell, and
/// what decides closely enough who sees whom.
fn wanted(context: TickContext<'_>, avatar: &Avatar) -> Tolerance {
    let TickContext { building, config, horizons, .. } = context;
    if !config.reports_by_exception() {
        return Tolerance::NONE;
    }
    let world = &building.world;
    let is_seen = avatar.nearest_m.is_finite();
    let mut acuity = Acuity::unseen(world);
    if is_seen {
        acuity = Acuity::at(world, avatar.nearest_m).stepped(world);
    }
    if is_seen || avatar.pairs.iter().any(|pair| pair.is_held) {
        acuity = acuity.in_sight(world);
    }
    if let Some(abroad) = avatar.asked_abroad() {
        acuity.metres = acuity.metres.min(abroad.metres);
        acuity.radians = acuity.radians.min(abroad.radians);
    }
    let horizon = horizons.course_horizon(avatar.link());
    let steps = horizon.as_nanos().div_ceil(AHEAD_STEP.as_nanos());
    let ahead = AHEAD_STEP * u32::try_from(steps).unwrap_or(u32::MAX);
    Tolerance { metres: whole_millimetres(acuity.metres), radians: acuity.radians, ahead }
}

/// A length as clients are told it.
fn whole_millimetres(metres: f32) -> f32 {
    (metres * 1_000.0).floor() / 1_000.0
}
