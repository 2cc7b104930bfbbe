//! The audit: what clients hold, compared with what rays find visible.

mod author;
mod floor;
mod freshness;
mod look_ahead;
mod pairs;

use std::{collections::BTreeSet, sync::Arc, time::Duration};

use rayon::prelude::*;
use sightline_cli::{
    pose_error::{ErrorsByDistance, PoseErrors},
    trace::Trace,
};
use sightline_client_core::replica::BLEND;
use sightline_oracle::Oracle;
use sightline_visibility::rooms::SealedRooms;
use sightline_world::{
    World,
    motion::{Agility, AvatarId, Body},
};

use super::{
    network::SimulatedNetwork,
    options::{OracleStride, ReplayOptions},
    report::OracleReport,
    simulated_clients::{SimulatedClient, SimulatedClients},
    stations::Stations,
};
use author::AuthorRules;
use floor::{Floor, Sightings};
use freshness::{Past, Tolerances};
use look_ahead::{HorizonMotion, Reachable};
use pairs::{Participant, Scene, ViewerFindings};

/// How many pairs the audit compares in a run at most, when it chooses the stride itself. That
/// takes about 20 s of CPU time.
const PAIRS_MAX: u64 = 1_000_000;
/// However large the crowd, the audit compares at no fewer instants.
const INSTANTS_MIN: u64 = 4;
/// How many misses, and how many stale positions, are listed one by one.
const LISTED_MAX: usize = 10;
/// Stations that have found each other know all that they want to after this time and another.
const LINKING: Duration = Duration::from_secs(1);
/// Places that are older than their bound by more than this are not looked up.
const PAST_SPARE: Duration = Duration::from_secs(1);

/// Compares all pairs of a viewer and an avatar at regular instants.
pub(super) struct Audit {
    oracle: Oracle,
    /// What the building's author rules out, if anything.
    author: Option<AuthorRules>,
    body: Body,
    stride: Duration,
    /// When the next comparison is due.
    next: Duration,
    /// The time after a join or a jump in which an avatar need not be known, and need not know
    /// others.
    settling: Duration,
    /// By how much more a position may be old that comes from another station.
    bus: Duration,
    /// For so long after two stations have found each other their avatars need not know each other.
    linking: Duration,
    report: OracleReport,
    totals: Totals,
    shown_errors: PoseErrors,
    promised_errors: ErrorsByDistance,
    tolerances: Tolerances,
    sightings: Sightings,
    tick: Duration,
    agility: Agility,
    look_ahead: bool,
}

/// Sums over all instants from which shares and means follow.
#[derive(Default)]
struct Totals {
    ages: u64,
    age_sum: Duration,
    /// Settled avatars.
    avatars: u64,
    /// Those in nobody's sight.
    hidden: u64,
    /// Those in nobody's sight that reported nevertheless.
    hidden_reports: u64,
    /// Those in nobody's sight that a client held, or whose client held another.
    hidden_held: u64,
}

