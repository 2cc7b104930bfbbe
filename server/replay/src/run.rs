//! The run of a trace: the server's side of each tick.

mod downlink;

use std::{collections::BTreeMap, io, sync::Arc, time::Duration};

use sightline_cli::trace::Trace;
use sightline_engine::{Engine, Input, Output};
use sightline_protocol::{
    message::ClientMessage,
    outbound::Outbound,
    pose_stream::{Ack, ClientDatagram},
    quantise::WireReport,
    text::Name,
};
use sightline_world::{
    World,
    motion::{AvatarId, Pose},
};

use super::{
    audit::Audit,
    dump::{Dump, EventKind},
    network::SimulatedNetwork,
    options::ReplayOptions,
    packets::{Packet, Payload, Request, Uplink, unframe},
    report::ReplayReport,
    simulated_clients::SimulatedClients,
    stations::Stations,
    statistics::RunStatistics,
    tick_view::{LastReport, TickView},
};

/// A run in progress.
pub(super) struct Run<'a> {
    stations: Stations,
    clients: SimulatedClients<'a>,
    network: SimulatedNetwork,
    /// The conversion of the engine's output, for each client that the server knows.
    outbound: BTreeMap<AvatarId, Outbound>,
    /// The name and the colour in each client's hello.
    hellos: BTreeMap<AvatarId, (Name, [u8; 3])>,
    /// The times of the pose that the engine has of each avatar.
    last_reports: BTreeMap<AvatarId, LastReport>,
    /// The times of all those poses, by when they arrived. Another station learns of them later.
    reports: BTreeMap<(AvatarId, Duration), LastReport>,
    /// By how much each client's quickest report took longer than half of the round trip that the
    /// engine knew at its time.
    least_lateness: BTreeMap<AvatarId, Duration>,
    audit: Option<Audit>,
    dump: Dump<'a>,
    statistics: RunStatistics,
}

impl<'a> Run<'a> {
    /// A run before its first tick.
    pub(super) fn new(
        world: &Arc<World>,
        trace: &'a Trace,
        options: &ReplayOptions,
        dump: Dump<'a>,
    ) -> Self {
        let stations = Stations::new(world, trace, options);
        let (round_trip, tick) = (options.round_trip, options.config.tick);
        Self {
            clients: SimulatedClients::new(trace, stations.first(), options.faults),
            audit: Audit::new(world, trace, options),
            stations,
            network: SimulatedNetwork::new(options.network, round_trip, tick)
                .with_departures_lost(options.faults.departures_lost),
            outbound: BTreeMap::new(),
            hellos: BTreeMap::new(),
            last_reports: BTreeMap::new(),
            reports: BTreeMap::new(),
            least_lateness: BTreeMap::new(),
            dump,
            statistics: RunStatistics::default(),
        }
    }

    /// Runs a tick up to the engine's decision: packets arrive, clients act, the engine decides.
    /// Returns its outputs.
    pub(super) fn decide(&mut self, now: Duration) -> io::Result<Vec<Output>> {
        self.deliver(now)?;
        if self.network.advance(now) {
            self.tell_round_trips(now);
        }
        self.stations.look_for_trouble(now);
        let stations = &self.stations;
        self.clients.disconnect(now, |avatar| stations.is_connected(avatar));
        for uplink in self.clients.step(now, &self.network) {
            self.send_up(now, uplink);
        }
        // With a round trip of zero, what the clients have just sent is already there.
        self.deliver(now)?;
        let outputs = self.stations.tick(now);
        self.statistics.tick(self.stations.take_cpu(), self.stations.engines());
        Ok(outputs)
    }

    /// Ends a tick: the engine's outputs are sent. With a round trip of zero they arrive at once,
    /// and so do the answers.
    pub(super) fn tell(&mut self, now: Duration, outputs: &[Output]) -> io::Result<()> {
        self.send_down(now, outputs)?;
        self.deliver(now)?;
        if let Some(audit) = &mut self.audit {
            audit.look(now, &self.clients, &self.network, &self.stations);
        }
        Ok(())
    }

