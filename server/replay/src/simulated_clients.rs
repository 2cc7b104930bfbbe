//! Simulated clients: each follows the trace, and reports as a real client does.

use std::{collections::BTreeMap, time::Duration};

use glam::Vec3;
use sightline_cli::trace::Trace;
use sightline_client_core::{
    replica::{Event, Outgoing, Replica},
    reporting::{ReportReason, ReportingCounts},
};
use sightline_engine::{Claim, ClaimLimits, ClaimVerdict, Engine, MovementBudget};
use sightline_protocol::{
    VERSION,
    message::{ClientMessage, ServerMessage},
    pose_stream::{Ack, ClientDatagram},
    quantise::{WirePose, WireReport, WireTolerance},
    text::Name,
};
use sightline_world::{
    geometry::Confines,
    motion::{Agility, AvatarId, Pose, ReportingState, Tolerance},
    tolerance::WIRE_POSE_M,
};

use super::{
    network::SimulatedNetwork,
    options::ClientFaults,
    packets::{COLOUR, Payload, ReportKind, Request, Uplink, unframe},
};

/// How long a client takes to come back to another station.
const BACK_AFTER: Duration = Duration::from_secs(1);

/// The client of one avatar, from its join to its leave.
#[derive(Clone, Debug)]
pub(super) struct SimulatedClient {
    pub(super) avatar: AvatarId,
    /// The avatar's true pose: that of the trace at `at`.
    pub(super) pose: Pose,
    /// When `pose` was looked up.
    at: Duration,
    /// When the avatar joined or last jumped.
    pub(super) settled_at: Duration,
    /// What the client knows of the others. It decides when the client reports.
    pub(super) replica: Replica,
    /// Whether the avatar moved as no body can, and its client has not announced that yet.
    has_jumped: bool,
    /// Where the client's last report puts the eye.
    claimed_eye: Vec3,
    /// That report; `None` before the first one.
    last_report: Option<SentReport>,
    /// The server's movement budget for this client, kept here as well.
    budget: MovementBudget,
    /// How many claims the budget has judged.
    claims: u64,
    /// How many reports it made between its last two ticks.
    pub(super) reports: u32,
    /// How many reports it has made since its last tick.
    reports_since_tick: u32,
    /// Whether it kept silent about a departure at its last tick, by an injected fault.
    is_departure_untold: bool,
}

/// The last report of a client.
#[derive(Clone, Copy, Debug)]
struct SentReport {
    /// The client's time in it.
    made: u32,
    kind: ReportKind,
    sent: Duration,
}

impl SimulatedClient {
    /// A client that asks to join now.
    fn new(now: Duration, pose: &Pose, replica: Replica) -> Self {
        Self {
            avatar: replica.avatar(),
            pose: *pose,
            at: now,
            settled_at: now,
            replica,
            has_jumped: false,
            claimed_eye: pose.eye,
            last_report: None,
            budget: MovementBudget::new(now),
            claims: 0,
            reports: 0,
            reports_since_tick: 0,
            is_departure_untold: false,
        }
    }

    /// Moves the avatar to its pose in the trace.
    fn follow(&mut self, now: Duration, pose: &Pose, agility: &Agility) {
        debug_assert!(self.at <= now, "{:?} goes back in time", self.avatar);
        let elapsed = now.saturating_sub(self.at);
        let before = self.pose;
        let reachable = agility.eyes(before.eye, before.velocity, elapsed).grown(WIRE_POSE_M);
        self.has_jumped |= !reachable.contains(pose.eye);
        (self.pose, self.at) = (*pose, now);
        self.replica.set_pose(*pose);
    }

    /// Whether the server would accept the next claim, by its speed alone: walls do not count, and
    /// nor does the TBV.
    fn is_believed(&mut self, now: Duration, claim: &Pose, limits: &ClaimLimits) -> bool {
        self.claims += 1;
        let made = Duration::from_nanos(self.claims);
        let claim = Claim::new(made, claim, self.claimed_eye, Duration::ZERO);
        let no_walls = |_| Some(0.0);
        let verdict = self.budget.judge(now, &claim, limits, no_walls);
        verdict == ClaimVerdict::Accepted
    }

