//! Simulated clients: each follows the trace, and reports as a real client does.

use std::{collections::BTreeMap, time::Duration};

use glam::Vec3;
use sightline_cli::trace::Trace;
use sightline_client_core::reporting::{ReportReason, Reporter};
use sightline_engine::{Claim, ClaimLimits, ClaimVerdict, Engine, MovementBudget};
use sightline_protocol::{pose_stream::Ack, quantise::WirePose};
use sightline_world::{
    geometry::Confines,
    motion::{Agility, AvatarId, Pose},
    tolerance::WIRE_POSE_M,
};

use super::packets::{Downlink, Request, Uplink};

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
    /// The avatars that the client holds, and when each one's position was sampled.
    pub(super) replica: BTreeMap<AvatarId, Duration>,
    reporter: Reporter,
    /// Whether the avatar moved as no body can, and its client has not announced that yet.
    has_jumped: bool,
    /// Where the client's last report puts the eye.
    claimed_eye: Vec3,
    /// The server's movement budget for this client, kept here as well.
    budget: MovementBudget,
    sequence: u32,
    ack: Ack,
    /// How many reports it made between its last two ticks.
    pub(super) reports: u32,
    /// How many reports it has made since its last tick.
    reports_since_tick: u32,
}

impl SimulatedClient {
    /// A client that asks to join now.
    fn new(avatar: AvatarId, now: Duration, pose: &Pose, reporter: Reporter) -> Self {
        Self {
            avatar,
            pose: *pose,
            at: now,
            settled_at: now,
            replica: BTreeMap::new(),
            reporter,
            has_jumped: false,
            claimed_eye: pose.eye,
            budget: MovementBudget::new(now),
            sequence: 0,
            ack: Ack::default(),
            reports: 0,
            reports_since_tick: 0,
        }
    }

    /// Whether the server would accept the next claim, by its speed alone: walls do not count, and
    /// nor does the TBV.
    fn is_believed(&mut self, now: Duration, claim: &Pose, limits: &ClaimLimits) -> bool {
        self.sequence += 1;
        let claim = Claim::new(self.sequence, claim, self.claimed_eye, Duration::ZERO);
        let no_walls = |_| Some(0.0);
        let verdict = self.budget.judge(now, &claim, limits, no_walls);
        verdict == ClaimVerdict::Accepted
    }

