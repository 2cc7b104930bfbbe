//! The engine over a recorded trace, in virtual time and without sockets.
//!
//! Every walker of the trace has a simulated client whose messages take half of the round trip
//! each way and are coded as on the wire. It does what a real one does: it reports at every tick
//! while it is live; while quiet only when asked or about to leave its TBV; and when it moves in a
//! way that no body can, from one sample to the next, it announces the jump, as the host of a game
//! does for a respawn.
//!
//! In the dump, times are the trace's own, at the server: when it sent what it sent, and when it
//! took in a report. A `t_ms` is rounded down to a whole millisecond.

mod clients;
mod dump;
mod oracle;
mod report;

use std::{
    collections::BTreeMap,
    io,
    sync::Arc,
    time::{Duration, Instant},
};

use rayon::prelude::*;
use sightline_shared::{
    motion::{AvatarId, Pose},
    protocol::{
        frame,
        message::ServerMessage,
        pose_stream::{Ack, PoseEncoder},
        quantise::WireTbv,
        text::{Line, Name},
    },
    world::World,
};

pub use report::{OracleReport, Report};

use crate::{
    engine::{ClientState, Config, Engine, Input, Output, Policy},
    trace::Trace,
};
use clients::{Clients, Order, Request, Uplink};
use dump::{Dump, What};
use oracle::Oracle;
use report::Tally;

/// How a trace is run.
#[derive(Clone, Debug)]
pub struct Options {
    /// How the engine works.
    pub config: Config,
    /// Every client's round trip.
    pub round_trip: Duration,
    /// No more than so much of the trace, from its first sample on.
    pub length: Option<Duration>,
    /// How often what is held is compared with what is visible.
    pub oracle: OracleStride,
}

impl Options {
    /// A policy at a round trip, with everything else as it is served; but in virtual time no
    /// message is late, so there is no margin for it.
    pub fn new(policy: Policy, round_trip: Duration) -> Self {
        let config = Config { policy, margin: Duration::ZERO, ..Config::default() };
        Self { config, round_trip, length: None, oracle: OracleStride::Auto }
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
    options: &Options,
    dump: Option<&'a mut dyn io::Write>,
    progress: &mut dyn FnMut(f32),
) -> io::Result<Report> {
    let (first, last) = trace.span();
    let last = options.length.map_or(last, |length| last.min(first + length));
    let tick = options.config.tick;
    let ticks = first.as_nanos().div_ceil(tick.as_nanos())..=last.as_nanos() / tick.as_nanos();
    let count = ticks.end().saturating_sub(*ticks.start()) as f32 + 1.0;
    let mut replay = Replay::new(world, trace, options, Dump::new(dump)?);
    for (done, k) in ticks.enumerate() {
        replay.step(tick * u32::try_from(k).unwrap_or(u32::MAX))?;
        progress((done + 1) as f32 / count);
    }
    replay.dump.finish()?;
    Ok(replay.report(trace, options, last.saturating_sub(first)))
}

/// A message on its way.
enum Packet {
    Up(Uplink),
    Down(AvatarId, Order),
}

struct Replay<'a> {
    engine: Engine,
    clients: Clients<'a>,
    /// By arrival, then in the order of sending.
    wire: BTreeMap<(Duration, u64), Packet>,
    sent: u64,
    round_trip: Duration,
    /// The server's end of each client's pose stream.
    encoders: BTreeMap<AvatarId, PoseEncoder>,
    /// When the pose that the engine has of each avatar was sampled.
    sampled: BTreeMap<AvatarId, Duration>,
    oracle: Option<Oracle>,
    dump: Dump<'a>,
    tally: Tally,
    /// Spent in the engine since the last tick.
    cpu: Duration,
}

impl<'a> Replay<'a> {
    fn new(world: &Arc<World>, trace: &'a Trace, options: &Options, dump: Dump<'a>) -> Self {
        let engine = Engine::new(Arc::clone(world), options.config.clone());
        Self {
            clients: Clients::new(trace, &engine),
            oracle: Oracle::new(world, trace, options),
            engine,
            wire: BTreeMap::new(),
            sent: 0,
            round_trip: options.round_trip,
            encoders: BTreeMap::new(),
            sampled: BTreeMap::new(),
            dump,
            tally: Tally::default(),
            cpu: Duration::ZERO,
        }
    }