    /// What the client sends at its tick.
    fn act(
        &mut self,
        now: Duration,
        round_trip: Duration,
        faults: &ClientFaults,
    ) -> Option<Outgoing> {
        let departs =
            faults.departures_late && self.replica.report_due(now) == Some(ReportReason::Departed);
        self.is_departure_untold = departs && !self.is_departure_untold;
        if self.is_departure_untold { None } else { self.replica.tick(now, round_trip) }
    }

    /// Takes in what has arrived. Returns whether the server has ended the connection.
    ///
    /// # Panics
    /// When the bytes break the protocol.
    fn receive(&mut self, at: Duration, payload: &Payload, faults: &ClientFaults) -> bool {
        let event = match payload {
            Payload::Datagram(bytes) => {
                self.replica.datagram(at, bytes).expect("a datagram that was just encoded");
                return false;
            }
            Payload::Frame(bytes) => {
                let mut message = unframe(bytes, ServerMessage::decode);
                if let ServerMessage::Live { tolerance } = &mut message
                    && faults.tolerance_scale != 1.0
                {
                    *tolerance = scaled(*tolerance, faults.tolerance_scale);
                }
                self.replica.message(at, message).expect("a message in its place")
            }
        };
        match event {
            Some(Event::Goodbye(_)) => return true,
            // The trace is the truth, so the client announces that its avatar is elsewhere.
            Some(Event::Corrected(_)) => self.has_jumped = true,
            _ => {}
        }
        self.replica.set_pose(self.pose);
        false
    }
}

/// The report and the acknowledgement in a message, if it has a report.
fn report_in(outgoing: &Outgoing) -> Option<(WireReport, Ack)> {
    match outgoing {
        Outgoing::Message(ClientMessage::Report { report, ack }) => Some((*report, *ack)),
        Outgoing::Message(_) => None,
        Outgoing::Datagram(bytes) => {
            let ClientDatagram { ack, report } = ClientDatagram::decode(bytes).ok()?;
            Some((report?, ack))
        }
    }
}

/// All simulated clients, and which avatar of the trace belongs to each.
pub(super) struct SimulatedClients<'a> {
    trace: &'a Trace,
    agility: Agility,
    limits: ClaimLimits,
    confines: Confines,
    tick: Duration,
    /// The present clients, by the trace's ids.
    present: BTreeMap<u32, SimulatedClient>,
    /// The trace's id of each avatar there ever was, by [`AvatarId`].
    trace_ids: Vec<u32>,
    /// For how many ticks each client that has left was in each state.
    counts: BTreeMap<AvatarId, ReportingCounts>,
    jumps: u64,
    left_tbv: u64,
    outside: u64,
    /// When the clients whose station has stopped come back.
    back_at: BTreeMap<u32, Duration>,
    faults: ClientFaults,
}

impl<'a> SimulatedClients<'a> {
    pub(super) fn new(trace: &'a Trace, engine: &Engine, faults: ClientFaults) -> Self {
        Self {
            trace,
            faults,
            agility: engine.agility(),
            limits: engine.limits(),
            // Rounding on the wire leaves no eye outside the world.
            confines: engine.world().confines().grown(-WIRE_POSE_M),
            tick: engine.config().tick,
            present: BTreeMap::new(),
            trace_ids: Vec::new(),
            counts: BTreeMap::new(),
            jumps: 0,
            left_tbv: 0,
            outside: 0,
            back_at: BTreeMap::new(),
        }
    }

    /// Ends the clients whose connection is broken. They come back a while later as newcomers.
    pub(super) fn disconnect(&mut self, now: Duration, is_connected: impl Fn(AvatarId) -> bool) {
        let broken = self.present.iter().filter(|(_, client)| !is_connected(client.avatar));
        let broken: Vec<u32> = broken.map(|(id, _)| *id).collect();
        for id in broken {
            self.remove(id);
            self.back_at.insert(id, now + BACK_AFTER);
        }
    }

    /// The trace's id of an avatar.
    pub(super) fn trace_id(&self, avatar: AvatarId) -> u32 {
        self.trace_ids[avatar.0 as usize]
    }

    /// The present clients, in ascending order of the trace's ids.
    pub(super) fn present(&self) -> impl Iterator<Item = &SimulatedClient> {
        self.present.values()
    }

    /// When a present avatar joined or last jumped.
    pub(super) fn settled_at(&self, avatar: AvatarId) -> Option<Duration> {
        let client = self.present.get(&self.trace_id(avatar));
        client.filter(|client| client.avatar == avatar).map(|client| client.settled_at)
    }