    /// Takes in a message that asks for no answer.
    fn receive(&mut self, at: Duration, downlink: &Downlink) {
        match downlink {
            Downlink::Entered => self.reporter.enter(),
            Downlink::Appear(avatar, sampled) => {
                self.replica.insert(*avatar, *sampled);
            }
            Downlink::Vanish(avatar) => {
                self.replica.remove(avatar);
            }
            Downlink::Poses { sequences, poses } => {
                self.ack = sequences.clone().fold(self.ack, acknowledging);
                for (avatar, sampled) in poses {
                    if let Some(held) = self.replica.get_mut(avatar) {
                        *held = (*sampled).max(*held);
                    }
                }
            }
            Downlink::Quiet(tbv) => self.reporter.expect_silence(*tbv, at),
            Downlink::Live => self.reporter.expect_reports(at),
            Downlink::Correct => self.has_jumped = true,
            Downlink::Ask | Downlink::Drop => {}
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
    jumps: u64,
    left_tbv: u64,
    outside: u64,
}

impl<'a> SimulatedClients<'a> {
    pub(super) fn new(trace: &'a Trace, engine: &Engine) -> Self {
        Self {
            trace,
            agility: engine.agility(),
            limits: engine.limits(),
            confines: engine.world().confines(),
            tick: engine.config().tick,
            present: BTreeMap::new(),
            trace_ids: Vec::new(),
            jumps: 0,
            left_tbv: 0,
            outside: 0,
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

    /// The true pose of an avatar at a time; `None` when the trace has none then.
    pub(super) fn pose_at(&self, avatar: AvatarId, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(self.trace_id(avatar), at, self.agility.fall_max)?;
        Some(Pose { eye: self.confines.clamp(pose.eye), ..pose })
    }

    /// Takes each client through one of its ticks. Returns what they send.
    pub(super) fn step(&mut self, now: Duration) -> Vec<Uplink> {
        let mut sent = Vec::new();
        for client in self.present.values_mut() {
            client.reports = std::mem::take(&mut client.reports_since_tick);
        }
        for id in self.trace.ids() {
            let pose = self.look_up(id, now);
            match (pose, self.present.contains_key(&id)) {
                (Some(pose), false) => sent.push(self.join(id, now, &pose)),
                (Some(pose), true) => sent.extend(self.follow(id, now, &pose, false)),
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
        downlink: &Downlink,
    ) -> Option<Uplink> {
        let id = self.trace_id(to);
        let client = self.present.get_mut(&id).filter(|client| client.avatar == to)?;
        client.receive(at, downlink);
        let is_asked = match downlink {
            Downlink::Ask => true,
            Downlink::Live => false,
            Downlink::Drop => {
                self.present.remove(&id);
                return None;
            }
            _ => return None,
        };
        let pose = self.look_up(id, at)?;
        self.follow(id, at, &pose, is_asked)
    }

    /// The pose of an avatar in the trace, within the world.
    fn look_up(&mut self, id: u32, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(id, at, self.agility.fall_max)?;
        let eye = self.confines.clamp(pose.eye);
        self.outside += u64::from(eye != pose.eye);
        Some(Pose { eye, ..pose })
    }

    fn join(&mut self, id: u32, now: Duration, pose: &Pose) -> Uplink {
        let avatar = AvatarId(self.trace_ids.len() as u32);
        self.trace_ids.push(id);
        let reporter = Reporter::new(self.tick, self.agility);
        let client = SimulatedClient::new(avatar, now, pose, reporter);
        let replaced = self.present.insert(id, client);
        debug_assert!(replaced.is_none(), "{id} joins twice");
        let eye = self.on_wire(pose).eye;
        let request = Request::Join { name: format!("walker {id}"), eye };
        Uplink { avatar, sampled: now, ack: Ack::default(), request }
    }

    fn leave(&mut self, id: u32, now: Duration) -> Option<Uplink> {
        let client = self.present.remove(&id)?;
        let (avatar, ack) = (client.avatar, client.ack);
        Some(Uplink { avatar, sampled: now, ack, request: Request::Leave })
    }

    /// Moves an avatar to its pose in the trace. Returns a report if its client must make one.
    fn follow(&mut self, id: u32, now: Duration, pose: &Pose, is_asked: bool) -> Option<Uplink> {
        let reported = self.on_wire(pose);
        let client = self.present.get_mut(&id)?;
        debug_assert!(client.at <= now, "{id} goes back in time");
        let elapsed = now.saturating_sub(client.at);
        let before = client.pose;
        let reachable = self.agility.eyes(before.eye, before.velocity, elapsed).grown(WIRE_POSE_M);
        client.has_jumped |= !reachable.contains(pose.eye);
        (client.pose, client.at) = (*pose, now);
        if !client.reporter.is_inside() {
            return None;
        }
        if is_asked {
            client.reporter.ask();
        }
        let reason = client.reporter.due(pose);
        if reason.is_none() && !client.has_jumped {
            return None;
        }
        client.reporter.take_ask();
        let request = if std::mem::take(&mut client.has_jumped)
            || !client.is_believed(now, &reported, &self.limits)
        {
            client.budget.relocate(now, reported.velocity);
            client.settled_at = now;
            self.jumps += 1;
            Request::Relocate { pose: reported }
        } else {
            self.left_tbv += u64::from(reason == Some(ReportReason::Leaving));
            let on_stream = reason != Some(ReportReason::Live);
            Request::Report { sequence: client.sequence, pose: reported, on_stream }
        };
        client.claimed_eye = reported.eye;
        client.reports_since_tick += 1;
        Some(Uplink { avatar: client.avatar, sampled: now, ack: client.ack, request })
    }

    /// A pose as the server decodes it.
    fn on_wire(&self, pose: &Pose) -> Pose {
        let rounded = Pose::from(WirePose::from(pose));
        Pose { eye: self.confines.clamp(rounded.eye), ..rounded }
    }
}

/// An acknowledgement once a further datagram has arrived.
fn acknowledging(ack: Ack, sequence: u32) -> Ack {
    let Ack { newest, earlier } = ack;
    if sequence <= newest {
        let bit = (newest - sequence).checked_sub(1).and_then(|back| 1_u32.checked_shl(back));
        return Ack { newest, earlier: earlier | bit.unwrap_or(0) };
    }
    let ahead = sequence - newest;
    let before = if newest == 0 { 0 } else { 1_u32.checked_shl(ahead - 1).unwrap_or(0) };
    Ack { newest: sequence, earlier: earlier.checked_shl(ahead).unwrap_or(0) | before }
}
