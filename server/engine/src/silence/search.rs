//! How long a TBV lasts: as long as it stays unseen, or as a policy says.

use std::time::Duration;

use sightline_world::{
    geometry::Aabb,
    motion::{ReportingState, Tbv},
    tolerance::WIRE_POSE_M,
};

use crate::{
    Engine, TbvShape, Validity,
    interest::sight_tests::TestOutcome,
    population::Slot,
    regions::cover_boxes::CoverBoxes,
    regions::footprints::HiddenFootprint,
    regions::live_regions::{MotionBound, scaled},
    regions::reach::{Reach, Start},
};

/// The first validity that is tried for a newcomer.
pub(crate) const FIRST: Duration = Duration::from_secs(1);
/// Halvings of the gap between a validity that stays unseen and one that does not.
const BISECTIONS: u32 = 2;

/// A place to stay in is made larger on all sides, and then on each, by steps from the one to the other of
/// these, in metres. What one takes others cannot have: with steps of up to 4 m fewer are silent.
const STAY_STEPS_M: [f32; 2] = [0.5, 1.0];

/// A look from one zone to another costs no more than this, in the units of
/// [`Config::silence_budget`](crate::Config::silence_budget): with ten times as much each, fewer get their turn.
const LOOK_MAX: u32 = 600;

/// A TBV that nobody can see and from which nobody can be seen.
pub(crate) struct Silence {
    pub(crate) tbv: Tbv,
    pub(crate) zone: HiddenFootprint,
    pub(crate) validity: Duration,
}

/// What ended a TBV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    Expired,
    Revealed,
}

impl Engine {
    /// When a live avatar's last report was made.
    pub(crate) fn made_at(&self, slot: Slot) -> Duration {
        let avatar = self.population.at(slot);
        self.horizons.made_at(avatar.heard, avatar.link())
    }

    /// The TBV in which a live avatar can be silent, if there is one that lasts for more than two
    /// ticks after all that must happen before it expires.
    pub(crate) fn silence(
        &mut self,
        now: Duration,
        slot: Slot,
        zone: &HiddenFootprint,
    ) -> Option<Silence> {
        // No TBV that lasts for long enough is smaller than where a live avatar can soon be.
        if self.is_seen(slot, zone) {
            return None;
        }
        let avatar = self.population.at(slot);
        let age = now.saturating_sub(self.made_at(slot));
        let least = age + self.horizons.lead(avatar.link()) + 2 * self.config.tick;
        let most = self.config.validity_max.max(least);
        let wanted = avatar.validity.clamp(least, most);
        match self.config.validity {
            Validity::Constant(validity) if validity < least => None,
            Validity::Constant(validity) => self.unseen(slot, validity),
            Validity::Adaptive => {
                let found = self.unseen(slot, wanted);
                if found.is_none() {
                    self.population.at_mut(slot).validity = wanted / 2;
                }
                found
            }
            Validity::Maximal => self.longest(slot, least, wanted, most),
            Validity::UntilLeft => {
                let found = self.widest_stay(slot, age, most)?;
                self.narrowed(slot, found)
            }
        }
    }

    /// Finds the widest place to stay in that remains unseen: first larger on all sides, then on each.
    fn widest_stay(&mut self, slot: Slot, age: Duration, validity: Duration) -> Option<Silence> {
        let avatar = self.population.at(slot);
        let notice = self.horizons.notice(avatar.link());
        let told = age + self.horizons.one_way(avatar.round_trip) + self.config.tick;
        let least = self.leeway(&avatar.pose, true, told + notice).within.grown(WIRE_POSE_M);
        let notice = notice.mul_f64(self.config.faults.notice_scale.into());
        let expiry = self.made_at(slot) + validity;
        let tbv = Tbv { within: least, axes: self.world.cells.axes, expiry, notice };
        let mut found = self.stay(slot, tbv, validity)?;
        let [step_min, step_max] = STAY_STEPS_M;
        let mut step = step_min;
        while step <= step_max
            && let Some(wider) = self.stay(slot, found.tbv.grown(step), validity)
        {
            found = wider;
            step *= 2.0;
        }
        for (axis, towards) in [(0, -1.0), (0, 1.0), (2, -1.0), (2, 1.0)] {
            let mut step = step_min;
            while step <= step_max {
                let mut beyond = found.tbv;
                let Aabb { min, max } = &mut beyond.within;
                let end = if towards < 0.0 { min } else { max };
                end[axis] += towards * step;
                let Some(wider) = self.stay(slot, beyond, validity) else { break };
                found = wider;
                step *= 2.0;
            }
        }
        Some(found)
    }

