//! The comparison of one viewer with all other avatars at one instant.

use std::{collections::BTreeMap, time::Duration};

use glam::Vec3;
use sightline_visibility::rooms::SealedRooms;
use sightline_world::motion::AvatarId;

use super::{
    super::{
        network::SimulatedNetwork,
        report::{MissedAvatar, StalePosition},
    },
    Audit,
    look_ahead::{HorizonMotion, can_come_into_sight},
};

/// Sampled points on each axis of a body's box.
const SAMPLES: u32 = 3;

/// An avatar and its client at an instant.
pub(super) struct Participant<'a> {
    pub(super) avatar: AvatarId,
    pub(super) trace_id: u32,
    /// Where its eye truly is.
    pub(super) eye: Vec3,
    /// Whether its last join or jump was long enough ago.
    pub(super) is_settled: bool,
    /// Whether one of its messages recently took longer than the engine allows for.
    pub(super) is_late: bool,
    /// How many reports it made between its last two ticks.
    pub(super) reports: u32,
    /// Where it can be within the horizon.
    pub(super) motion: HorizonMotion,
    /// The sealed rooms that it is in, and those that it was in a while ago.
    pub(super) sealed_rooms: [SealedRooms; 2],
    /// The avatars that its client holds, and when each position was sampled.
    pub(super) replica: &'a BTreeMap<AvatarId, Duration>,
}

/// What one viewer's pairs come to.
#[derive(Default)]
pub(super) struct ViewerFindings {
    pub(super) visible: u64,
    pub(super) held: u64,
    pub(super) foreseen: u64,
    pub(super) misses: Vec<MissedAvatar>,
    pub(super) misses_after_jumps: u64,
    pub(super) misses_late: u64,
    pub(super) ages: u64,
    pub(super) age_sum: Duration,
    pub(super) age_worst: Duration,
    pub(super) stale: Vec<StalePosition>,
    /// The visible participants, by their place among all.
    pub(super) seen: Vec<usize>,
}

/// A viewer and an avatar at an instant.
#[derive(Clone, Copy)]
struct Pair<'a> {
    now: Duration,
    viewer: &'a Participant<'a>,
    other: &'a Participant<'a>,
}

impl Pair<'_> {
    fn is_settled(&self) -> bool {
        self.viewer.is_settled && self.other.is_settled
    }

    fn is_late(&self) -> bool {
        self.viewer.is_late || self.other.is_late
    }

    fn missed(&self) -> MissedAvatar {
        let t_ms = self.now.as_secs_f64() * 1e3;
        MissedAvatar { t_ms, viewer: self.viewer.trace_id, avatar: self.other.trace_id }
    }
}

impl Audit {
    /// Compares a viewer with all other participants.
    pub(super) fn look_from(
        &self,
        now: Duration,
        viewer: &Participant<'_>,
        all: &[Participant<'_>],
        network: &SimulatedNetwork,
    ) -> ViewerFindings {
        let mut findings = ViewerFindings::default();
        for (place, other) in all.iter().enumerate().filter(|(_, o)| o.avatar != viewer.avatar) {
            let pair = Pair { now, viewer, other };
            let held = viewer.replica.get(&other.avatar);
            let is_visible = self.is_visible(viewer, other);
            if is_visible {
                findings.seen.push(place);
            }
            match (is_visible, held) {
                (true, None) => findings.miss(&pair),
                (true, Some(sampled)) if pair.is_settled() && !pair.is_late() => {
                    findings.compare_age(&pair, *sampled, network);
                }
                _ => {}
            }
            if pair.is_settled() {
                findings.visible += u64::from(is_visible);
                findings.held += u64::from(held.is_some());
                let is_foreseen = held.is_some()
                    && (is_visible || self.look_ahead && self.can_come_into_sight(&pair));
                findings.foreseen += u64::from(is_foreseen);
            }
        }
        findings
    }

    /// Whether rays reach the other's body, and the author allows to see it.
    fn is_visible(&self, viewer: &Participant<'_>, other: &Participant<'_>) -> bool {
        let body = self.body.around(other.eye);
        self.oracle.of_box(viewer.eye, &body, SAMPLES)
            && self.author.as_ref().is_none_or(|author| author.allows(viewer, other, &body))
    }

    fn can_come_into_sight(&self, pair: &Pair<'_>) -> bool {
        let (viewer, other) = (&pair.viewer.motion, &pair.other.motion);
        can_come_into_sight(&self.oracle, &self.body, pair.now, viewer, other)
    }
}

impl ViewerFindings {
    /// Counts a visible avatar that is not held. Those of recent joins, jumps and late messages are
    /// excused.
    fn miss(&mut self, pair: &Pair<'_>) {
        if !pair.is_settled() {
            self.misses_after_jumps += 1;
        } else if pair.is_late() {
            self.misses_late += 1;
        } else {
            self.misses.push(pair.missed());
        }
    }

    /// Compares the age of a held position with its bound.
    fn compare_age(&mut self, pair: &Pair<'_>, sampled: Duration, network: &SimulatedNetwork) {
        let (viewer, avatar) = (pair.viewer.avatar, pair.other.avatar);
        debug_assert!(sampled <= pair.now, "a position is sampled before it is held");
        let age = pair.now.saturating_sub(sampled);
        self.ages += 1;
        self.age_sum += age;
        self.age_worst = self.age_worst.max(age);
        let lost = network.lost_since(sampled, viewer, avatar);
        let bound = network.age_max(viewer, avatar) + 2 * network.tick() * lost as u32;
        if age > bound {
            let [age_ms, bound_ms] = [age, bound].map(|time| time.as_secs_f64() * 1e3);
            self.stale.push(StalePosition { what: pair.missed(), age_ms, bound_ms });
        }
    }
}
