//! Silence: which avatars are hidden, and for how long.
//!
//! Avatars [settle] into a TBV that a [search] finds, until it [expires](expiry) or
//! is [revealed](reveal).

mod expiry;
mod expiry_queue;
mod guests;
mod reveal;
mod search;
mod settle;
mod tolerance;

use std::time::Duration;

use sightline_world::{
    motion::{AvatarId, ReportingState, Tbv},
    tolerance::WIRE_POSE_M,
};

use crate::{
    config::Validity,
    messages::Output,
    population::Population,
    regions::{BoxTest, FootprintCover, HiddenFootprint, Indices, Motion},
    slot::{Member, Slot},
    stats::Stats,
    tick_context::TickContext,
    worker_pool::Workspace,
};

pub(crate) use expiry::Deadlines;
pub(crate) use search::VALIDITY_FIRST;

/// How sight tests for silences are shared out over ticks.
#[derive(Clone, Debug)]
pub(crate) struct SilenceBudget {
    /// What is left of this tick's [`Config::silence_budget`](crate::Config::silence_budget).
    pub(crate) left: u32,
    /// The avatar at whom the budget ran out.
    turn: AvatarId,
}

impl Default for SilenceBudget {
    fn default() -> Self {
        Self { left: 0, turn: AvatarId(0) }
    }
}

/// What changes when avatars are silenced, asked and woken.
pub(crate) struct Silencing<'a> {
    pub(crate) context: TickContext<'a>,
    pub(crate) population: &'a mut Population,
    pub(crate) indices: &'a mut Indices,
    pub(crate) deadlines: &'a mut Deadlines,
    pub(crate) workspace: &'a mut Workspace,
    pub(crate) budget: &'a mut SilenceBudget,
    pub(crate) stats: &'a mut Stats,
    /// Outputs for the next tick.
    pub(crate) pending: &'a mut Vec<Output>,
}

/// What ended a TBV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Expired,
    Revealed,
}

impl Silencing<'_> {
    /// From quiet to asked. The caller sends the order itself.
    fn ask(&mut self, slot: Slot, end: End) {
        let TickContext { config, now, rounds, .. } = self.context;
        let avatar = self.population.at_mut(slot);
        avatar.validity = match (config.validity, end) {
            (Validity::Adaptive, End::Expired) => avatar.validity * 3 / 2,
            (Validity::Adaptive, End::Revealed) => avatar.validity / 2,
            // The next search begins with what would have lasted.
            (Validity::Maximal, End::Revealed) => now.saturating_sub(avatar.hidden_from),
            _ => avatar.validity,
        };
        (avatar.unanswered, avatar.asked_round) = (1, rounds);
        let (id, trip) = (avatar.id, avatar.round_trip);
        self.deadlines.expiries.cancel(id);
        if !self.population.at(slot).is_guest() {
            self.deadlines.wait(now, id, trip + config.ask_timeout);
        }
        self.population.set_asked(slot);
    }

    /// From hidden to live, after fresh word of the avatar. The next tick decides whether it stays
    /// live.
    pub(crate) fn wake(&mut self, slot: Slot) {
        let TickContext { now, .. } = self.context;
        let avatar = self.population.at_mut(slot);
        let member = Member { id: avatar.id, slot };
        avatar.silence_again_at = now;
        self.indices.hidden.remove(member, &avatar.footprint.sectors);
        avatar.footprint = HiddenFootprint::default();
        avatar.footprint_version.advance();
        avatar.prevented = None;
        self.deadlines.expiries.cancel(member.id);
        self.population.set_live(slot);
        if !self.population.at(slot).is_guest() {
            let patience = self.population.at(slot).patience(self.context);
            self.deadlines.wait(now, member.id, patience);
        }
    }

    /// Takes in an unasked report of a quiet client. If the avatar is about to leave, or would be
    /// asked at the next tick, it becomes live. Otherwise nothing changes: when the client reported
    /// it had not heard yet that it was quiet.
    pub(crate) fn hear_quiet(&mut self, slot: Slot, tbv: &Tbv) {
        let TickContext { building, config, horizons, now, .. } = self.context;
        let avatar = self.population.at(slot);
        debug_assert_eq!(avatar.state, ReportingState::Quiet, "only quiet clients owe nothing");
        let lead_time = horizons.lead_time(avatar.link());
        // The client knows a region that is a little smaller, by rounding.
        let stays = tbv.grown(-WIRE_POSE_M).holds(&avatar.pose, config.tick, &building.agility);
        if !stays || now + lead_time + config.tick >= tbv.expiry {
            self.wake(slot);
        }
    }

    /// When a live avatar was last known to be where its motion begins.
    fn known_at(&self, motion: &Motion) -> Duration {
        self.context.now.saturating_sub(motion.age)
    }

    /// The part of a live avatar's footprint that is possible at this tick.
    fn current_footprint(&self, slot: Slot) -> HiddenFootprint {
        let avatar = self.population.at(slot);
        avatar.footprint.clipped(self.context.building, &avatar.reveal_box)
    }

    /// Whether a line between a footprint and where another avatar can be now may be free, either
    /// way.
    fn may_see_each_other(&mut self, one: &HiddenFootprint, other: Slot) -> bool {
        let Self { context, population, workspace, budget, .. } = self;
        let other = population.at(other);
        let clip = || other.footprint.cover.clipped(context.building, &other.reveal_box);
        let current = other.is_live().then(clip);
        let cover = current.as_ref().unwrap_or(&other.footprint.cover);
        lets_see(*context, workspace, budget, one, Reached { footprint: &other.footprint, cover })
    }
}

/// A footprint, and the part of its cover that counts.
#[derive(Clone, Copy)]
struct Reached<'a> {
    footprint: &'a HiddenFootprint,
    cover: &'a FootprintCover,
}

/// The most that a sight test between two footprints costs, in the units of
/// [`Config::silence_budget`](crate::Config::silence_budget). With ten times as much for each,
/// fewer avatars get their turn.
const TEST_MAX: u32 = 600;

/// Whether a line between two footprints may be free, either way. Without a budget it may.
fn lets_see(
    context: TickContext<'_>,
    workspace: &mut Workspace,
    budget: &mut SilenceBudget,
    one: &HiddenFootprint,
    other: Reached<'_>,
) -> bool {
    let building = context.building;
    let mut may_see = |eyes, bodies| {
        let (sight, left) = (&mut workspace.sight, &mut budget.left);
        let test = sight.test_up_to(&building.occluders, eyes, bodies, TEST_MAX, left);
        !matches!(test, BoxTest::Hidden)
    };
    let rooms = &building.rooms;
    one.rooms_allow(other.footprint, rooms) && may_see(&one.cover.eyes, &other.cover.bodies)
        || other.footprint.rooms_allow(one, rooms) && may_see(&other.cover.eyes, &one.cover.bodies)
}