    /// One tick: what has arrived, what the clients do, what the engine decides.
    fn step(&mut self, now: Duration) -> io::Result<()> {
        self.deliver(now)?;
        for uplink in self.clients.step(now) {
            self.send_up(now, uplink);
        }
        self.deliver(now)?;
        let mut outputs = Vec::new();
        let start = Instant::now();
        self.engine.tick(now, &mut outputs);
        self.cpu += start.elapsed();
        self.tally.tick(std::mem::take(&mut self.cpu), &self.engine);
        self.dispatch(now, outputs)?;
        self.deliver(now)?;
        if let Some(oracle) = &mut self.oracle {
            oracle.look(now, &self.clients);
        }
        Ok(())
    }

    fn deliver(&mut self, now: Duration) -> io::Result<()> {
        while let Some(entry) = self.wire.first_entry()
            && entry.key().0 <= now
        {
            let at = entry.key().0;
            match entry.remove() {
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
        let messages = uplink.lengths();
        messages.iter().for_each(|bytes| self.tally.from_clients.add(*bytes));
        self.send(now, Packet::Up(uplink));
    }

    fn send(&mut self, now: Duration, packet: Packet) {
        self.sent += 1;
        self.wire.insert((now + self.round_trip / 2, self.sent), packet);
    }

    /// A message has reached the server.
    fn arrive(&mut self, at: Duration, uplink: Uplink) -> io::Result<()> {
        let Uplink { avatar, sampled, ack, request } = uplink;
        if let Some(encoder) = self.encoders.get_mut(&avatar) {
            encoder.acknowledge(Ack { newest: ack, earlier: u32::MAX });
        }
        let known = self.engine.pose(avatar).is_some();
        let accepted = self.engine.stats().reports;
        let moves = !matches!(request, Request::Leave);
        match request {
            Request::Join { name, eye } => {
                self.encoders.insert(avatar, PoseEncoder::default());
                let (colour, place) = ([128; 3], Some(eye));
                self.feed(at, Input::Join { avatar, name, colour, place });
                self.feed(at, Input::RoundTrip { avatar, round_trip: self.round_trip });
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
        }
        Ok(())
    }

    fn feed(&mut self, at: Duration, input: Input) {
        let start = Instant::now();
        self.engine.handle(at, input);
        self.cpu += start.elapsed();
    }

    /// What a leaver's client held it holds no more, though nobody tells it.
    fn leave(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        let held: Vec<AvatarId> = self.engine.held_by(avatar).collect();
        for other in held {
            self.note_pair(at, avatar, other, What::Leave)?;
        }
        self.encoders.remove(&avatar);
        self.sampled.remove(&avatar);
        self.feed(at, Input::Leave { avatar });
        Ok(())
    }

    fn note_report(&mut self, at: Duration, avatar: AvatarId) -> io::Result<()> {
        self.tally.reports += 1;
        self.dump.write(at, None, self.clients.walker(avatar), What::Report)
    }

    fn note_pair(
        &mut self,
        at: Duration,
        viewer: AvatarId,
        avatar: AvatarId,
        what: What,
    ) -> io::Result<()> {
        let (viewer, avatar) = (self.clients.walker(viewer), self.clients.walker(avatar));
        self.dump.write(at, Some(viewer), avatar, what)
    }

    /// Sends on what the engine wants told.
    fn dispatch(&mut self, now: Duration, outputs: Vec<Output>) -> io::Result<()> {
        let mut news = BTreeMap::new();
        for output in outputs {
            self.note(now, &output)?;
            match output {
                Output::Poses { to, poses, .. } => {
                    news.insert(to, poses);
                }
                control => self.send_control(now, &control),
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
                self.note_pair(now, *to, *avatar, What::Enter)?;
                self.note_pair(now, *to, *avatar, What::Update)?;
            }
            Output::Vanish { to, avatar } => self.note_pair(now, *to, *avatar, What::Leave)?,
            Output::Poses { to, poses, .. } => {
                self.tally.updates += poses.len() as u64;
                for (avatar, _) in poses {
                    self.note_pair(now, *to, *avatar, What::Update)?;
                }
            }
            Output::Ask { to } => self.note_ask(now, *to)?,
            // To a client whose TBV was revealed this is an ask as well.
            Output::Live { to }
                if matches!(self.engine.state(*to), Some(ClientState::Asked(_))) =>
            {
                self.note_ask(now, *to)?;
            }
            Output::Correct { .. } => self.tally.corrections += 1,
            _ => {}
        }
        Ok(())
    }

    fn note_ask(&mut self, now: Duration, to: AvatarId) -> io::Result<()> {
        self.tally.asks += 1;
        self.dump.write(now, None, self.clients.walker(to), What::Ask)
    }

    fn send_control(&mut self, now: Duration, output: &Output) {
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
        if let Order::Vanish(avatar) = order
            && let Some(encoder) = self.encoders.get_mut(&to)
        {
            encoder.forget(avatar);
        }
        let since = self.encoders.get(&to).map_or(1, PoseEncoder::next_sequence);
        if let Some(message) = message(now, output, since) {
            self.tally.to_clients.add(frame::encode(&message).len());
        }
        self.send(now, Packet::Down(to, order));
    }

    /// Encodes every client's datagrams. One without news may hold what is to be sent again; and
    /// news that are as before, to the last bit on the wire, cost none: what a client holds then
    /// is as good as fresh.
    fn send_poses(&mut self, now: Duration, mut news: BTreeMap<AvatarId, Vec<(AvatarId, Pose)>>) {
        let tick = self.engine.ticks();
        let mut work: Vec<_> = self
            .encoders
            .iter_mut()
            .map(|(to, encoder)| (*to, encoder, news.remove(to).unwrap_or_default()))
            .collect();
        let lengths: Vec<Vec<usize>> = work
            .par_iter_mut()
            .map(|(_, encoder, poses)| encoder.encode(tick, poses).iter().map(Vec::len).collect())
            .collect();
        let sent: Vec<_> = work
            .into_iter()
            .map(|(to, encoder, poses)| (to, encoder.next_sequence() - 1, poses))
            .collect();
        for ((to, newest, poses), lengths) in sent.into_iter().zip(lengths) {
            if poses.is_empty() && lengths.is_empty() {
                continue;
            }
            lengths.iter().for_each(|bytes| self.tally.to_clients.add(*bytes));
            let sampled = |id: &AvatarId| self.sampled.get(id).copied().unwrap_or(now);
            let poses = poses.iter().map(|(id, _)| (*id, sampled(id))).collect();
            self.send(now, Packet::Down(to, Order::Poses { newest, poses }));
        }
    }

    fn report(self, trace: &Trace, options: &Options, length: Duration) -> Report {
        let world = self.engine.world().title.clone();
        let engine = (self.engine.stats(), self.engine.speed_max());
        let clients = (trace.ids().count(), self.clients.jumps(), self.clients.outside());
        let oracle = self.oracle.map(|oracle| oracle.report());
        self.tally.report(world, options, length, engine, clients, oracle)
    }
}

/// An output as it is on the wire, for its length.
fn message(now: Duration, output: &Output, since_sequence: u32) -> Option<ServerMessage> {
    Some(match output {
        Output::Entered { pose, .. } => ServerMessage::Entered { pose: pose.into() },
        Output::Appear { avatar, name, colour, pose, .. } => ServerMessage::Appear {
            avatar: *avatar,
            name: Name::new(name).ok()?,
            colour: *colour,
            pose: pose.into(),
            since_sequence,
        },
        Output::Vanish { avatar, .. } => ServerMessage::Vanish { avatar: *avatar },
        Output::Live { .. } => ServerMessage::Live,
        Output::Quiet { tbv, .. } => ServerMessage::Quiet { tbv: WireTbv::new(tbv, now) },
        Output::Ask { .. } => ServerMessage::Ask,
        Output::Correct { pose, .. } => ServerMessage::Correct { pose: pose.into() },
        Output::Drop { reason, .. } => ServerMessage::Goodbye { reason: Line::clipped(reason) },
        Output::Poses { .. } | Output::Chat { .. } => return None,
    })
}

#[cfg(test)]
mod tests;
