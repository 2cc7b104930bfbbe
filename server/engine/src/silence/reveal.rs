//! Reveals: hidden avatars that a live one may soon see, or be seen by.

use sightline_world::{geometry::Aabb, motion::ReportingState};

use super::{End, Reached, Silencing, lets_see};
use crate::{
    messages::Output,
    regions::{HiddenFootprint, Motion, MotionBound, Reach, lasting_margin_m, with_margin_ahead},
    slot::{Member, Slot},
    tick_context::TickContext,
};

/// The least margin of a live avatar's footprint, in metres.
const FOOTPRINT_MARGIN_M: f32 = 0.5;

impl Silencing<'_> {
    /// Updates where a live avatar can be before long, and asks every hidden avatar that it may see
    /// from there, or be seen by. Its footprint has a margin, so that it lasts for several ticks.
    /// Hidden avatars that the footprint meets are tested at each of these ticks, and no others.
    /// While nobody is hidden, no footprint is made.
    pub(crate) fn reveal(&mut self, slot: Slot, outputs: &mut Vec<Output>) {
        let TickContext { building, horizons, .. } = self.context;
        let avatar = self.population.at_mut(slot);
        let motion = avatar.motion(self.context);
        let time = horizons.reveal_horizon(motion.age);
        let bound = MotionBound::new(building, &motion, motion.is_believed, time);
        avatar.reveal_box = bound.eyes;
        // Other stations must know in time.
        let more = horizons.subscription_time();
        let eyes = if avatar.is_guest() || more.is_zero() {
            bound.eyes
        } else {
            MotionBound::new(building, &motion, motion.is_believed, time + more).eyes
        };
        avatar.footprint_box = avatar.footprint_box.filter(|made| made.contains_box(&eyes));
        if self.population.is_nobody_hidden() && !self.context.stations.are_several() {
            return;
        }
        if self.population.at(slot).footprint_box.is_none() {
            self.update_footprint(slot, &motion, &eyes);
        }
        let nearby = &self.population.at(slot).nearby_hidden;
        if nearby.is_empty() {
            return;
        }
        let is_hidden = |member: &Member| self.population.is_hidden(*member);
        let hidden: Vec<Member> = nearby.iter().copied().filter(is_hidden).collect();
        let footprint = self.current_footprint(slot);
        let (found, nearby) =
            hidden.into_iter().partition(|other| self.may_see_each_other(&footprint, other.slot));
        self.population.at_mut(slot).nearby_hidden = nearby;
        self.reveal_all(found, outputs);
    }

    /// Makes the footprints that were left out. Before an avatar is hidden all others have theirs.
    pub(super) fn make_footprints(&mut self, live: &[Slot]) {
        for slot in live {
            let avatar = self.population.at(*slot);
            if avatar.is_live() && avatar.footprint_box.is_none() {
                let (motion, eyes) = (avatar.motion(self.context), avatar.reveal_box);
                self.update_footprint(*slot, &motion, &eyes);
            }
        }
    }

    /// Computes a live avatar's footprint, and which hidden avatars it meets.
    fn update_footprint(&mut self, slot: Slot, motion: &Motion, eyes: &Aabb) {
        let TickContext { building, config, .. } = self.context;
        let avatar = self.population.at_mut(slot);
        let step = building.axes().own(motion.pose.velocity) * config.tick.as_secs_f32();
        let margin_m = lasting_margin_m(step, FOOTPRINT_MARGIN_M);
        let region = with_margin_ahead(eyes, step, margin_m);
        let start = motion.start(building);
        let reach = Reach::in_box(&mut self.workspace.reach, &start, &region);
        let footprint = HiddenFootprint::of_reach(building, &mut self.workspace.reach, &reach);
        avatar.footprint_box = Some(region);
        if footprint == avatar.footprint {
            return;
        }
        let member = Member { id: avatar.id, slot };
        let mut nearby = Vec::new();
        self.indices.hidden.meeting_sectors(&building.sectors, &footprint.sectors, &mut nearby);
        nearby.sort_unstable();
        nearby.dedup();
        nearby.retain(|other| self.population.is_one_own(slot, other.slot));
        nearby.retain(|other| self.may_see_each_other(&footprint, other.slot));
        let avatar = self.population.at_mut(slot);
        self.indices.live.replace(member, &avatar.footprint.sectors, &footprint.sectors);
        (avatar.footprint, avatar.nearby_hidden) = (footprint, nearby);
        avatar.footprint_version.advance();
    }

    /// Reveals hidden avatars: orders their clients to report from now on.
    pub(super) fn reveal_all(&mut self, found: Vec<Member>, outputs: &mut Vec<Output>) {
        for Member { slot, .. } in found {
            if self.population.at(slot).state == ReportingState::Quiet {
                self.stats.reveals += 1;
                self.ask(slot, End::Revealed);
            }
            if self.population.at(slot).orders.is_quiet() {
                outputs.push(self.order_live(slot));
            }
        }
    }

    /// Adds an avatar that has just been hidden to the lists of all live avatars that may see it
    /// from their footprints, or be seen.
    pub(super) fn add_to_nearby(&mut self, member: Member) {
        let Self { context, population, indices, workspace, budget, .. } = self;
        let footprint = &population.at(member.slot).footprint;
        let mut found = Vec::new();
        indices.live.meeting_sectors(&context.building.sectors, &footprint.sectors, &mut found);
        found.sort_unstable();
        found.dedup();
        found.retain(|live| population.is_one_own(member.slot, live.slot));
        found.retain(|live| {
            let live = &population.at(live.slot).footprint;
            let whole = Reached { footprint: live, cover: &live.cover };
            lets_see(*context, workspace, budget, footprint, whole)
        });
        for live in found {
            population.at_mut(live.slot).nearby_hidden.push(member);
        }
    }
}
