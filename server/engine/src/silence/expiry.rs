//! Deadlines: TBVs that expire, and clients that should have been heard of.

use std::time::Duration;

use sightline_world::motion::AvatarId;

use super::{End, Silencing, expiry_queue::ExpiryQueue};
use crate::{messages::Output, slot::Slot, tick_context::TickContext};

/// An ask counts as unanswered only if the engine has ticked so often since then. A host that ticks
/// less often is late, and may not have read the answer.
const ROUNDS_TO_ANSWER: u32 = 4;

/// When each client must be asked, or is looked into.
#[derive(Clone, Debug)]
pub(crate) struct Deadlines {
    /// When each quiet avatar must be asked.
    pub(crate) expiries: ExpiryQueue,
    /// When the silence of each other client is looked into.
    pub(crate) stalls: ExpiryQueue,
}

impl Deadlines {
    /// Deadlines that are looked at once a tick.
    pub(crate) fn new(tick: Duration) -> Self {
        Self { expiries: ExpiryQueue::new(tick), stalls: ExpiryQueue::new(tick) }
    }

    /// Sets when a client's silence is looked into.
    pub(crate) fn wait(&mut self, now: Duration, id: AvatarId, patience: Duration) {
        self.stalls.set(id, now, now + patience, usize::MAX);
    }

    /// Forgets both deadlines of a client.
    pub(crate) fn cancel(&mut self, id: AvatarId) {
        self.expiries.cancel(id);
        self.stalls.cancel(id);
    }
}

impl Silencing<'_> {
    /// Asks clients whose TBV would expire unwatched, and looks into stalled clients. Returns the
    /// clients that do not answer and must be dropped.
    pub(crate) fn expire(&mut self, outputs: &mut Vec<Output>) -> Vec<AvatarId> {
        let now = self.context.now;
        for id in self.deadlines.expiries.due(now) {
            if let Some(slot) = self.population.slot(id) {
                self.stats.expiries += 1;
                self.ask(slot, End::Expired);
                if self.population.at(slot).is_guest() {
                    outputs.push(self.order_live(slot));
                    continue;
                }
                outputs.push(Output::Ask { to: id });
            }
        }
        let mut silent = Vec::new();
        for id in self.deadlines.stalls.due(now) {
            if let Some(slot) = self.population.slot(id)
                && !self.look_into(slot, outputs)
            {
                silent.push(id);
            }
        }
        silent
    }

    /// Asks a client that should have been heard of. A live client that has reported since the
    /// deadline was set gets another deadline. Returns whether there is still hope.
    fn look_into(&mut self, slot: Slot, outputs: &mut Vec<Output>) -> bool {
        let TickContext { config, now, rounds, .. } = self.context;
        let patience = self.population.at(slot).patience(self.context);
        let avatar = self.population.at_mut(slot);
        let (id, is_live) = (avatar.id, avatar.is_live());
        let silence = now.saturating_sub(avatar.heard_at);
        if is_live && silence + config.tick < patience {
            self.deadlines.wait(now, id, patience - silence);
            return true;
        }
        if avatar.unanswered >= config.asks_max {
            return false;
        }
        // A host that was late had no time to read an answer to the last ask.
        let had_time = rounds.wrapping_sub(avatar.asked_round) >= ROUNDS_TO_ANSWER;
        avatar.unanswered += u32::from(had_time);
        avatar.asked_round = rounds;
        let trip = avatar.round_trip;
        self.stats.repeats += 1;
        outputs.push(Output::Ask { to: id });
        self.deadlines.wait(now, id, trip + config.ask_timeout);
        true
    }
}
