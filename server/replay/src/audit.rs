//! What clients hold, compared with what rays say is visible.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use sightline_visibility::rooms::{RoomIndex, SealedRooms};
use sightline_world::{
    World,
    geometry::Aabb,
    motion::{Agility, AvatarId, Body},
};

use super::{
    OracleReport, OracleStride, ReplayOptions,
    clients::{Client, Clients},
    foresight::{Able, Walk, foresees},
    wire::Wire,
};
use sightline_cli::trace::Trace;
use sightline_oracle::Oracle;

/// Points looked for on each axis of a body's box.
const SAMPLES: u32 = 3;
/// Pairs that the oracle looks at in a run when it chooses the stride itself: about 20 s of CPU.
const PAIRS_MAX: u64 = 1_000_000;

/// Looks at every pair from time to time.
pub(super) struct Audit {
    sight: Oracle,
    /// What the building's author lets be seen, if anything is ruled out.
    author: Option<Author>,
    body: Body,
    stride: Duration,
    next: Duration,
    /// For so long after coming or jumping nobody can be expected to be known, or to know.
    unsettled: Duration,
    tally: OracleReport,
    ages: u64,
    age_sum: Duration,
    /// Avatars in sight or not, in all looks, of those that are settled.
    avatars: u64,
    hidden: u64,
    hidden_reports: u64,
    hidden_held: u64,
    /// For each walk: how far ahead, and what a body can do.
    tick: Duration,
    agility: Agility,
    look_ahead: bool,
}

/// What is visible is so by the author's word too: what rooms deny is nobody's miss.
struct Author {
    world: Arc<World>,
    rooms: RoomIndex,
}

impl Author {
    fn new(world: &Arc<World>) -> Option<Self> {
        let rooms = RoomIndex::new(world);
        rooms.rules().then(|| Self { world: Arc::clone(world), rooms })
    }

    /// Whether one looker may see another, whose body is a box. Sealed rooms go by what the server
    /// knows, so both must have been there for a while.
    fn lets(&self, viewer: &Looker<'_>, other: &Looker<'_>, body: &Aabb) -> bool {
        let cells = &self.world.cells;
        let place = |region: &Aabb| self.rooms.overlap(cells, &[cells.axes.own_box(region)]);
        let eye = place(&Aabb::around(viewer.eye, 0.0));
        let mut seals = viewer.seals.iter().chain(&other.seals);
        seals.all(|seal| seal.agrees(&viewer.seals[0])) && self.rooms.may_see(&eye, &place(body))
    }
}

/// A visible avatar of which its viewer knew too little.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StalePosition {
    /// Who of whom, and when.
    #[serde(flatten)]
    pub what: MissedAvatar,
    /// How old what it knew was.
    pub age_ms: f64,
    /// How old it may be.
    pub bound_ms: f64,
}

/// A visible avatar of which its viewer did not know.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MissedAvatar {
    /// When, in the trace's time.
    pub t_ms: f64,
    /// The trace's id of who sees.
    pub viewer: u32,
    /// The trace's id of who is seen.
    pub avatar: u32,
}

impl MissedAvatar {
    fn new(now: Duration, viewer: &Looker<'_>, other: &Looker<'_>) -> Self {
        let t_ms = now.as_secs_f64() * 1e3;
        Self { t_ms, viewer: viewer.walker, avatar: other.walker }
    }
}

/// How many misses are told one by one.
const MISSES_TOLD: usize = 10;

struct Looker<'a> {
    avatar: AvatarId,
    walker: u32,
    eye: Vec3,
    settled: bool,
    late: bool,
    reports: u32,
    walk: Walk,
    /// The sealed rooms that it is in, and was in before the server can have heard and told of it.
    seals: [SealedRooms; 2],
    replica: &'a BTreeMap<AvatarId, Duration>,
}

/// What one viewer's pairs add up to.
#[derive(Default)]
struct Sums {
    visible: u64,
    held: u64,
    foreseen: u64,
    misses: Vec<MissedAvatar>,
    misses_after_jumps: u64,
    misses_late: u64,
    ages: u64,
    age_sum: Duration,
    age_worst: Duration,
    stale: Vec<StalePosition>,
    /// Those in sight, by their place among all.
    seen: Vec<usize>,
}

