//! The search for a TBV that nobody can see, and from which nobody can be seen.

use std::time::Duration;

use sightline_world::{geometry::Aabb, motion::Tbv, tolerance::WIRE_POSE_M};

use super::Silencing;
use crate::{
    config::{StationFault, TbvShape, Validity},
    population::Prevented,
    regions::{HiddenFootprint, MotionBound, Reach, scaled},
    slot::{Member, Slot},
    sphere::Sphere,
    stations::RelayOrder,
    tick_context::TickContext,
};

/// The first validity that is tried for an avatar that has just joined.
pub(crate) const VALIDITY_FIRST: Duration = Duration::from_secs(1);
/// How often the gap between a validity that stays unseen and one that does not is halved.
const BISECTIONS: u32 = 2;
/// A box to stay in is made larger on all sides, and then on each, by steps from the first of these
/// to the second, in metres. With steps of up to 4 m fewer avatars are silent, because what one
/// takes others cannot have.
const STAY_STEPS_M: [f32; 2] = [0.5, 1.0];

/// The same for avatars of other stations. Each box that is left costs messages, and far from this
/// station's own avatars there is much room.
const GUEST_STEPS_M: [f32; 2] = [1.0, 8.0];
/// How long an avatar of another station may stay in a box.
pub(super) const GUEST_VALIDITY: Duration = Duration::from_secs(60);

/// A TBV that stays unseen.
pub(super) struct Silence {
    pub(super) tbv: Tbv,
    /// The ball that bounds the avatar as well, if the TBV is a sphere.
    pub(super) sphere: Option<Sphere>,
    pub(super) footprint: HiddenFootprint,
    pub(super) validity: Duration,
}

/// The validities among which the longest is searched.
struct ValidityRange {
    least: Duration,
    /// The first one that is tried.
    first: Duration,
    most: Duration,
}

