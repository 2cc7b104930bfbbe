//! The engine over a recorded trace, in virtual time and without sockets.
//!
//! Every walker of the trace has a simulated client whose messages take half of the round trip
//! each way and are coded as on the wire. It does what a real one does: it reports at every tick
//! while it is live; while quiet only when asked or about to leave its TBV; and when it moves in a
//! way that no body can from one sample to the next, or further than the server would believe, the jump is
//! announced, as the host of a game does for a respawn or a rocket's push.
//!
//! In the dump, times are the trace's own, at the server: when it sent what it sent, and when it
//! took in a report. A `t_ms` is rounded down to a whole millisecond.

mod audit;
mod clients;
mod comparison;
mod dump;
mod foresight;
mod report;
mod tally;
mod wire;

use std::{collections::BTreeMap, io, sync::Arc, time::Duration};

use cpu_time::ProcessTime;
use glam::Vec3;
use rayon::prelude::*;
use sightline_protocol::{frame, message::ServerMessage, outbound::Outbound};
use sightline_world::{
    World,
    motion::{AvatarId, Pose, ReportingState},
};

pub use audit::{MissedAvatar, StalePosition};
pub use comparison::Comparison;
pub use report::{ClientReport, OracleReport, ReplayReport};
pub use wire::NetworkConditions;

use audit::Audit;
use clients::{Clients, Order, Request, Uplink};
use dump::{Dump, What};
use sightline_cli::trace::Trace;
use sightline_engine::{Config, Engine, Input, Margin, Output, Policy};
use tally::Tally;
use wire::{Packet, Wire};

/// How a trace is run.
#[derive(Clone, Debug)]
pub struct ReplayOptions {
    /// How the engine works.
    pub config: Config,
    /// Every client's round trip, or the least when the network spreads them.
    pub round_trip: Duration,
    /// What happens to messages.
    pub network: NetworkConditions,
    /// No more than so much of the trace, from its first sample on.
    pub length: Option<Duration>,
    /// How often what is held is compared with what is visible.
    pub oracle: OracleStride,
    /// Whether it also looks ahead, for over-send against the horizon; that is most of its work.
    pub look_ahead: bool,
}

impl ReplayOptions {
    /// A policy at a round trip, with everything else as it is served; but in virtual time no
    /// message is late, so there is no margin for it.
    pub fn new(policy: Policy, round_trip: Duration) -> Self {
        let config = Config { policy, margin: Margin::Fixed(Duration::ZERO), ..Config::default() };
        let network = NetworkConditions::default();
        let oracle = OracleStride::Auto;
        Self { config, round_trip, network, length: None, oracle, look_ahead: true }
    }
}

/// How often the oracle looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OracleStride {
    /// Never.
    Off,
    /// Every second, or less often where many pairs would make that slow.
    Auto,
    /// Every so often.
    Every(Duration),
}

/// Runs a trace. Writes every event to `dump` as CSV; `progress` is told the share done, from 0
/// to 1. The dump and all figures but those of CPU time depend on the arguments alone.
///
/// # Errors
/// When the dump cannot be written.
pub fn run<'a>(
    world: &Arc<World>,
    trace: &'a Trace,
    options: &ReplayOptions,
    dump: Option<&'a mut dyn io::Write>,
    progress: &mut dyn FnMut(f32),
) -> io::Result<ReplayReport> {
    let mut watch = |moment: &TickView<'_>| progress(moment.done);
    run_watched(world, trace, options, dump, &mut watch)
}

/// The same; shows every tick to somebody.
///
/// # Errors
/// When the dump cannot be written.
pub fn run_watched<'a>(
    world: &Arc<World>,
    trace: &'a Trace,
    options: &ReplayOptions,
    dump: Option<&'a mut dyn io::Write>,
    watch: &mut dyn FnMut(&TickView<'_>),
) -> io::Result<ReplayReport> {
    let (first, last) = trace.span();
    let last = options.length.map_or(last, |length| last.min(first + length));
    let tick = options.config.tick;
    let ticks = first.as_nanos().div_ceil(tick.as_nanos())..=last.as_nanos() / tick.as_nanos();
    let count = ticks.end().saturating_sub(*ticks.start()) as f32 + 1.0;
    let mut replay = Replay::new(world, trace, options, Dump::new(dump)?);
    for (done, k) in ticks.enumerate() {
        let now = tick * u32::try_from(k).unwrap_or(u32::MAX);
        let outputs = replay.step(now)?;
        let done = (done + 1) as f32 / count;
        let Replay { engine, clients, wire, heard, .. } = &replay;
        watch(&TickView { now, done, outputs: &outputs, engine, clients, wire, heard });
    }
    replay.dump.finish()?;
    Ok(replay.report(trace, options, last.saturating_sub(first)))
}