    /// How many movements were announced as jumps: those that no body can make, and those that the
    /// server would not believe.
    pub(super) fn jumps(&self) -> u64 {
        self.jumps
    }

    /// How many reports quiet clients made unasked, because they were about to leave their TBVs.
    pub(super) fn left_tbv(&self) -> u64 {
        self.left_tbv
    }

    /// How many samples of the trace lay outside the world, and were moved to its edge.
    pub(super) fn outside(&self) -> u64 {
        self.outside
    }

    /// For how many of its ticks in the world a client was quiet, or on course.
    pub(super) fn counts(&self, avatar: AvatarId) -> ReportingCounts {
        let client = self.present.get(&self.trace_id(avatar)).filter(|c| c.avatar == avatar);
        let counts = client.map(|client| client.replica.reporting_counts());
        counts.or_else(|| self.counts.get(&avatar).copied()).unwrap_or_default()
    }

    /// The true pose of an avatar at a time; `None` when the trace has none then.
    pub(super) fn pose_at(&self, avatar: AvatarId, at: Duration) -> Option<Pose> {
        self.pose_of(self.trace_id(avatar), at)
    }

    /// The true pose of an avatar at a time, by the trace's id; `None` when the trace has none
    /// then.
    pub(super) fn pose_of(&self, id: u32, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(id, at, self.agility.fall_max)?;
        Some(Pose { eye: self.confines.clamp(pose.eye), ..pose })
    }

    /// Takes each client through one of its ticks. Returns what they send.
    pub(super) fn step(&mut self, now: Duration, network: &SimulatedNetwork) -> Vec<Uplink> {
        let mut sent = Vec::new();
        for client in self.present.values_mut() {
            client.reports = std::mem::take(&mut client.reports_since_tick);
        }
        for id in self.trace.ids() {
            let pose = self.look_up(id, now);
            match (pose, self.present.contains_key(&id)) {
                (Some(_), false) if self.back_at.get(&id).is_some_and(|at| now < *at) => {}
                (Some(pose), false) => sent.extend(self.join(id, now, &pose)),
                (Some(pose), true) => sent.extend(self.tick(id, now, &pose, network)),
                (None, true) => sent.extend(self.leave(id, now)),
                (None, false) => {}
            }
        }
        sent
    }

    /// Delivers a message to a client. Returns the answer to an ask, which it sends at once.
    pub(super) fn receive(
        &mut self,
        at: Duration,
        to: AvatarId,
        payload: &Payload,
    ) -> Option<Uplink> {
        let id = self.trace_id(to);
        let client = self.present.get_mut(&id).filter(|client| client.avatar == to)?;
        if client.receive(at, payload, &self.faults) {
            self.remove(id);
            return None;
        }
        if matches!(payload, Payload::Datagram(_)) {
            return None;
        }
        let pose = self.look_up(id, at)?;
        let client = self.present.get_mut(&id)?;
        client.follow(at, &pose, &self.agility);
        let answer = client.replica.answer(at)?;
        Some(self.send_report(id, at, ReportKind::ByException, Outgoing::Message(answer)))
    }

    /// The pose of an avatar in the trace, within the world.
    fn look_up(&mut self, id: u32, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(id, at, self.agility.fall_max)?;
        let eye = self.confines.clamp(pose.eye);
        self.outside += u64::from(eye != pose.eye);
        Some(Pose { eye, ..pose })
    }

    fn join(&mut self, id: u32, now: Duration, pose: &Pose) -> [Uplink; 2] {
        let avatar = AvatarId(self.trace_ids.len() as u32);
        self.trace_ids.push(id);
        let replica = Replica::new(avatar, self.tick, self.agility);
        let replaced = self.present.insert(id, SimulatedClient::new(now, pose, replica));
        debug_assert!(replaced.is_none(), "{id} joins twice");
        let name = Name::clipped(&format!("walker {id}"));
        let hello = ClientMessage::Hello {
            version: VERSION,
            name,
            colour: COLOUR,
            invitation: None,
            secret: None,
        };
        let place = Some(on_wire(pose).eye.into());
        let enter = ClientMessage::Enter { world: 1, place, reports_from: 0 };
        [hello, enter].map(|message| Uplink::new(avatar, now, Outgoing::Message(message)))
    }

