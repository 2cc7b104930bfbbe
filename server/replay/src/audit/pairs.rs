//! The comparison of one viewer with all other avatars at one instant.

use std::time::Duration;

use sightline_cli::pose_error::{ErrorsByDistance, PoseErrors};
use sightline_client_core::replica::{BLEND, Replica, ShownAvatar};
use sightline_visibility::rooms::SealedRooms;
use sightline_world::motion::{AvatarId, Pose};

use super::{
    super::{
        network::{AgeBound, SimulatedNetwork},
        report::{MissedAvatar, StalePosition},
        simulated_clients::SimulatedClients,
        stations::Stations,
    },
    Audit, PAST_SPARE,
    freshness::{Past, Tolerances, Within},
    look_ahead::{HorizonMotion, can_come_into_sight},
};

/// Sampled points on each axis of a body's box.
const SAMPLES: u32 = 3;

/// An avatar and its client at an instant.
pub(super) struct Participant<'a> {
    pub(super) avatar: AvatarId,
    pub(super) trace_id: u32,
    /// Its true pose.
    pub(super) pose: Pose,
    /// Where it was before.
    pub(super) past: Past,
    /// Whether its last join or jump was long enough ago.
    pub(super) is_settled: bool,
    /// Whether nobody who is told in time still shows it on its way from where it was before it
    /// settled.
    pub(super) is_joined: bool,
    /// Whether one of its messages recently took longer than the engine allows for.
    pub(super) is_late: bool,
    /// How many reports it made between its last two ticks.
    pub(super) reports: u32,
    /// Where it can be within the horizon.
    pub(super) motion: HorizonMotion,
    /// The sealed rooms that it is in, and those that it was in a while ago.
    pub(super) sealed_rooms: [SealedRooms; 2],
    /// What its client knows.
    pub(super) replica: &'a Replica,
}

/// All participants at an instant.
pub(super) struct Scene<'a> {
    pub(super) now: Duration,
    pub(super) all: &'a [Participant<'a>],
    pub(super) clients: &'a SimulatedClients<'a>,
    pub(super) network: &'a SimulatedNetwork,
    pub(super) tolerances: &'a Tolerances,
    pub(super) stations: &'a Stations,
}

/// What one viewer's pairs come to.
#[derive(Default)]
pub(super) struct ViewerFindings {
    pub(super) visible: u64,
    /// Of those, how many are at another station.
    pub(super) abroad: u64,
    pub(super) held: u64,
    pub(super) foreseen: u64,
    pub(super) misses: Vec<MissedAvatar>,
    pub(super) misses_after_jumps: u64,
    pub(super) misses_late: u64,
    pub(super) ages: u64,
    pub(super) age_sum: Duration,
    pub(super) age_worst: Duration,
    pub(super) stale: Vec<StalePosition>,
    /// How far shown poses are off those of now.
    pub(super) shown_errors: PoseErrors,
    /// How far shown poses are off the promised ones.
    pub(super) promised_errors: ErrorsByDistance,
    /// The visible participants, by their place among all.
    pub(super) seen: Vec<usize>,
}

/// A viewer and an avatar at an instant.
#[derive(Clone, Copy)]
struct Pair<'a> {
    now: Duration,
    /// By how much more the avatar's position may be old, since it comes from another station.
    bus: Duration,
    /// Whether their stations have known each other for long enough.
    is_linked: bool,
    viewer: &'a Participant<'a>,
    other: &'a Participant<'a>,
}

