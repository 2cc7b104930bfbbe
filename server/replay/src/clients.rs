//! Simulated clients: each does as the trace says, and reports as a real one does.

use std::{collections::BTreeMap, ops::Range, time::Duration};

use glam::Vec3;
use sightline_protocol::{
    VERSION, frame,
    message::ClientMessage,
    pose_stream::{Ack, ClientDatagram},
    quantise::WirePose,
    text::Name,
};
use sightline_world::{
    geometry::Confines,
    motion::{Agility, AvatarId, Pose, Tbv},
    tolerance::WIRE_POSE_M,
};

use sightline_cli::trace::Trace;
use sightline_engine::{ClaimLimits, ClaimVerdict, Engine, MovementBudget};

/// A message to the server.
#[derive(Clone, Debug)]
pub(super) struct Uplink {
    pub(super) avatar: AvatarId,
    /// When it was made.
    pub(super) sampled: Duration,
    /// The datagrams received.
    pub(super) ack: Ack,
    pub(super) request: Request,
}

#[derive(Clone, Debug)]
pub(super) enum Request {
    Join { name: String, eye: Vec3 },
    Leave,
    Report { sequence: u32, pose: Pose, on_stream: bool },
    Relocate { pose: Pose },
}

impl Uplink {
    /// How long each of its messages is on the wire, in bytes.
    pub(super) fn lengths(&self) -> Vec<usize> {
        let framed = |message: &ClientMessage| frame::encode(message).len();
        match &self.request {
            Request::Join { name, eye } => {
                let hello = Name::new(name).map(|name| {
                    framed(&ClientMessage::Hello { version: VERSION, name, colour: [128; 3] })
                });
                let enter = framed(&ClientMessage::Enter { place: Some((*eye).into()) });
                hello.into_iter().chain([enter]).collect()
            }
            Request::Leave => vec![framed(&ClientMessage::Goodbye)],
            Request::Report { sequence, pose, on_stream: true } => {
                vec![framed(&ClientMessage::Report { sequence: *sequence, pose: pose.into() })]
            }
            Request::Report { sequence, pose, on_stream: false } => {
                let report = Some((*sequence, pose.into()));
                vec![ClientDatagram { ack: self.ack, report }.encode().len()]
            }
            Request::Relocate { pose } => {
                vec![framed(&ClientMessage::Report { sequence: 0, pose: pose.into() })]
            }
        }
    }
}

/// A message to a client.
#[derive(Clone, Debug)]
pub(super) enum Order {
    Entered,
    /// With the time at which the pose was sampled.
    Appear(AvatarId, Duration),
    Vanish(AvatarId),
    Poses {
        /// Of the datagrams.
        sequences: Range<u32>,
        /// With the time at which each was sampled.
        poses: Vec<(AvatarId, Duration)>,
    },
    Live,
    Quiet(Tbv),
    Ask,
    Correct,
    Drop,
}

/// One client of one walker, from its coming to its going.
#[derive(Clone, Debug)]
pub(super) struct Client {
    pub(super) avatar: AvatarId,
    /// Where the walker truly is.
    pub(super) eye: Vec3,
    velocity: Vec3,
    /// When `eye` was looked up.
    at: Duration,
    /// When it came, or jumped last.
    pub(super) settled: Duration,
    /// Whom it knows of, and when what it knows was sampled.
    pub(super) replica: BTreeMap<AvatarId, Duration>,
    entered: bool,
    /// Where it must stay to be silent; `None` when live.
    tbv: Option<Tbv>,
    /// It moved as no body can, and has not said so yet.
    jumped: bool,
    /// What it said last, and how far it can be believed, as its host knows.
    claimed: Vec3,
    ledger: MovementBudget,
    sequence: u32,
    ack: Ack,
    /// How many reports it made between its last two ticks.
    pub(super) reports: u32,
    reports_next: u32,
}

impl Client {
    /// Whether the server would believe what it is about to say.
    fn is_believed(&mut self, now: Duration, claim: &Pose, limits: &ClaimLimits) -> bool {
        self.sequence += 1;
        let believed = (self.claimed, None);
        let said = (self.sequence, claim);
        let verdict = self.ledger.judge(now, said, believed, Duration::ZERO, limits, |_| Some(0.0));
        verdict == ClaimVerdict::Accepted
    }