    fn leave(&mut self, id: u32, now: Duration) -> Option<Uplink> {
        let avatar = self.remove(id)?;
        Some(Uplink::new(avatar, now, Outgoing::Message(ClientMessage::Goodbye)))
    }

    /// Forgets a client, but not what it counted.
    fn remove(&mut self, id: u32) -> Option<AvatarId> {
        let client = self.present.remove(&id)?;
        self.counts.insert(client.avatar, client.replica.reporting_counts());
        Some(client.avatar)
    }

    /// Moves an avatar to its pose in the trace. Returns what its client sends at its tick.
    fn tick(
        &mut self,
        id: u32,
        now: Duration,
        pose: &Pose,
        network: &SimulatedNetwork,
    ) -> Option<Uplink> {
        let client = self.present.get_mut(&id)?;
        client.follow(now, pose, &self.agility);
        let was_quiet = client.replica.reporting_state() == Some(ReportingState::Quiet);
        let round_trip = network.round_trip(client.avatar);
        let kind = ReportKind::of(client.replica.report_due(now));
        client.replica.hear_losses(now, network.known_losses(now, client.avatar));
        let outgoing = client.act(now, round_trip, &self.faults);
        client.replica.reporting_state()?;
        let report = outgoing.as_ref().and_then(report_in).map(|(report, _)| report);
        if !client.has_jumped {
            let Some(report) = report else {
                return outgoing.map(|outgoing| Uplink::new(client.avatar, now, outgoing));
            };
            if let Some(SentReport { made, kind, sent }) = client.last_report
                && made == report.made
            {
                // The last report goes once more.
                return Some(Uplink { kind, ..Uplink::new(client.avatar, sent, outgoing?) });
            }
        }
        let is_report = report.is_some();
        let is_valid = client.replica.tbv().is_some_and(|tbv| now + self.tick <= tbv.expiry);
        let uplink = match outgoing {
            Some(outgoing) if is_report => self.send_report(id, now, kind, outgoing),
            // An acknowledgement goes with the jump.
            Some(Outgoing::Datagram(bytes)) => {
                let ack = ClientDatagram::decode(&bytes).ok().map(|datagram| datagram.ack);
                self.jump(id, now, ack)
            }
            _ => self.jump(id, now, None),
        };
        let is_jump = matches!(uplink.request, Request::Relocate { .. });
        self.left_tbv += u64::from(was_quiet && is_valid && !is_jump);
        Some(uplink)
    }

    /// Sends a report, if the server will believe it. Otherwise the client announces a jump.
    fn send_report(
        &mut self,
        id: u32,
        now: Duration,
        kind: ReportKind,
        outgoing: Outgoing,
    ) -> Uplink {
        let (client, report) = (self.present.get_mut(&id), report_in(&outgoing));
        let (client, (report, ack)) = client.zip(report).expect("a report of a present client");
        let pose = Pose::from(report.pose);
        if client.has_jumped || !client.is_believed(now, &pose, &self.limits) {
            return self.jump(id, now, Some(ack));
        }
        client.claimed_eye = pose.eye;
        client.last_report = Some(SentReport { made: report.made, kind, sent: now });
        client.reports_since_tick += 1;
        Uplink { kind, ..Uplink::new(client.avatar, now, outgoing) }
    }

    /// Announces that an avatar was put elsewhere. Its course begins anew.
    fn jump(&mut self, id: u32, now: Duration, ack: Option<Ack>) -> Uplink {
        let client = self.present.get_mut(&id).expect("the client is present");
        let pose = on_wire(&client.pose);
        self.jumps += 1;
        client.has_jumped = false;
        client.replica.forget_course();
        client.budget.relocate(now, pose.velocity);
        client.settled_at = now;
        client.claimed_eye = pose.eye;
        client.reports_since_tick += 1;
        let request = Request::Relocate { pose, ack };
        let (avatar, kind) = (client.avatar, ReportKind::ByException);
        Uplink { avatar, sent: now, kind, request }
    }
}

/// A tolerance with its length and its angle multiplied by `scale`.
fn scaled(tolerance: WireTolerance, scale: f32) -> WireTolerance {
    let Tolerance { metres, radians, ahead } = tolerance.into();
    (&Tolerance { metres: metres * scale, radians: radians * scale, ahead }).into()
}

/// A pose as the server decodes it.
fn on_wire(pose: &Pose) -> Pose {
    WirePose::from(pose).into()
}