impl Pair<'_> {
    fn is_settled(&self) -> bool {
        self.is_linked && self.viewer.is_settled && self.other.is_settled
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
    pub(super) fn look_from(&self, viewer: &Participant<'_>, scene: &Scene<'_>) -> ViewerFindings {
        let mut findings = ViewerFindings::default();
        let others = scene.all.iter().enumerate().filter(|(_, o)| o.avatar != viewer.avatar);
        let shown = viewer.replica.shown_avatars(scene.now);
        for (place, other) in others {
            let stations = scene.stations;
            let is_abroad = !stations.are_together(viewer.avatar, other.avatar);
            let linked = stations.linked_since(viewer.avatar, other.avatar);
            let pair = Pair {
                now: scene.now,
                bus: if is_abroad { self.bus } else { Duration::ZERO },
                is_linked: !is_abroad || linked.is_some_and(|at| at + self.linking <= scene.now),
                viewer,
                other,
            };
            let held = shown.binary_search_by_key(&other.avatar, |shown| shown.id);
            let held = held.ok().and_then(|place| shown.get(place));
            let is_visible = self.is_visible(viewer, other);
            if is_visible {
                findings.seen.push(place);
            }
            match (is_visible, held) {
                (true, None) => findings.miss(&pair),
                (true, Some(shown)) if pair.is_settled() => {
                    findings.shown_errors.add(&shown.pose, &other.pose);
                    findings.compare_promise(&pair, shown, scene);
                    if !pair.is_late() && other.is_joined {
                        findings.compare_age(&pair, shown, scene);
                    }
                }
                _ => {}
            }
            if pair.is_settled() {
                findings.visible += u64::from(is_visible);
                findings.abroad += u64::from(is_visible && is_abroad);
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
        let body = self.body.around(other.pose.eye);
        self.oracle.of_box(viewer.pose.eye, &body, SAMPLES)
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

    /// Compares where an avatar is shown with where it was one delay and two ticks ago.
    fn compare_promise(&mut self, pair: &Pair<'_>, shown: &ShownAvatar, scene: &Scene<'_>) {
        let Scene { now, clients, network, .. } = scene;
        let avatar = pair.other.avatar;
        let lag =
            network.delay(pair.viewer.avatar, avatar) + 2 * scene.stations.first().config().tick;
        if let Some(promised) = clients.pose_at(avatar, now.saturating_sub(lag)) {
            let away_m = pair.viewer.pose.eye.distance(promised.eye);
            self.promised_errors.add(away_m, &shown.pose, &promised);
        }
    }

    /// Compares with its bound the age of the place at which an avatar is shown.
    fn compare_age(&mut self, pair: &Pair<'_>, shown: &ShownAvatar, scene: &Scene<'_>) {
        let other = pair.other;
        let AgeBound { age: bound, lost } =
            scene.network.age_bound(pair.now, pair.viewer.avatar, other.avatar);
        let bound = bound + pair.bus;
        let since = pair.now.saturating_sub(bound);
        // Until what was lost comes again, the avatar is shown farther along its old course.
        let tolerance_m = scene.tolerances.largest_m(other.avatar, since);
        let engine = scene.stations.engine_of(pair.viewer.avatar);
        // A client tells only at its next tick that its avatar departs: half a tick later in the
        // mean, and a whole one where it stops dead just before. What jitter then makes late, to
        // the server and to the viewer, is joined within a short while.
        let moved_since = since.saturating_sub(BLEND);
        let speed = other.past.speed_max(moved_since);
        let in_a_tick_m = speed * (engine.config().tick / 2).as_secs_f32();
        let late = scene.network.lateness(other.avatar, true)
            + scene.network.lateness(pair.viewer.avatar, false);
        let untold_m = other.past.departure_max_m(moved_since).max(in_a_tick_m)
            + speed * (lost + late).as_secs_f32();
        let within = if tolerance_m > 0.0 {
            // What the viewer can hardly tell is not told to it.
            let away_m =
                pair.viewer.pose.eye.distance(other.pose.eye) + speed * bound.as_secs_f32();
            Within::new(tolerance_m, engine.acuity_m(pair.viewer.avatar, away_m) + untold_m)
        } else {
            Within::new(0.0, untold_m)
        };
        let age = other.past.age_within(shown.pose.eye, within);
        // A place where it was not for so long is older than that.
        let age = age.unwrap_or(bound + PAST_SPARE);
        self.ages += 1;
        self.age_sum += age;
        self.age_worst = self.age_worst.max(age);
        if age > bound {
            let [age_ms, bound_ms] = [age, bound].map(|time| time.as_secs_f64() * 1e3);
            let off_m = other.past.distance_m(shown.pose.eye);
            self.stale.push(StalePosition { what: pair.missed(), age_ms, bound_ms, off_m });
        }
    }
}