    /// The state once the engine has decided at a tick. `done` is the share of the run that is
    /// done.
    pub(super) fn view<'b>(
        &'b self,
        now: Duration,
        done: f32,
        outputs: &'b [Output],
    ) -> TickView<'b> {
        let Self { stations, clients, network, last_reports, reports, .. } = self;
        let engine = stations.first();
        TickView {
            now,
            done,
            outputs,
            engine,
            stations,
            clients,
            network,
            last_reports,
            reports,
            least_lateness: &self.least_lateness,
        }
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
        let clients = self.statistics.clients(options, &self.clients);
        Ok(ReplayReport {
            world: self.engine().world().title.clone(),
            avatars: trace.ids().count(),
            jumps: self.clients.jumps(),
            outside: self.clients.outside(),
            left_tbv: self.clients.left_tbv(),
            speed_max: self.engine().speed_max(),
            seconds: length.as_secs_f64(),
            clients,
            oracle: self.audit.map(|audit| audit.report(&self.clients)),
            stations: (options.stations.count > 0).then(|| self.stations.report()),
            ..self.statistics.report(options, self.stations.stats(), &self.clients)
        })
    }

    fn tell_round_trips(&mut self, now: Duration) {
        let clients: Vec<AvatarId> = self.outbound.keys().copied().collect();
        for avatar in clients {
            let round_trip = self.network.known_round_trip(avatar);
            self.handle(now, avatar, Input::RoundTrip { avatar, round_trip });
        }
    }

    /// Delivers every packet that has arrived.
    fn deliver(&mut self, now: Duration) -> io::Result<()> {
        loop {
            let bus = self.stations.next_arrival().filter(|at| *at <= now);
            if let Some(at) = bus
                && self.network.next_arrival().is_none_or(|other| at <= other)
            {
                self.stations.deliver_next();
                continue;
            }
            let Some((at, packet)) = self.network.receive(now) else { break };
            debug_assert!(at <= now, "the packet is still on its way");
            match packet {
                Packet::Up(uplink) => self.receive(at, uplink)?,
                Packet::Down(to, payload) => {
                    if let Some(answer) = self.clients.receive(at, to, &payload) {
                        self.send_up(at, answer);
                    }
                }
            }
        }
        Ok(())
    }

    fn send_up(&mut self, now: Duration, uplink: Uplink) {
        let client = self.statistics.client(uplink.avatar);
        client.sent.add(uplink.length());
        let margin = self.margin(uplink.avatar);
        self.network.send(now, margin, Packet::Up(uplink));
    }

    /// How much longer than half of its round trip a client's messages may take, as the engine
    /// allows.
    fn margin(&self, avatar: AvatarId) -> Duration {
        let engine = self.stations.engine_of(avatar);
        engine.margin(avatar).unwrap_or_else(|| engine.config().margin.first())
    }

    /// Takes in a message that has reached the server.
    fn receive(&mut self, at: Duration, uplink: Uplink) -> io::Result<()> {
        let Uplink { avatar, request, sent, .. } = uplink;
        let times = LastReport { heard: at, sampled: sent };
        match request {
            Request::Bytes(Payload::Frame(bytes)) => {
                self.receive_message(times, avatar, unframe(&bytes, ClientMessage::decode))
            }
            Request::Bytes(Payload::Datagram(bytes)) => {
                let datagram = ClientDatagram::decode(&bytes);
                let ClientDatagram { ack, report } = datagram.expect("a client's own datagram");
                self.acknowledge(avatar, ack);
                report.map_or(Ok(()), |report| self.receive_report(times, avatar, &report))
            }
            Request::Relocate { pose, ack } => {
                ack.into_iter().for_each(|ack| self.acknowledge(avatar, ack));
                self.receive_jump(times, avatar, pose)
            }
        }
    }

    fn receive_message(
        &mut self,
        times: LastReport,
        avatar: AvatarId,
        message: ClientMessage,
    ) -> io::Result<()> {
        match message {
            ClientMessage::Hello { name, colour, .. } => {
                self.hellos.insert(avatar, (name, colour));
                Ok(())
            }
            ClientMessage::Enter { place, .. } => {
                self.join(times, avatar, place.map(Into::into));
                Ok(())
            }
            ClientMessage::Report { report, ack } => {
                self.acknowledge(avatar, ack);
                self.receive_report(times, avatar, &report)
            }
            ClientMessage::Goodbye => self.leave(times.heard, avatar),
            ClientMessage::FetchWorld { .. }
            | ClientMessage::Chat { .. }
            | ClientMessage::Respawn => {
                debug_assert!(false, "nobody fetches, chats or respawns in a trace");
                Ok(())
            }
        }
    }

    fn acknowledge(&mut self, avatar: AvatarId, ack: Ack) {
        if let Some(outbound) = self.outbound.get_mut(&avatar) {
            outbound.acknowledge(ack);
        }
    }

    /// Takes in a report. It is ignored when the engine has dropped the avatar, or not yet let it
    /// in.
    fn receive_report(
        &mut self,
        times: LastReport,
        avatar: AvatarId,
        report: &WireReport,
    ) -> io::Result<()> {
        if self.stations.engine_of(avatar).pose(avatar).is_none() {
            return Ok(());
        }
        let accepted = self.stations.reports(avatar);
        self.note_report(times.heard, avatar)?;
        let report = report.report(self.engine().config().tick);
        self.handle(times.heard, avatar, Input::Report { avatar, report });
        if self.stations.reports(avatar) != accepted {
            self.note_times(avatar, times);
            let LastReport { heard, sampled } = times;
            let one_way =
                self.stations.engine_of(avatar).round_trip(avatar).unwrap_or_default() / 2;
            let lateness = heard.saturating_sub(sampled + one_way);
            let least = self.least_lateness.entry(avatar).or_insert(lateness);
            *least = lateness.min(*least);
        }
        Ok(())
    }

    fn receive_jump(&mut self, times: LastReport, avatar: AvatarId, pose: Pose) -> io::Result<()> {
        if self.stations.engine_of(avatar).pose(avatar).is_some() {
            self.note_report(times.heard, avatar)?;
            self.handle(times.heard, avatar, Input::Relocate { avatar, pose });
            self.note_times(avatar, times);
        }
        Ok(())
    }

    fn join(&mut self, times: LastReport, avatar: AvatarId, place: Option<glam::Vec3>) {
        let at = times.heard;
        let Some((name, colour)) = self.hellos.remove(&avatar) else { return };
        self.outbound.insert(avatar, Outbound::new(avatar, self.engine().config().tick));
        self.stations.assign(avatar, place);
        self.handle(at, avatar, Input::Join { avatar, name: name.into(), colour, place });
        let round_trip = self.network.known_round_trip(avatar);
        self.handle(at, avatar, Input::RoundTrip { avatar, round_trip });
        self.note_times(avatar, times);
    }

    fn note_times(&mut self, avatar: AvatarId, times: LastReport) {
        self.last_reports.insert(avatar, times);
        if self.stations.are_several() {
            self.reports.insert((avatar, times.heard), times);
        }
    }

    /// Removes an avatar. Its client no longer holds any other, though the server tells it nothing.
    fn leave(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        let held: Vec<AvatarId> = self.stations.engine_of(avatar).held_by(avatar).collect();
        for other in held {
            self.note_pair(at, avatar, other, EventKind::Leave)?;
        }
        self.outbound.remove(&avatar);
        self.last_reports.remove(&avatar);
        self.least_lateness.remove(&avatar);
        self.handle(at, avatar, Input::Leave { avatar });
        Ok(())
    }

    /// An engine, for what all have in common.
    fn engine(&self) -> &Engine {
        self.stations.first()
    }

    /// Passes an input to the engine of an avatar, and counts the CPU time that it takes.
    fn handle(&mut self, at: Duration, avatar: AvatarId, input: Input) {
        self.stations.handle(at, avatar, input);
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
        if viewer == avatar {
            // Who comes back from a station that has stopped meets what others still know of it.
            return Ok(());
        }
        self.dump.write(at, Some(viewer), avatar, kind)
    }
}