    /// Where the walker truly is, and how it moves.
    pub(super) fn pose(&self) -> Pose {
        Pose { eye: self.eye, velocity: self.velocity, ..Pose::default() }
    }
}

/// All clients, and who they are.
pub(super) struct Clients<'a> {
    trace: &'a Trace,
    agility: Agility,
    limits: ClaimLimits,
    confines: Confines,
    tick: Duration,
    /// By the trace's ids.
    present: BTreeMap<u32, Client>,
    /// The trace's id of every avatar there was.
    walkers: Vec<u32>,
    jumps: u64,
    left: u64,
    outside: u64,
}

impl<'a> Clients<'a> {
    pub(super) fn new(trace: &'a Trace, engine: &Engine) -> Self {
        Self {
            trace,
            agility: engine.agility(),
            limits: engine.limits(),
            confines: engine.world().confines(),
            tick: engine.config().tick,
            present: BTreeMap::new(),
            walkers: Vec::new(),
            jumps: 0,
            left: 0,
            outside: 0,
        }
    }

    /// The trace's id of an avatar.
    pub(super) fn trace_id(&self, avatar: AvatarId) -> u32 {
        self.walkers[avatar.0 as usize]
    }

    /// Those who are present, by the trace's ids.
    pub(super) fn present(&self) -> impl Iterator<Item = &Client> {
        self.present.values()
    }

    /// When somebody came, or jumped last.
    pub(super) fn settled_at(&self, avatar: AvatarId) -> Option<Duration> {
        let client = self.present.get(&self.trace_id(avatar));
        client.filter(|client| client.avatar == avatar).map(|client| client.settled)
    }

    /// How often somebody moved as no body can, or further than would be believed.
    pub(super) fn jumps(&self) -> u64 {
        self.jumps
    }

    /// How often somebody reported unasked, because it was about to leave its TBV.
    pub(super) fn left(&self) -> u64 {
        self.left
    }

    /// Where the trace has a walker at some time, if it is there.
    pub(super) fn pose_at(&self, avatar: AvatarId, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(self.trace_id(avatar), at, self.agility.fall_max)?;
        Some(Pose { eye: self.confines.clamp(pose.eye), ..pose })
    }

    /// How many samples were outside the world, and taken to its edge.
    pub(super) fn outside(&self) -> u64 {
        self.outside
    }

    /// What the clients do at a tick of theirs.
    pub(super) fn step(&mut self, now: Duration) -> Vec<Uplink> {
        let mut sent = Vec::new();
        for client in self.present.values_mut() {
            client.reports = std::mem::take(&mut client.reports_next);
        }
        for walker in self.trace.ids() {
            let pose = self.look_up(walker, now);
            match (pose, self.present.contains_key(&walker)) {
                (Some(pose), false) => sent.push(self.join(walker, now, &pose)),
                (Some(pose), true) => sent.extend(self.act(walker, now, &pose, false)),
                (None, true) => sent.extend(self.leave(walker, now)),
                (None, false) => {}
            }
        }
        sent
    }

    /// What a client does with a message: an ask is answered at once.
    pub(super) fn obey(&mut self, at: Duration, to: AvatarId, order: Order) -> Option<Uplink> {
        let walker = self.trace_id(to);
        let client = self.present.get_mut(&walker).filter(|client| client.avatar == to)?;
        match order {
            Order::Entered => client.entered = true,
            Order::Appear(avatar, sampled) => {
                client.replica.insert(avatar, sampled);
            }
            Order::Vanish(avatar) => {
                client.replica.remove(&avatar);
            }
            Order::Poses { sequences, poses } => {
                sequences.for_each(|sequence| client.ack = received(client.ack, sequence));
                for (avatar, sampled) in poses {
                    if let Some(known) = client.replica.get_mut(&avatar) {
                        *known = sampled.max(*known);
                    }
                }
            }
            Order::Quiet(tbv) => client.tbv = Some(tbv),
            Order::Correct => client.jumped = true,
            Order::Drop => {
                self.present.remove(&walker);
            }
            Order::Live => {
                client.tbv = None;
                let pose = self.look_up(walker, at)?;
                return self.act(walker, at, &pose, false);
            }
            Order::Ask => {
                let pose = self.look_up(walker, at)?;
                return self.act(walker, at, &pose, true);
            }
        }
        None
    }