/// The end of a tick: what the engine decided, and what is true.
#[derive(Clone, Copy)]
pub struct TickView<'a> {
    /// On the server's clock.
    pub now: Duration,
    /// The share of the run that is done, from 0 to 1.
    pub done: f32,
    /// What the engine wanted told at this tick.
    pub outputs: &'a [Output],
    /// After the tick.
    pub engine: &'a Engine,
    clients: &'a Clients<'a>,
    wire: &'a Wire,
    heard: &'a BTreeMap<AvatarId, Duration>,
}

impl<'a> TickView<'a> {
    /// The trace's id of an avatar.
    pub fn trace_id(&self, avatar: AvatarId) -> u32 {
        self.clients.trace_id(avatar)
    }

    /// Those who are present, as far as their clients know, and where their eyes truly are.
    pub fn eyes(&self) -> impl Iterator<Item = (AvatarId, Vec3)> + 'a {
        self.clients.present().map(|client| (client.avatar, client.eye))
    }

    /// A client's round trip, without jitter and loss, as far as the engine knows it.
    pub fn round_trip(&self, avatar: AvatarId) -> Duration {
        self.engine.round_trip(avatar).unwrap_or_else(|| self.wire.known(avatar))
    }

    /// When somebody came, or was last put where no body gets by itself.
    pub fn settled_at(&self, avatar: AvatarId) -> Option<Duration> {
        self.clients.settled_at(avatar)
    }

    /// When the engine last accepted a report of an avatar, or let it in.
    pub fn last_report(&self, avatar: AvatarId) -> Option<Duration> {
        self.heard.get(&avatar).copied()
    }

    /// Whether a message from or to a client took longer than the engine allows for, a short
    /// while ago.
    pub fn is_late(&self, avatar: AvatarId) -> bool {
        self.wire.is_late(self.now, avatar)
    }
}

struct Replay<'a> {
    engine: Engine,
    clients: Clients<'a>,
    wire: Wire,
    /// What converts the engine's output, for each client.
    outbound: BTreeMap<AvatarId, Outbound>,
    /// When the pose that the engine has of each avatar was sampled.
    sampled: BTreeMap<AvatarId, Duration>,
    /// When it came in.
    heard: BTreeMap<AvatarId, Duration>,
    oracle: Option<Audit>,
    dump: Dump<'a>,
    tally: Tally,
    /// Spent in the engine since the last tick, by all threads.
    cpu: Duration,
}

impl<'a> Replay<'a> {
    fn new(world: &Arc<World>, trace: &'a Trace, options: &ReplayOptions, dump: Dump<'a>) -> Self {
        let engine = Engine::new(Arc::clone(world), options.config.clone());
        Self {
            clients: Clients::new(trace, &engine),
            oracle: Audit::new(world, trace, options),
            engine,
            wire: Wire::new(options),
            outbound: BTreeMap::new(),
            sampled: BTreeMap::new(),
            heard: BTreeMap::new(),
            dump,
            tally: Tally::default(),
            cpu: Duration::ZERO,
        }
    }

    /// One tick: what has arrived, what the clients do, what the engine decides.
    fn step(&mut self, now: Duration) -> io::Result<Vec<Output>> {
        self.deliver(now)?;
        if self.wire.go_on(now) {
            self.tell_round_trips(now);
        }
        for uplink in self.clients.step(now) {
            self.send_up(now, uplink);
        }
        self.deliver(now)?;
        let mut outputs = Vec::new();
        let start = ProcessTime::now();
        self.engine.tick(now, &mut outputs);
        self.cpu += start.elapsed();
        self.tally.tick(std::mem::take(&mut self.cpu), &self.engine);
        self.dispatch(now, &outputs)?;
        self.deliver(now)?;
        if let Some(oracle) = &mut self.oracle {
            oracle.look(now, &self.clients, &self.wire);
        }
        Ok(outputs)
    }

    fn tell_round_trips(&mut self, now: Duration) {
        let clients: Vec<AvatarId> = self.outbound.keys().copied().collect();
        for avatar in clients {
            let round_trip = self.wire.known(avatar);
            self.feed(now, Input::RoundTrip { avatar, round_trip });
        }
    }

