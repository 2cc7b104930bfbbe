//! The run of a trace: the server's side of each tick.

mod downlink;

use std::{collections::BTreeMap, io, sync::Arc, time::Duration};

use cpu_time::ProcessTime;
use sightline_cli::trace::Trace;
use sightline_engine::{Engine, Input, Output};
use sightline_protocol::outbound::Outbound;
use sightline_world::{World, motion::AvatarId};

use super::{
    audit::Audit,
    dump::{Dump, EventKind},
    network::SimulatedNetwork,
    options::ReplayOptions,
    packets::{COLOUR, Packet, Request, Uplink},
    report::ReplayReport,
    simulated_clients::SimulatedClients,
    statistics::RunStatistics,
    tick_view::TickView,
};

/// A run in progress.
pub(super) struct Run<'a> {
    engine: Engine,
    clients: SimulatedClients<'a>,
    network: SimulatedNetwork,
    /// The conversion of the engine's output, for each client that the server knows.
    outbound: BTreeMap<AvatarId, Outbound>,
    /// When the pose that the engine has of each avatar was sampled.
    sampled: BTreeMap<AvatarId, Duration>,
    /// When the server received that pose.
    last_reports: BTreeMap<AvatarId, Duration>,
    audit: Option<Audit>,
    dump: Dump<'a>,
    statistics: RunStatistics,
    /// CPU time of all threads in the engine since the last tick.
    cpu: Duration,
}

impl<'a> Run<'a> {
    /// A run before its first tick.
    pub(super) fn new(
        world: &Arc<World>,
        trace: &'a Trace,
        options: &ReplayOptions,
        dump: Dump<'a>,
    ) -> Self {
        let engine = Engine::new(Arc::clone(world), options.config.clone());
        let (round_trip, tick) = (options.round_trip, options.config.tick);
        Self {
            clients: SimulatedClients::new(trace, &engine),
            audit: Audit::new(world, trace, options),
            engine,
            network: SimulatedNetwork::new(options.network, round_trip, tick),
            outbound: BTreeMap::new(),
            sampled: BTreeMap::new(),
            last_reports: BTreeMap::new(),
            dump,
            statistics: RunStatistics::default(),
            cpu: Duration::ZERO,
        }
    }

    /// Runs one tick: packets arrive, clients act, the engine decides. Returns its outputs.
    pub(super) fn step(&mut self, now: Duration) -> io::Result<Vec<Output>> {
        self.deliver(now)?;
        if self.network.advance(now) {
            self.tell_round_trips(now);
        }
        for uplink in self.clients.step(now) {
            self.send_up(now, uplink);
        }
        // With a round trip of zero, what the clients have just sent is already there.
        self.deliver(now)?;
        let mut outputs = Vec::new();
        let start = ProcessTime::now();
        self.engine.tick(now, &mut outputs);
        self.cpu += start.elapsed();
        self.statistics.tick(std::mem::take(&mut self.cpu), &self.engine);
        self.send_down(now, &outputs)?;
        self.deliver(now)?;
        if let Some(audit) = &mut self.audit {
            audit.look(now, &self.clients, &self.network);
        }
        Ok(outputs)
    }