    /// The TBV of a body that stays in it until its client says that it leaves, if it remains unseen.
    fn stay(&mut self, slot: Slot, tbv: Tbv, validity: Duration) -> Option<Silence> {
        let avatar = self.population.at(slot);
        let (from, fit) = (tbv.axes.own(avatar.pose.eye), self.ways.fit_of(avatar.footing));
        let start = Start { cells: &self.world.cells, fit, from };
        let reach = Reach::within(&mut self.scratch, &start, &tbv.within);
        let zone = HiddenFootprint::of(&reach, &self.world, &self.rooms, &self.sectors);
        (!self.is_seen(slot, &zone)).then_some(Silence { tbv, zone, validity })
    }

    /// The same, smaller than it must be where a test has broken that.
    fn narrowed(&mut self, slot: Slot, found: Silence) -> Option<Silence> {
        let by = self.config.faults.tbv_scale;
        if by == 1.0 {
            return Some(found);
        }
        let Silence { tbv, validity, .. } = found;
        let from = tbv.axes.own(self.population.at(slot).pose.eye);
        self.stay(slot, Tbv { within: scaled(&tbv.within, from, by), ..tbv }, validity)
    }

    /// Finds the longest validity by doubling, from the one that the last TBV had, and bisection.
    fn longest(
        &mut self,
        slot: Slot,
        least: Duration,
        wanted: Duration,
        most: Duration,
    ) -> Option<Silence> {
        let mut found = None;
        let (mut trial, mut seen) = (wanted, None);
        // What fails is tried from the shortest on the next time.
        self.population.at_mut(slot).validity = least;
        // Halves until one stays unseen, then doubles until one does not.
        loop {
            match self.unseen(slot, trial) {
                Some(silence) => {
                    found = Some(silence);
                    if seen.is_some() || trial >= most {
                        break;
                    }
                    trial = (trial * 2).min(most);
                }
                None => {
                    seen = Some(trial);
                    if found.is_some() || trial <= least {
                        break;
                    }
                    trial = (trial / 2).max(least);
                }
            }
        }
        if let Some(mut seen) = seen {
            for _ in 0..BISECTIONS {
                let Some(unseen) = found.as_ref().map(|silence| silence.validity) else { break };
                let middle = (unseen + seen) / 2;
                match self.unseen(slot, middle) {
                    Some(silence) => found = Some(silence),
                    None => seen = middle,
                }
            }
        }
        found
    }

    /// The TBV of a validity, if nothing that may move in the meantime can see it or be seen from
    /// it: neither where live avatars can soon be nor the TBVs of hidden ones.
    fn unseen(&mut self, slot: Slot, validity: Duration) -> Option<Silence> {
        let made = self.made_at(slot);
        let (tbv, leeway) = self.tbv_for(slot, made, validity);
        let fit = self.ways.fit_of(self.population.at(slot).footing);
        let start = Start { cells: &self.world.cells, fit, from: leeway.from };
        let zone = if self.config.shape == TbvShape::Sphere {
            HiddenFootprint::of_box(&leeway.within, &self.world, &self.rooms, &self.sectors)
        } else {
            let reach = Reach::new(&mut self.scratch, &start, &leeway.within, leeway.way_m);
            HiddenFootprint::of(&reach, &self.world, &self.rooms, &self.sectors)
        };
        (!self.is_seen(slot, &zone)).then_some(Silence { tbv, zone, validity })
    }