impl Audit {
    /// `None` when the options switch the audit off.
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
        let bus = options.stations.longest_way();
        let age_bound = round_trip_max + 2 * (tick + network.jitter) + bus;
        Some(Self {
            oracle: Oracle::new(&world.mesh),
            author: AuthorRules::new(world),
            body: world.body,
            stride,
            next: Duration::ZERO,
            settling: settling(options),
            bus,
            linking: settling(options) + LINKING,
            report: OracleReport {
                stride_ms: stride.as_secs_f64() * 1e3,
                age_bound_ms: age_bound.as_secs_f64() * 1e3,
                ..OracleReport::default()
            },
            totals: Totals::default(),
            shown_errors: PoseErrors::default(),
            promised_errors: ErrorsByDistance::default(),
            tolerances: Tolerances::default(),
            sightings: Sightings::default(),
            tick,
            look_ahead: options.look_ahead,
            agility: Agility::of(&world.body, speed_max),
        })
    }

    /// Compares all pairs, if it is time to.
    pub(super) fn look(
        &mut self,
        now: Duration,
        clients: &SimulatedClients<'_>,
        network: &SimulatedNetwork,
        stations: &Stations,
    ) {
        let oldest = now.saturating_sub(network.age_bound_max());
        self.tolerances.add([now, oldest], stations);
        if now < self.next {
            return;
        }
        self.next = now + self.stride;
        let participant = |client| self.participant(now, client, clients, network);
        let participants: Vec<Participant<'_>> = clients.present().map(participant).collect();
        let tolerances = &self.tolerances;
        let scene = Scene { now, all: &participants, clients, network, tolerances, stations };
        let look = |viewer| self.look_from(viewer, &scene);
        let findings: Vec<ViewerFindings> = participants.par_iter().map(look).collect();
        self.report.instants += 1;
        findings.iter().for_each(|findings| self.add(findings));
        self.count_hidden(now, &participants, &findings);
    }

    fn participant<'a>(
        &self,
        now: Duration,
        client: &'a SimulatedClient,
        clients: &SimulatedClients<'_>,
        network: &SimulatedNetwork,
    ) -> Participant<'a> {
        let since = now.saturating_sub(network.age_bound_max() + PAST_SPARE);
        Participant {
            avatar: client.avatar,
            trace_id: clients.trace_id(client.avatar),
            pose: client.pose,
            past: Past::new(clients, client, [now, since], self.tick),
            is_settled: client.settled_at + self.settling <= now,
            is_joined: client.settled_at + self.settling + 2 * BLEND <= now,
            is_late: network.is_late(now, client.avatar),
            reports: client.reports,
            motion: self.motion(now, client, clients, network),
            sealed_rooms: self.sealed_rooms(now, client, clients),
            replica: &client.replica,
        }
    }

    /// Where an avatar can be in the time for which the engine decides at a tick: from its last
    /// report on, until what the next tick tells has reached the slowest client.
    fn motion(
        &self,
        now: Duration,
        client: &SimulatedClient,
        clients: &SimulatedClients<'_>,
        network: &SimulatedNetwork,
    ) -> HorizonMotion {
        let behind = network.round_trip(client.avatar) / 2;
        let ahead = self.tick + network.round_trip_max() / 2;
        let pose_at = |at: Duration| clients.pose_at(client.avatar, at);
        let first = pose_at(now.saturating_sub(behind)).unwrap_or(client.pose);
        let time = behind + ahead;
        HorizonMotion {
            first: first.eye,
            now: client.pose.eye,
            last: pose_at(now + ahead).map_or(client.pose.eye, |pose| pose.eye),
            reachable: Reachable::new(&self.agility, first.eye, first.velocity, time),
        }
    }

    /// The sealed rooms that an avatar is in, and those that it was in before the server can have
    /// heard of a change and told others.
    fn sealed_rooms(
        &self,
        now: Duration,
        client: &SimulatedClient,
        clients: &SimulatedClients<'_>,
    ) -> [SealedRooms; 2] {
        let Some(author) = &self.author else { return Default::default() };
        let eye = client.pose.eye;
        let before = clients.pose_at(client.avatar, now.saturating_sub(self.settling / 2));
        [eye, before.map_or(eye, |pose| pose.eye)].map(|eye| author.sealed_rooms_at(eye))
    }

    fn add(&mut self, findings: &ViewerFindings) {
        let report = &mut self.report;
        report.pairs_visible += findings.visible;
        report.pairs_abroad += findings.abroad;
        report.pairs_held += findings.held;
        report.pairs_foreseen += findings.foreseen;
        report.misses += findings.misses.len() as u64;
        let room = LISTED_MAX.saturating_sub(report.first_misses.len());
        report.first_misses.extend(findings.misses.iter().take(room));
        report.misses_after_jumps += findings.misses_after_jumps;
        report.misses_late += findings.misses_late;
        report.stale += findings.stale.len() as u64;
        let room = LISTED_MAX.saturating_sub(report.first_stale.len());
        report.first_stale.extend(findings.stale.iter().take(room));
        report.age_worst_ms = report.age_worst_ms.max(findings.age_worst.as_secs_f64() * 1e3);
        self.shown_errors.append(&findings.shown_errors);
        self.promised_errors.append(&findings.promised_errors);
        self.totals.ages += findings.ages;
        self.totals.age_sum += findings.age_sum;
    }

    /// Counts the settled avatars in nobody's sight, and those of them that are not silent.
    fn count_hidden(
        &mut self,
        now: Duration,
        participants: &[Participant<'_>],
        findings: &[ViewerFindings],
    ) {
        assert_eq!(participants.len(), findings.len(), "each participant is a viewer");
        let mut is_hidden = vec![true; participants.len()];
        findings.iter().flat_map(|f| &f.seen).for_each(|place| is_hidden[*place] = false);
        let sightings = participants.iter().zip(&is_hidden).map(|(p, hid)| (p.trace_id, !hid));
        self.sightings.add(now, sightings);
        let held: BTreeSet<AvatarId> =
            participants.iter().flat_map(|p| p.replica.held(now).map(|held| held.id)).collect();
        let settled = participants.iter().zip(is_hidden).filter(|(p, _)| p.is_settled);
        for (participant, is_hidden) in settled {
            self.totals.avatars += 1;
            self.totals.hidden += u64::from(is_hidden);
            self.totals.hidden_reports += u64::from(is_hidden && participant.reports > 0);
            let is_held = participant.replica.held_len() > 0 || held.contains(&participant.avatar);
            self.totals.hidden_held += u64::from(is_hidden && is_held);
        }
    }

    /// What was found in the whole run.
    pub(super) fn report(self, clients: &SimulatedClients<'_>) -> OracleReport {
        let Floor { reports, hidden_share } = self.sightings.floor(clients, self.tick);
        let shown = self.shown_errors.percentiles();
        let promised = self.promised_errors.percentiles();
        let share = |part: u64, of: u64| part as f64 / of.max(1) as f64;
        let (report, totals) = (self.report, self.totals);
        debug_assert!(report.pairs_foreseen <= report.pairs_held, "foreseen pairs are held");
        OracleReport {
            over_send: share(report.pairs_held, report.pairs_visible),
            over_send_horizon: share(report.pairs_held, report.pairs_foreseen),
            hidden_share: share(totals.hidden, totals.avatars),
            hidden_reports: share(totals.hidden_reports, totals.hidden),
            hidden_held: share(totals.hidden_held, totals.hidden),
            floor_reports: reports,
            floor_hidden_share: hidden_share,
            shown_error_p50_m: shown.p50_m,
            shown_error_p99_m: shown.p99_m,
            shown_error_p50_deg: shown.p50_deg,
            shown_error_p99_deg: shown.p99_deg,
            promised_error_p50_m: promised.p50_m,
            promised_error_p99_m: promised.p99_m,
            promised_error_p50_deg: promised.p50_deg,
            promised_error_p99_deg: promised.p99_deg,
            promised_errors_by_distance: self.promised_errors.bands(),
            age_mean_ms: totals.age_sum.as_secs_f64() * 1e3 / totals.ages.max(1) as f64,
            ..report
        }
    }
}

