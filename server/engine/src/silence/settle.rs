//! Settling: at the end of a tick each live avatar is silenced, or stays live.

use super::{Silencing, search::Silence};
use crate::{
    config::{Policy, StationFault},
    interest::end_pairs,
    messages::Output,
    pairs::Pairs,
    population::{Avatar, Prevented},
    slot::{Member, Slot},
    stations::RelayOrder,
    tick_context::TickContext,
    timing::{Link, SILENT_MAX},
};

/// While the two avatars of a failed try stand still, the next try waits for this many times
/// [`Config::silence_retry`](crate::Config::silence_retry).
const RETRIES_SPARED: u32 = 20;
/// Where more than a quarter of the budget is used, the next try waits for this many times
/// [`Config::silence_retry`](crate::Config::silence_retry).
const RETRIES_SHORT: u32 = 8;

impl Silencing<'_> {
    /// Settles all live avatars, beginning with the one at whom the budget ran out the last time.
    /// So avatars that try in vain do not keep others from their turn.
    pub(crate) fn settle_all(&mut self, live: &[Slot], outputs: &mut Vec<Output>) {
        let turn = self.budget.turn;
        let first = live.partition_point(|slot| self.population.at(*slot).id < turn);
        let has_budget = self.budget.left > 0;
        let (mut is_used_up, mut has_footprints) = (false, false);
        for slot in live[first..].iter().chain(&live[..first]) {
            if has_budget && self.budget.left == 0 && !is_used_up {
                self.budget.turn = self.population.at(*slot).id;
                is_used_up = true;
            }
            let may_try = !is_used_up && self.may_fall_silent(self.population.at(*slot));
            if may_try && !has_footprints {
                self.make_footprints(live);
                has_footprints = true;
            }
            self.settle(*slot, may_try, outputs);
        }
    }

    /// Silences a live avatar if nobody can see it and it can see nobody, where that may be tried.
    /// Otherwise makes sure that its client knows that it is live.
    fn settle(&mut self, slot: Slot, may_try: bool, outputs: &mut Vec<Output>) {
        let TickContext { config, now, .. } = self.context;
        if self.population.at(slot).is_absent {
            return;
        }
        if may_try {
            let footprint = self.current_footprint(slot);
            if let Some(silence) = self.find_silence(slot, &footprint) {
                let tbv = silence.tbv;
                self.hide(slot, silence);
                outputs.push(Output::Quiet { to: self.population.at(slot).id, tbv });
                return;
            }
            // Where many try in vain, each waits longer.
            let is_short = self.budget.left < config.silence_budget / 4 * 3;
            let retries = if is_short { RETRIES_SHORT } else { 1 };
            self.population.at_mut(slot).silence_again_at = now + retries * config.silence_retry;
        }
        if self.needs_order(slot) {
            outputs.push(self.order_live(slot));
        }
    }

    fn may_fall_silent(&self, avatar: &Avatar) -> bool {
        let TickContext { config, horizons, now, .. } = self.context;
        let is_fresh = |link: Link| {
            let fresh = horizons.one_way(link.round_trip) + link.margin + 2 * config.tick;
            avatar.motion(self.context).age <= fresh
        };
        config.policy == Policy::Tbv
            && !avatar.is_absent
            && avatar.watchers == 0
            && now >= avatar.silence_again_at
            && self.is_surely_hidden(avatar)
            && (avatar.relays.iter().all(|relay| matches!(relay.order, RelayOrder::Quiet(_)))
                || config.faults.station == Some(StationFault::SilenceUnasked))
            && is_fresh(avatar.link())
            && horizons.may_be_silent(avatar.link())
            && !self.is_still_prevented(avatar)
    }

    /// Whether none of the pairs of an avatar may be in sight. Of a guest's pairs only those count
    /// in which others see it.
    fn is_surely_hidden(&self, avatar: &Avatar) -> bool {
        avatar.pairs.iter().all(|pair| {
            let mirrored = || self.population.at(pair.slot).pairs.get(avatar.id);
            let seen = if avatar.is_guest() { mirrored() } else { Some(pair) };
            seen.is_some_and(|pair| !pair.is_held && pair.sight.is_surely_hidden())
        })
    }

    /// Whether nothing has changed since another avatar kept this one from falling silent: both
    /// stand where they stood. However little changes, it tries again before long.
    fn is_still_prevented(&self, avatar: &Avatar) -> bool {
        let TickContext { config, now, .. } = self.context;
        let Some(Prevented { by, versions, boxes }) = avatar.prevented else { return false };
        let since_try = now.saturating_sub(avatar.silence_again_at) + config.silence_retry;
        self.population.get(by).is_some_and(|by| {
            since_try < RETRIES_SPARED * config.silence_retry
                && versions == [avatar.footprint_version, by.footprint_version]
                && boxes == [avatar.reveal_box, by.reveal_box]
        })
    }

    /// From live to quiet.
    pub(super) fn hide(&mut self, slot: Slot, silence: Silence) {
        let TickContext { config, horizons, now, .. } = self.context;
        let Silence { tbv, sphere, footprint, validity } = silence;
        let motion = self.population.at(slot).motion(self.context);
        debug_assert!(tbv.contains(motion.pose.eye), "a TBV contains its avatar");
        end_pairs(self.context, self.population, &mut self.indices.coarse, slot, self.pending);
        let known = self.known_at(&motion);
        let avatar = self.population.at_mut(slot);
        let member = Member { id: avatar.id, slot };
        avatar.hidden_at = motion.pose;
        avatar.pairs = Pairs::default();
        avatar.footprint_box = None;
        avatar.nearby_hidden = Vec::new();
        avatar.orders.send_quiet();
        (avatar.validity, avatar.hidden_from) = (validity, known);
        let link = avatar.link();
        self.indices.live.remove(member, &avatar.footprint.sectors);
        self.indices.hidden.insert(member, &footprint.sectors);
        avatar.footprint = footprint;
        avatar.footprint_version.advance();
        self.population.set_quiet(slot, tbv, sphere);
        self.add_to_nearby(member);
        self.deadlines.stalls.cancel(member.id);
        let late = config.faults.expiry_late;
        let deadline = (tbv.expiry + late).saturating_sub(horizons.lead_time(link));
        self.deadlines.expiries.set(member.id, now, deadline, self.expiries_max());
    }

    /// The most expiries in one tick. They leave room for the whole population within the time that
    /// a slow client's TBV needs.
    fn expiries_max(&self) -> usize {
        let config = self.context.config;
        let ticks = SILENT_MAX.as_nanos() / config.tick.as_nanos().max(1);
        let needed = 2 * self.population.len() / usize::try_from(ticks).unwrap_or(1).max(1);
        config.expiries_max.max(needed)
    }
}