    fn deliver(&mut self, now: Duration) -> io::Result<()> {
        while let Some((at, packet)) = self.wire.next(now) {
            match packet {
                Packet::Up(uplink) => self.arrive(at, uplink)?,
                Packet::Down(to, order) => {
                    if let Some(answer) = self.clients.obey(at, to, order) {
                        self.send_up(at, answer);
                    }
                }
            }
        }
        Ok(())
    }

    fn send_up(&mut self, now: Duration, uplink: Uplink) {
        let traffic = self.tally.client(uplink.avatar);
        uplink.lengths().iter().for_each(|bytes| traffic.from.add(*bytes));
        let margin = self.margin(uplink.avatar);
        self.wire.send(now, margin, Packet::Up(uplink));
    }

    /// What the engine allows a client's messages to take longer than half of its round trip.
    fn margin(&self, avatar: AvatarId) -> Duration {
        self.engine.margin(avatar).unwrap_or_else(|| self.engine.config().margin.first())
    }

    /// A message has reached the server.
    fn arrive(&mut self, at: Duration, uplink: Uplink) -> io::Result<()> {
        let Uplink { avatar, sampled, ack, request } = uplink;
        if let Some(outbound) = self.outbound.get_mut(&avatar) {
            outbound.acknowledge(ack);
        }
        let known = self.engine.pose(avatar).is_some();
        let accepted = self.engine.stats().reports;
        let moves = !matches!(request, Request::Leave);
        match request {
            Request::Join { name, eye } => {
                self.outbound.insert(avatar, Outbound::default());
                let (colour, place) = ([128; 3], Some(eye));
                self.feed(at, Input::Join { avatar, name, colour, place });
                let round_trip = self.wire.known(avatar);
                self.feed(at, Input::RoundTrip { avatar, round_trip });
            }
            Request::Leave => self.leave(at, avatar)?,
            Request::Report { sequence, pose, .. } if known => {
                self.note_report(at, avatar)?;
                self.feed(at, Input::Report { avatar, sequence, pose });
                if self.engine.stats().reports == accepted {
                    return Ok(());
                }
            }
            Request::Relocate { pose } if known => {
                self.note_report(at, avatar)?;
                self.feed(at, Input::Relocate { avatar, pose });
            }
            Request::Report { .. } | Request::Relocate { .. } => return Ok(()),
        }
        if moves {
            self.sampled.insert(avatar, sampled);
            self.heard.insert(avatar, at);
        }
        Ok(())
    }

    fn feed(&mut self, at: Duration, input: Input) {
        let start = ProcessTime::now();
        self.engine.handle(at, input);
        self.cpu += start.elapsed();
    }

    /// What a leaver's client held it holds no more, though nobody tells it.
    fn leave(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        let held: Vec<AvatarId> = self.engine.held_by(avatar).collect();
        for other in held {
            self.note_pair(at, avatar, other, What::Leave)?;
        }
        self.outbound.remove(&avatar);
        self.sampled.remove(&avatar);
        self.heard.remove(&avatar);
        self.feed(at, Input::Leave { avatar });
        Ok(())
    }

    fn note_report(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        self.tally.reports += 1;
        self.dump.write(at, None, self.clients.trace_id(avatar), What::Report)
    }

    fn note_pair(
        &mut self,
        at: Duration,
        viewer: AvatarId,
        avatar: AvatarId,
        what: What,
    ) -> io::Result<()> {
        let (viewer, avatar) = (self.clients.trace_id(viewer), self.clients.trace_id(avatar));
        self.dump.write(at, Some(viewer), avatar, what)
    }

    /// Sends on what the engine wants told.
    fn dispatch(&mut self, now: Duration, outputs: &[Output]) -> io::Result<()> {
        let mut news: BTreeMap<AvatarId, &[(AvatarId, Pose)]> = BTreeMap::new();
        for output in outputs {
            self.note(now, output)?;
            let mut gone = Outbound::default();
            let outbound = self.outbound.get_mut(&output.to()).unwrap_or(&mut gone);
            match (outbound.convert(output, now), output) {
                (Some(message), _) => self.send_control(now, output, &message),
                (None, Output::Poses { to, poses, .. }) => {
                    news.insert(*to, poses);
                }
                (None, _) => debug_assert!(false, "only poses wait: {output:?}"),
            }
        }
        self.send_poses(now, news);
        Ok(())
    }