/// The time after a join or a jump within which misses are excused: two round trips and four ticks;
/// where messages are lost, one more round trip and four more ticks.
fn settling(options: &ReplayOptions) -> Duration {
    let (network, tick) = (&options.network, options.config.tick);
    let round_trip_max = options.round_trip + network.spread + network.drift;
    let mut settling = 2 * (round_trip_max + network.jitter) + 4 * tick;
    if options.stations.count > 1 {
        // Another station is told of a newcomer, and tells of its own, once it has been asked.
        settling += 4 * (options.stations.longest_way() + tick);
    }
    if network.loss > 0.0 {
        // The first reports after a join may be lost, and there were none before them.
        return settling + round_trip_max + 4 * tick;
    }
    settling
}

/// The automatic stride: once a second, or less often for large crowds.
fn stride(trace: &Trace, options: &ReplayOptions) -> Duration {
    let (first, last) = trace.span();
    let length = last.saturating_sub(first).min(options.length.unwrap_or(Duration::MAX));
    let people = trace.ids().count() as u64;
    let instants_max = (PAIRS_MAX / (people * people).max(1)).max(INSTANTS_MIN);
    let wanted = length / u32::try_from(instants_max).unwrap_or(u32::MAX);
    wanted.max(Duration::from_secs(1))
}