    /// The state after a tick. `done` is the share of the run that is done.
    pub(super) fn view<'b>(
        &'b self,
        now: Duration,
        done: f32,
        outputs: &'b [Output],
    ) -> TickView<'b> {
        let Self { engine, clients, network, last_reports, .. } = self;
        TickView { now, done, outputs, engine, clients, network, last_reports }
    }

    /// The figures of the whole run, once the last event is written. `length` is how much of the
    /// trace was run.
    pub(super) fn finish(
        mut self,
        trace: &Trace,
        options: &ReplayOptions,
        length: Duration,
    ) -> io::Result<ReplayReport> {
        self.dump.finish()?;
        let clients = self.statistics.clients(options, |avatar| self.clients.trace_id(avatar));
        Ok(ReplayReport {
            world: self.engine.world().title.clone(),
            avatars: trace.ids().count(),
            jumps: self.clients.jumps(),
            outside: self.clients.outside(),
            left_tbv: self.clients.left_tbv(),
            speed_max: self.engine.speed_max(),
            seconds: length.as_secs_f64(),
            clients,
            oracle: self.audit.map(Audit::report),
            ..self.statistics.report(options, self.engine.stats())
        })
    }

    fn tell_round_trips(&mut self, now: Duration) {
        let clients: Vec<AvatarId> = self.outbound.keys().copied().collect();
        for avatar in clients {
            let round_trip = self.network.known_round_trip(avatar);
            self.handle(now, Input::RoundTrip { avatar, round_trip });
        }
    }

    /// Delivers every packet that has arrived.
    fn deliver(&mut self, now: Duration) -> io::Result<()> {
        while let Some((at, packet)) = self.network.receive(now) {
            debug_assert!(at <= now, "the packet is still on its way");
            match packet {
                Packet::Up(uplink) => self.receive(at, uplink)?,
                Packet::Down(to, downlink) => {
                    if let Some(answer) = self.clients.receive(at, to, &downlink) {
                        self.send_up(at, answer);
                    }
                }
            }
        }
        Ok(())
    }

    fn send_up(&mut self, now: Duration, uplink: Uplink) {
        let client = self.statistics.client(uplink.avatar);
        uplink.lengths().iter().for_each(|bytes| client.sent.add(*bytes));
        let margin = self.margin(uplink.avatar);
        self.network.send(now, margin, Packet::Up(uplink));
    }

    /// How much longer than half of its round trip a client's messages may take, as the engine
    /// allows.
    fn margin(&self, avatar: AvatarId) -> Duration {
        self.engine.margin(avatar).unwrap_or_else(|| self.engine.config().margin.first())
    }

    /// Takes in a message that has reached the server.
    fn receive(&mut self, at: Duration, uplink: Uplink) -> io::Result<()> {
        let Uplink { avatar, sampled, ack, request } = uplink;
        if let Some(outbound) = self.outbound.get_mut(&avatar) {
            outbound.acknowledge(ack);
        }
        let is_known = self.engine.pose(avatar).is_some();
        match request {
            Request::Join { name, eye } => self.join(at, avatar, name, eye),
            Request::Leave => return self.leave(at, avatar),
            Request::Report { sequence, pose, .. } if is_known => {
                let accepted = self.engine.stats().reports;
                self.note_report(at, avatar)?;
                self.handle(at, Input::Report { avatar, sequence, pose });
                if self.engine.stats().reports == accepted {
                    return Ok(());
                }
            }
            Request::Relocate { pose } if is_known => {
                self.note_report(at, avatar)?;
                self.handle(at, Input::Relocate { avatar, pose });
            }
            // The engine has dropped the avatar, or not yet let it in.
            Request::Report { .. } | Request::Relocate { .. } => return Ok(()),
        }
        debug_assert!(sampled <= at, "a pose is sampled before it arrives");
        self.sampled.insert(avatar, sampled);
        self.last_reports.insert(avatar, at);
        Ok(())
    }

    fn join(&mut self, at: Duration, avatar: AvatarId, name: String, eye: glam::Vec3) {
        self.outbound.insert(avatar, Outbound::default());
        self.handle(at, Input::Join { avatar, name, colour: COLOUR, place: Some(eye) });
        let round_trip = self.network.known_round_trip(avatar);
        self.handle(at, Input::RoundTrip { avatar, round_trip });
    }

    /// Removes an avatar. Its client no longer holds any other, though the server tells it nothing.
    fn leave(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        let held: Vec<AvatarId> = self.engine.held_by(avatar).collect();
        for other in held {
            self.note_pair(at, avatar, other, EventKind::Leave)?;
        }
        self.outbound.remove(&avatar);
        self.sampled.remove(&avatar);
        self.last_reports.remove(&avatar);
        self.handle(at, Input::Leave { avatar });
        Ok(())
    }

    /// Passes an input to the engine, and counts the CPU time that it takes.
    fn handle(&mut self, at: Duration, input: Input) {
        let start = ProcessTime::now();
        self.engine.handle(at, input);
        self.cpu += start.elapsed();
    }

    fn note_report(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        self.statistics.reports += 1;
        self.dump.write(at, None, self.clients.trace_id(avatar), EventKind::Report)
    }

    fn note_pair(
        &mut self,
        at: Duration,
        viewer: AvatarId,
        avatar: AvatarId,
        kind: EventKind,
    ) -> io::Result<()> {
        let (viewer, avatar) = (self.clients.trace_id(viewer), self.clients.trace_id(avatar));
        self.dump.write(at, Some(viewer), avatar, kind)
    }
}