impl Audit {
    pub(super) fn new(world: &Arc<World>, trace: &Trace, options: &ReplayOptions) -> Option<Self> {
        let stride = match options.oracle {
            OracleStride::Off => return None,
            OracleStride::Every(stride) => stride,
            OracleStride::Auto => stride(trace, options),
        };
        let tick = options.config.tick;
        let speed_max = options.config.speed_max.unwrap_or(world.speed_max);
        let network = &options.network;
        let round_trip_max = options.round_trip + network.spread + network.drift;
        let mut unsettled = 2 * (round_trip_max + options.network.jitter) + 4 * tick;
        if options.network.loss > 0.0 {
            // The first reports after a join may be lost, and before them there are none.
            unsettled += round_trip_max + 4 * tick;
        }
        Some(Self {
            sight: Oracle::new(&world.mesh),
            author: Author::new(world),
            body: world.body,
            stride,
            next: Duration::ZERO,
            unsettled,
            tally: OracleReport {
                stride_ms: stride.as_secs_f64() * 1e3,
                age_bound_ms: (round_trip_max + 2 * (tick + options.network.jitter)).as_secs_f64()
                    * 1e3,
                ..OracleReport::default()
            },
            ages: 0,
            age_sum: Duration::ZERO,
            avatars: 0,
            hidden: 0,
            hidden_reports: 0,
            hidden_held: 0,
            tick,
            look_ahead: options.look_ahead,
            agility: Agility::of(&world.body, speed_max),
        })
    }

    /// Compares, if it is time to.
    pub(super) fn look(&mut self, now: Duration, clients: &Clients<'_>, wire: &Wire) {
        if now < self.next {
            return;
        }
        self.next = now + self.stride;
        let lookers: Vec<Looker<'_>> = clients
            .present()
            .map(|client| Looker {
                avatar: client.avatar,
                walker: clients.trace_id(client.avatar),
                eye: client.eye,
                settled: client.settled + self.unsettled <= now,
                late: wire.is_late(now, client.avatar),
                reports: client.reports,
                walk: self.walk(now, client, clients, wire),
                seals: self.seals(now, client, clients),
                replica: &client.replica,
            })
            .collect();
        let look = |viewer| self.look_from(now, viewer, &lookers, wire);
        let sums: Vec<Sums> = lookers.par_iter().map(look).collect();
        self.tally.instants += 1;
        sums.iter().for_each(|sums| self.add(sums));
        let mut hidden = vec![true; lookers.len()];
        sums.iter().flat_map(|sums| &sums.seen).for_each(|place| hidden[*place] = false);
        let held: BTreeSet<AvatarId> =
            lookers.iter().flat_map(|looker| looker.replica.keys().copied()).collect();
        for (looker, hidden) in lookers.iter().zip(hidden).filter(|(looker, _)| looker.settled) {
            self.avatars += 1;
            self.hidden += u64::from(hidden);
            self.hidden_reports += u64::from(hidden && looker.reports > 0);
            let is_held = !looker.replica.is_empty() || held.contains(&looker.avatar);
            self.hidden_held += u64::from(hidden && is_held);
        }
    }

    /// Where a client can be in the time that the engine decides for at a tick: from its last
    /// report on until the next tick's word has come to the slowest.
    fn walk(&self, now: Duration, client: &Client, clients: &Clients<'_>, wire: &Wire) -> Walk {
        let behind = wire.round_trip(client.avatar) / 2;
        let ahead = self.tick + wire.round_trip_max() / 2;
        let pose_at = |at: Duration| clients.pose_at(client.avatar, at);
        let first = pose_at(now.saturating_sub(behind)).unwrap_or_else(|| client.pose());
        Walk {
            first: first.eye,
            now: client.eye,
            last: pose_at(now + ahead).map_or(client.eye, |pose| pose.eye),
            able: Able::new(&self.agility, first.eye, first.velocity, behind + ahead),
        }
    }

    fn seals(&self, now: Duration, client: &Client, clients: &Clients<'_>) -> [SealedRooms; 2] {
        let Some(author) = &self.author else { return Default::default() };
        let before = clients.pose_at(client.avatar, now.saturating_sub(self.unsettled / 2));
        [client.eye, before.map_or(client.eye, |pose| pose.eye)]
            .map(|eye| author.rooms.sealed_rooms_at(eye))
    }