impl Silencing<'_> {
    /// Finds a TBV in which a live avatar can be silent, given its footprint at this tick. A TBV
    /// must last for more than two ticks after all that must happen before it expires.
    pub(super) fn find_silence(
        &mut self,
        slot: Slot,
        current: &HiddenFootprint,
    ) -> Option<Silence> {
        // A TBV that lasts for long enough is at least as large as the live footprint.
        if self.is_seen(slot, current) {
            return None;
        }
        let TickContext { config, horizons, .. } = self.context;
        let avatar = self.population.at(slot);
        let age = avatar.motion(self.context).age;
        let least = age + horizons.lead_time(avatar.link()) + 2 * config.tick;
        let most = config.validity_max.max(least);
        let wanted = avatar.validity.clamp(least, most);
        debug_assert!(least <= wanted && wanted <= most);
        if avatar.is_guest() {
            return self.largest_stay(slot, age, GUEST_VALIDITY);
        }
        match config.validity {
            Validity::Constant(validity) if validity < least => None,
            Validity::Constant(validity) => self.unseen(slot, validity),
            Validity::Adaptive => {
                let found = self.unseen(slot, wanted);
                if found.is_none() {
                    self.population.at_mut(slot).validity = wanted / 2;
                }
                found
            }
            Validity::Maximal => self.longest(slot, &ValidityRange { least, first: wanted, most }),
            Validity::UntilLeft => {
                let found = self.largest_stay(slot, age, most)?;
                self.with_fault(slot, found)
            }
        }
    }

    /// Finds the largest box to stay in that remains unseen. It is made larger on all sides, and
    /// then on each.
    fn largest_stay(&mut self, slot: Slot, age: Duration, validity: Duration) -> Option<Silence> {
        let TickContext { building, config, horizons, .. } = self.context;
        let avatar = self.population.at(slot);
        let motion = avatar.motion(self.context);
        let agreed = avatar.relays.iter().filter_map(|relay| match relay.order {
            RelayOrder::Quiet(stay) => Some(stay.notice),
            RelayOrder::Live(_) => None,
        });
        let notice = agreed.fold(horizons.notice(avatar.link()), Duration::max);
        let [step_min, step_max] = if avatar.is_guest() { GUEST_STEPS_M } else { STAY_STEPS_M };
        let told = age + horizons.one_way(avatar.round_trip) + config.tick;
        let least = MotionBound::new(building, &motion, true, told + notice);
        let within = least.eyes.grown(WIRE_POSE_M);
        let notice = notice.mul_f64(config.faults.notice_scale.into());
        let expiry = self.known_at(&motion) + validity;
        let tbv = Tbv { within, axes: *building.axes(), expiry, notice };
        let mut found = self.stay(slot, tbv, validity)?;
        let mut step = step_min;
        while step <= step_max
            && let Some(larger) = self.stay(slot, found.tbv.grown(step), validity)
        {
            found = larger;
            step *= 2.0;
        }
        for (axis, towards) in [(0, -1.0), (0, 1.0), (2, -1.0), (2, 1.0)] {
            let mut step = step_min;
            while step <= step_max {
                let mut beyond = found.tbv;
                let Aabb { min, max } = &mut beyond.within;
                let end = if towards < 0.0 { min } else { max };
                end[axis] += towards * step;
                let Some(larger) = self.stay(slot, beyond, validity) else { break };
                found = larger;
                step *= 2.0;
            }
        }
        Some(found)
    }

    /// The TBV of an avatar that stays in a box until its client says that it leaves, if it remains
    /// unseen.
    fn stay(&mut self, slot: Slot, tbv: Tbv, validity: Duration) -> Option<Silence> {
        let building = self.context.building;
        let start = self.population.at(slot).motion(self.context).start(building);
        let reach = Reach::in_box(&mut self.workspace.reach, &start, &tbv.within);
        let footprint = HiddenFootprint::of_reach(building, &mut self.workspace.reach, &reach);
        let may_stay = self.others_allow(slot, &tbv, &footprint) && !self.is_seen(slot, &footprint);
        may_stay.then_some(Silence { tbv, sphere: None, footprint, validity })
    }

    /// The same TBV, or one that is too small where a test injects that fault.
    fn with_fault(&mut self, slot: Slot, found: Silence) -> Option<Silence> {
        let by = self.context.config.faults.tbv_scale;
        if by == 1.0 {
            return Some(found);
        }
        let Silence { tbv, validity, .. } = found;
        let from = self.population.at(slot).motion(self.context).from;
        self.stay(slot, Tbv { within: scaled(&tbv.within, from, by), ..tbv }, validity)
    }

    /// Finds the longest validity that stays unseen, by doubling from the last one, and bisection.
    fn longest(&mut self, slot: Slot, range: &ValidityRange) -> Option<Silence> {
        let mut found: Option<Silence> = None;
        let (mut trial, mut seen) = (range.first, None);
        // After a failure the next search begins with the shortest.
        self.population.at_mut(slot).validity = range.least;
        // The validity is halved until one stays unseen, then doubled until one does not.
        loop {
            match self.unseen(slot, trial) {
                Some(silence) => {
                    found = Some(silence);
                    if seen.is_some() || trial >= range.most {
                        break;
                    }
                    trial = (trial * 2).min(range.most);
                }
                None => {
                    seen = Some(trial);
                    if found.is_some() || trial <= range.least {
                        break;
                    }
                    trial = (trial / 2).max(range.least);
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

    /// The TBV of a validity, if it stays unseen: no live avatar can see it or be seen from it
    /// where it can soon be, and no hidden avatar can from its own TBV.
    fn unseen(&mut self, slot: Slot, validity: Duration) -> Option<Silence> {
        let TickContext { building, config, .. } = self.context;
        let motion = self.population.at(slot).motion(self.context);
        let bound = MotionBound::new(building, &motion, true, validity);
        let MotionBound { from, eyes, way_m } = bound.scaled(config.faults.tbv_scale);
        let expiry = self.known_at(&motion) + validity;
        let (within, sphere, footprint) = match config.shape {
            TbvShape::Sphere => {
                let sphere = Sphere { centre: from, radius_m: way_m };
                let footprint = HiddenFootprint::of_sphere(building, &sphere);
                (sphere.bounds(), Some(sphere), footprint)
            }
            TbvShape::Reach => {
                let start = motion.start(building);
                let reach = Reach::on_ways(&mut self.workspace.reach, &start, &eyes, way_m);
                (eyes, None, HiddenFootprint::of_reach(building, &mut self.workspace.reach, &reach))
            }
        };
        let tbv = Tbv { within, axes: *building.axes(), expiry, notice: Duration::ZERO };
        let may_stay = self.others_allow(slot, &tbv, &footprint) && !self.is_seen(slot, &footprint);
        may_stay.then_some(Silence { tbv, sphere, footprint, validity })
    }

    /// Whether another avatar may see into a footprint, or be seen from it: by cells first, and
    /// then by sight tests. The avatar that was found the last time is tested first.
    pub(super) fn is_seen(&mut self, slot: Slot, footprint: &HiddenFootprint) -> bool {
        let last = self.population.at(slot).prevented.map(|prevented| prevented.by);
        if let Some(last) = last.filter(|last| self.may_meet(footprint, *last))
            && self.may_see_each_other(footprint, last.slot)
        {
            self.note_prevented(slot, last);
            return true;
        }
        let mut found: Vec<Member> = Vec::new();
        for index in [&self.indices.live, &self.indices.hidden] {
            index.meeting_sectors(&self.context.building.sectors, &footprint.sectors, &mut found);
        }
        found.retain(|other| other.slot != slot && Some(*other) != last);
        found.retain(|other| self.population.is_one_own(slot, other.slot));
        if self.context.config.faults.station == Some(StationFault::SilenceUnasked) {
            found.retain(|other| !self.population.at(other.slot).is_guest());
        }
        found.sort_unstable();
        found.dedup();
        let seen_by =
            found.into_iter().find(|other| self.may_see_each_other(footprint, other.slot));
        if let Some(by) = seen_by {
            self.note_prevented(slot, by);
        }
        seen_by.is_some()
    }

    /// Whether an avatar is still present, and by sectors may see a footprint or be seen from it.
    fn may_meet(&self, footprint: &HiddenFootprint, other: Member) -> bool {
        let other = self.population.get(other);
        other.is_some_and(|other| footprint.meets(&other.footprint, &self.context.building.sectors))
    }

    /// Takes in that an avatar keeps another one from falling silent.
    fn note_prevented(&mut self, slot: Slot, by: Member) {
        let [own, other] = [slot, by.slot].map(|slot| self.population.at(slot));
        let versions = [own.footprint_version, other.footprint_version];
        let boxes = [own.reveal_box, other.reveal_box];
        self.population.at_mut(slot).prevented = Some(Prevented { by, versions, boxes });
    }
}