    /// Where the trace has a walker, as it is told on the wire, within the world.
    fn look_up(&mut self, walker: u32, at: Duration) -> Option<Pose> {
        let pose = self.trace.pose_at(walker, at, self.agility.fall_max)?;
        let eye = self.confines.clamp(pose.eye);
        self.outside += u64::from(eye != pose.eye);
        Some(Pose { eye, ..pose })
    }

    fn join(&mut self, walker: u32, now: Duration, pose: &Pose) -> Uplink {
        let avatar = AvatarId(self.walkers.len() as u32);
        self.walkers.push(walker);
        let client = Client {
            avatar,
            eye: pose.eye,
            velocity: pose.velocity,
            at: now,
            settled: now,
            replica: BTreeMap::new(),
            entered: false,
            tbv: None,
            jumped: false,
            claimed: pose.eye,
            ledger: MovementBudget::new(now),
            sequence: 0,
            ack: Ack::default(),
            reports: 0,
            reports_next: 0,
        };
        self.present.insert(walker, client);
        let eye = self.on_wire(pose).eye;
        let request = Request::Join { name: format!("walker {walker}"), eye };
        Uplink { avatar, sampled: now, ack: Ack::default(), request }
    }

    fn leave(&mut self, walker: u32, now: Duration) -> Option<Uplink> {
        let client = self.present.remove(&walker)?;
        let (avatar, ack) = (client.avatar, client.ack);
        Some(Uplink { avatar, sampled: now, ack, request: Request::Leave })
    }

    /// Moves a client to a place, and says so where it must.
    fn act(&mut self, walker: u32, now: Duration, pose: &Pose, asked: bool) -> Option<Uplink> {
        let told = self.on_wire(pose);
        let client = self.present.get_mut(&walker)?;
        let elapsed = now.saturating_sub(client.at);
        let able = self.agility.eyes(client.eye, client.velocity, elapsed).grown(WIRE_POSE_M);
        client.jumped |= !able.contains(pose.eye);
        (client.eye, client.velocity, client.at) = (pose.eye, pose.velocity, now);
        if !client.entered {
            return None;
        }
        let stays = |tbv: &Tbv| tbv.holds(pose, self.tick, &self.agility);
        let live = client.tbv.is_none();
        let stays = !live && client.tbv.as_ref().is_some_and(stays);
        if stays && !asked && !client.jumped {
            return None;
        }
        let request = if std::mem::take(&mut client.jumped)
            || !client.is_believed(now, &told, &self.limits)
        {
            client.ledger.relocate(now, told.velocity);
            client.settled = now;
            self.jumps += 1;
            Request::Relocate { pose: told }
        } else {
            self.left += u64::from(!live && !asked);
            Request::Report { sequence: client.sequence, pose: told, on_stream: !live }
        };
        client.claimed = told.eye;
        client.reports_next += 1;
        Some(Uplink { avatar: client.avatar, sampled: now, ack: client.ack, request })
    }

    fn on_wire(&self, pose: &Pose) -> Pose {
        let rounded = Pose::from(WirePose::from(pose));
        Pose { eye: self.confines.clamp(rounded.eye), ..rounded }
    }
}

/// What is acknowledged once a datagram has come in.
fn received(ack: Ack, sequence: u32) -> Ack {
    let Ack { newest, earlier } = ack;
    if sequence <= newest {
        let bit = (newest - sequence).checked_sub(1).and_then(|back| 1_u32.checked_shl(back));
        return Ack { newest, earlier: earlier | bit.unwrap_or(0) };
    }
    let ahead = sequence - newest;
    let before = if newest == 0 { 0 } else { 1_u32.checked_shl(ahead - 1).unwrap_or(0) };
    Ack { newest: sequence, earlier: earlier.checked_shl(ahead).unwrap_or(0) | before }
}