    /// Counts an output, and writes it down if a reader of the dump wants to know of it.
    fn note(&mut self, now: Duration, output: &Output) -> io::Result<()> {
        match output {
            Output::Appear { to, avatar, .. } => {
                self.tally.updates += 1;
                self.tally.enter(now, *to, *avatar);
                self.note_pair(now, *to, *avatar, What::Enter)?;
                self.note_pair(now, *to, *avatar, What::Update)?;
            }
            Output::Vanish { to, avatar } => {
                self.tally.leave(now, *to, *avatar);
                self.note_pair(now, *to, *avatar, What::Leave)?;
            }
            Output::Poses { to, poses, .. } => {
                self.tally.updates += poses.len() as u64;
                for (avatar, _) in poses {
                    self.note_pair(now, *to, *avatar, What::Update)?;
                }
            }
            Output::Ask { to } => self.note_ask(now, *to)?,
            // To a client whose TBV was revealed this is an ask as well.
            Output::Live { to } if self.engine.state(*to) == Some(ReportingState::Asked) => {
                self.note_ask(now, *to)?;
            }
            Output::Correct { .. } => self.tally.corrections += 1,
            _ => {}
        }
        Ok(())
    }

    fn note_ask(&mut self, now: Duration, to: AvatarId) -> io::Result<()> {
        self.tally.asks += 1;
        self.dump.write(now, None, self.clients.trace_id(to), What::Ask)
    }

    fn send_control(&mut self, now: Duration, output: &Output, message: &ServerMessage) {
        let sampled = |avatar: &AvatarId| self.sampled.get(avatar).copied().unwrap_or(now);
        let (to, order) = match output {
            Output::Entered { to, .. } => (*to, Order::Entered),
            Output::Appear { to, avatar, .. } => (*to, Order::Appear(*avatar, sampled(avatar))),
            Output::Vanish { to, avatar } => (*to, Order::Vanish(*avatar)),
            Output::Live { to } => (*to, Order::Live),
            Output::Quiet { to, tbv } => (*to, Order::Quiet(*tbv)),
            Output::Ask { to } => (*to, Order::Ask),
            Output::Correct { to, .. } => (*to, Order::Correct),
            Output::Drop { to, .. } => (*to, Order::Drop),
            Output::Poses { .. } | Output::Chat { .. } => return,
        };
        self.tally.client(to).to.add(frame::encode(message).len());
        self.wire.send(now, self.margin(to), Packet::Down(to, order));
    }

    /// Encodes every client's datagrams. One without news may hold what is to be sent again; and
    /// news that are as before, to the last bit on the wire, cost none: what a client holds then
    /// is as good as fresh.
    fn send_poses(&mut self, now: Duration, mut news: BTreeMap<AvatarId, &[(AvatarId, Pose)]>) {
        let tick = self.engine.ticks();
        let mut work: Vec<_> = self
            .outbound
            .iter_mut()
            .map(|(to, outbound)| (*to, outbound, news.remove(to).unwrap_or_default()))
            .collect();
        let lengths: Vec<Vec<usize>> = work
            .par_iter_mut()
            .map(|(_, outbound, _)| outbound.encode_poses(tick).iter().map(Vec::len).collect())
            .collect();
        let sent: Vec<_> = work
            .into_iter()
            .map(|(to, outbound, poses)| (to, outbound.next_sequence(), poses))
            .collect();
        for ((to, next, poses), lengths) in sent.into_iter().zip(lengths) {
            if poses.is_empty() && lengths.is_empty() {
                continue;
            }
            let traffic = self.tally.client(to);
            lengths.iter().for_each(|bytes| traffic.to.add(*bytes));
            let sampled = |id: &AvatarId| self.sampled.get(id).copied().unwrap_or(now);
            let poses = poses.iter().map(|(id, _)| (*id, sampled(id))).collect();
            let sequences = next - lengths.len() as u32..next;
            let order = Order::Poses { sequences, poses };
            self.wire.send(now, self.margin(to), Packet::Down(to, order));
        }
    }

    fn report(self, trace: &Trace, options: &ReplayOptions, length: Duration) -> ReplayReport {
        let world = self.engine.world().title.clone();
        let clients = (trace.ids().count(), self.clients.jumps(), self.clients.outside());
        let oracle = self.oracle.map(|oracle| oracle.report());
        let each = self.tally.clients(options, |avatar| self.clients.trace_id(avatar));
        ReplayReport {
            world,
            avatars: clients.0,
            jumps: clients.1,
            outside: clients.2,
            left_tbv: self.clients.left(),
            speed_max: self.engine.speed_max(),
            seconds: length.as_secs_f64(),
            clients: each,
            oracle,
            ..self.tally.report(options, self.engine.stats())
        }
    }
}

#[cfg(test)]
mod tests;