    fn look_from(
        &self,
        now: Duration,
        viewer: &Looker<'_>,
        all: &[Looker<'_>],
        wire: &Wire,
    ) -> Sums {
        let mut sums = Sums::default();
        for (place, other) in all.iter().enumerate().filter(|(_, o)| o.avatar != viewer.avatar) {
            let held = viewer.replica.get(&other.avatar);
            let settled = viewer.settled && other.settled;
            let body = self.body.around(other.eye);
            let visible = self.sight.of_box(viewer.eye, &body, SAMPLES)
                && self.author.as_ref().is_none_or(|author| author.lets(viewer, other, &body));
            if visible {
                sums.seen.push(place);
            }
            match (visible, held) {
                (true, None) => sums.miss(now, viewer, other),
                (true, Some(sampled)) if settled && !viewer.late && !other.late => {
                    sums.compare_age(now, *sampled, (viewer, other), wire);
                }
                _ => {}
            }
            if settled {
                sums.visible += u64::from(visible);
                sums.held += u64::from(held.is_some());
                let could_be = || foresees(&self.sight, &self.body, now, &viewer.walk, &other.walk);
                sums.foreseen +=
                    u64::from(held.is_some() && (visible || self.look_ahead && could_be()));
            }
        }
        sums
    }

    fn add(&mut self, sums: &Sums) {
        let tally = &mut self.tally;
        tally.pairs_visible += sums.visible;
        tally.pairs_held += sums.held;
        tally.pairs_foreseen += sums.foreseen;
        tally.misses += sums.misses.len() as u64;
        let room = MISSES_TOLD.saturating_sub(tally.first_misses.len());
        tally.first_misses.extend(sums.misses.iter().take(room));
        tally.misses_after_jumps += sums.misses_after_jumps;
        tally.misses_late += sums.misses_late;
        tally.stale += sums.stale.len() as u64;
        let room = MISSES_TOLD.saturating_sub(tally.first_stale.len());
        tally.first_stale.extend(sums.stale.iter().take(room));
        tally.age_worst_ms = tally.age_worst_ms.max(sums.age_worst.as_secs_f64() * 1e3);
        self.ages += sums.ages;
        self.age_sum += sums.age_sum;
    }

    pub(super) fn report(self) -> OracleReport {
        let share = |part: u64, of: u64| part as f64 / of.max(1) as f64;
        let tally = self.tally;
        OracleReport {
            over_send: share(tally.pairs_held, tally.pairs_visible),
            over_send_horizon: share(tally.pairs_held, tally.pairs_foreseen),
            hidden_share: share(self.hidden, self.avatars),
            hidden_reports: share(self.hidden_reports, self.hidden),
            hidden_held: share(self.hidden_held, self.hidden),
            age_mean_ms: self.age_sum.as_secs_f64() * 1e3 / self.ages.max(1) as f64,
            ..tally
        }
    }
}

impl Sums {
    fn miss(&mut self, now: Duration, viewer: &Looker<'_>, other: &Looker<'_>) {
        if !viewer.settled || !other.settled {
            self.misses_after_jumps += 1;
        } else if viewer.late || other.late {
            self.misses_late += 1;
        } else {
            self.misses.push(MissedAvatar::new(now, viewer, other));
        }
    }

    fn compare_age(
        &mut self,
        now: Duration,
        sampled: Duration,
        (viewer, other): (&Looker<'_>, &Looker<'_>),
        wire: &Wire,
    ) {
        let (seer, seen) = (viewer.avatar, other.avatar);
        let age = now.saturating_sub(sampled);
        self.ages += 1;
        self.age_sum += age;
        self.age_worst = self.age_worst.max(age);
        let lost = wire.lost_since(sampled, seer, seen);
        let bound = wire.age_max(seer, seen) + 2 * wire.tick() * lost as u32;
        if age > bound {
            let [age_ms, bound_ms] = [age, bound].map(|time| time.as_secs_f64() * 1e3);
            self.stale.push(StalePosition {
                what: MissedAvatar::new(now, viewer, other),
                age_ms,
                bound_ms,
            });
        }
    }
}

/// Once a second, or less often for large crowds.
fn stride(trace: &Trace, options: &ReplayOptions) -> Duration {
    let (first, last) = trace.span();
    let length = last.saturating_sub(first).min(options.length.unwrap_or(Duration::MAX));
    let people = trace.ids().count() as u64;
    let instants_max = (PAIRS_MAX / (people * people).max(1)).max(4);
    let wanted = length / u32::try_from(instants_max).unwrap_or(u32::MAX);
    wanted.max(Duration::from_secs(1))
}