    /// Whether somebody may see into a zone, or be seen from it: as far as cells tell, and, where these
    /// leave it open, shafts. Who was found the last time is most likely to be so again.
    fn is_seen(&mut self, slot: Slot, zone: &HiddenFootprint) -> bool {
        let mut found = Vec::new();
        for index in [&self.live_zones, &self.hidden_zones] {
            index.meeting(&self.sectors, zone, &mut found);
        }
        found.sort_unstable();
        found.dedup();
        let last = self.population.at(slot).seen_by;
        if let Some(place) = last.and_then(|last| found.binary_search(&last).ok()) {
            found[..=place].rotate_right(1);
        }
        let seen_by = found.into_iter().find(|(_, other)| self.may_see_each_other(zone, *other));
        self.population.at_mut(slot).seen_by = seen_by.or(last);
        seen_by.is_some()
    }

    /// The zone of a live avatar at this tick alone.
    pub(crate) fn zone_now(&self, slot: Slot) -> HiddenFootprint {
        let avatar = self.population.at(slot);
        avatar.zone.within([avatar.far, self.body.around_box(&avatar.far)])
    }

    /// Whether a line from a zone to where an avatar can be now may be free, either way.
    pub(crate) fn may_see_each_other(&mut self, zone: &HiddenFootprint, other: Slot) -> bool {
        let avatar = self.population.at_mut(other);
        let (far, is_live) = (avatar.far, avatar.state == ReportingState::Live);
        let theirs = std::mem::take(&mut avatar.zone);
        let now = is_live.then(|| theirs.parts_within([far, self.body.around_box(&far)]));
        let sees = self.lets_see(zone, (&theirs, now.as_ref().unwrap_or(&theirs.parts)));
        self.population.at_mut(other).zone = theirs;
        sees
    }

    /// Whether a line from one zone to parts of another may be free, either way; without a budget, it may.
    pub(crate) fn lets_see(
        &mut self,
        one: &HiddenFootprint,
        (other, parts): (&HiddenFootprint, &[CoverBoxes; 2]),
    ) -> bool {
        let ([eyes, bodies], [other_eyes, other_bodies]) = (&one.parts, parts);
        let shown = [one.shows(other, &self.rooms), other.shows(one, &self.rooms)];
        let ways = [(eyes, other_bodies), (other_eyes, bodies)].into_iter().zip(shown);
        ways.filter(|(_, is_shown)| *is_shown).any(|((eyes, bodies), _)| {
            let found = self.shafts.between(eyes, bodies, LOOK_MAX, &mut self.silence_left);
            !matches!(found, TestOutcome::Hidden)
        })
    }

    /// A TBV, and how far its avatar gets in it.
    fn tbv_for(&self, slot: Slot, made: Duration, validity: Duration) -> (Tbv, MotionBound) {
        let pose = &self.population.at(slot).pose;
        let mut leeway = self.leeway(pose, true, validity).scaled(self.config.faults.tbv_scale);
        if self.config.shape == TbvShape::Sphere {
            leeway.within = Aabb::around(leeway.from, leeway.way_m);
        }
        let (within, axes) = (leeway.within, self.world.cells.axes);
        (Tbv { within, axes, expiry: made + validity, notice: Duration::ZERO }, leeway)
    }

    /// Learns from how a TBV ended.
    pub(crate) fn ended(&mut self, now: Duration, slot: Slot, end: End) {
        let avatar = self.population.at_mut(slot);
        avatar.validity = match (self.config.validity, end) {
            (Validity::Adaptive, End::Expired) => avatar.validity * 3 / 2,
            (Validity::Adaptive, End::Revealed) => avatar.validity / 2,
            // The next search begins with what would have lasted.
            (Validity::Maximal, End::Revealed) => now.saturating_sub(avatar.hidden_from),
            _ => avatar.validity,
        };
    }
}
