//! Simulated visitors, many in one process. They wander from room to room, or follow recorded
//! walks. Each has a connection and a replica of its own. What they receive is counted, and what
//! they should have received.

mod grounds;
mod history;
mod misses;
mod processes;
mod promises;
mod report;
mod sight;
mod visitor;

use std::{
    collections::{BTreeMap, VecDeque},
    net::SocketAddr,
    sync::Arc,
    time::Duration,
};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_cli::{
    identity::{Identity, IdentityError},
    trace::{Trace, Track},
};
use sightline_client_core::replica::{Event, HeldAvatar, ShownAvatar};
use sightline_protocol::text::Name;
use sightline_world::{
    World,
    motion::{AvatarId, Pose, ReportingState},
};
use tokio::{
    task::JoinSet,
    time::{Instant, MissedTickBehavior},
};

use crate::net::{ConnectError, ConnectOptions, Dialer, Session, Trust};
use grounds::{Grounds, Renewal};
use misses::Misses;
use processes::Process;
use report::{Joining, SwarmStatistics};
use visitor::{Visitor, Wanderer};

pub use report::SwarmReport;

/// The time between two steps of the visitors.
const STEP: Duration = Duration::from_millis(25);
/// After more time than this without a step, visitors leap. In seconds.
const LEAP_S: f32 = 0.2;
/// The largest number of visitors that connect at the same time.
const CONNECTING_MAX: usize = 16;
/// The time between two visitors who set out to connect.
const JOIN_INTERVAL: Duration = Duration::from_millis(10);
/// The time after a leap in which the server may have a visitor elsewhere.
const UNSETTLED: Duration = Duration::from_secs(2);

/// How many visitors to send, for how long, and how they move.
#[derive(Clone)]
pub struct SwarmOptions {
    /// The number of visitors.
    pub clients: usize,
    /// How long they walk, once all are in.
    pub duration: Duration,
    /// The seed of their goals.
    pub seed: u64,
    /// The trusted servers.
    pub trust: Trust,
    /// Connects the visitors. Share it with other clients of the process to share the world too.
    pub dialer: Arc<Dialer>,
    /// Recorded walks to follow instead of wandering: one visitor per recorded avatar.
    pub trace: Option<Trace>,
    /// The time between two calls of the observer.
    pub snapshot_interval: Duration,
    /// Other servers of the same building. Visitors go to all servers in turns.
    pub others: Vec<SocketAddr>,
}

impl SwarmOptions {
    /// Visitors who wander, observed four times a second.
    pub fn new(clients: usize, duration: Duration, trust: Trust) -> Self {
        Self {
            clients,
            duration,
            seed: 1,
            trust,
            dialer: Arc::new(Dialer::new(None)),
            trace: None,
            snapshot_interval: Duration::from_millis(250),
            others: Vec::new(),
        }
    }
}

/// The true poses, and what each visitor's replica holds, at one moment.
#[derive(Clone, Debug, Default)]
pub struct SwarmSnapshot {
    /// The time since all visitors were in.
    pub elapsed: Duration,
    /// The server's time from tick to tick.
    pub tick: Duration,
    /// The connected visitors.
    pub visitors: Vec<VisitorView>,
}

impl SwarmSnapshot {
    /// The visitors that are in the world and have not leapt recently, so that the server has them
    /// where they are.
    fn settled(&self) -> BTreeMap<AvatarId, &VisitorView> {
        let is_settled = |visitor: &&VisitorView| {
            let leapt = visitor.leapt.map(|at| self.elapsed.saturating_sub(at));
            visitor.reporting_state.is_some() && leapt.is_none_or(|ago| ago > UNSETTLED)
        };
        let settled = self.visitors.iter().filter(is_settled);
        settled.map(|visitor| (visitor.avatar, visitor)).collect()
    }
}

/// One visitor at one moment.
#[derive(Clone, Debug)]
pub struct VisitorView {
    /// The visitor's avatar.
    pub avatar: AvatarId,
    /// Its true pose.
    pub pose: Pose,
    /// What the server expects of it; `None` before it is in the world.
    pub reporting_state: Option<ReportingState>,
    /// When it last leapt, as [`SwarmSnapshot::elapsed`] counts: the server corrected it, or this
    /// process stood still and it then moved a long way at once.
    pub leapt: Option<Duration>,
    /// Its round trip, as QUIC measures it.
    pub round_trip: Duration,
    /// The avatars that its replica holds.
    pub held: Vec<HeldAvatar>,
    /// The same avatars as they are shown at this moment.
    pub shown: Vec<ShownAvatar>,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SwarmError {
    /// No visitor could come in.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// There are no keys for the visitors.
    #[error(transparent)]
    Identity(#[from] IdentityError),
    /// The trace has fewer walks than there are visitors.
    #[error("the trace has {tracks} avatars, not {clients}")]
    TraceTooSmall {
        /// The number of recorded walks.
        tracks: usize,
        /// The number of visitors.
        clients: usize,
    },
    /// The building has no floor where a body can walk.
    #[error("no floor to walk on was found near the spawn points")]
    NoFloor,
}

/// A visitor and its connection.
struct ConnectedVisitor {
    session: Session,
    visitor: Visitor,
    /// The building that it is in.
    world: Arc<World>,
    pose: Pose,
    /// As in [`VisitorView`].
    leapt: Option<Duration>,
    has_ended: bool,
}

/// Sends visitors to a server, and reports what they received. Calls the observer at each
/// [`SwarmOptions::snapshot_interval`]. Must be called within a tokio runtime.
///
/// # Errors
/// When no visitor can come in, the trace has too few walks, or there is no floor.
pub async fn run(
    address: SocketAddr,
    options: &SwarmOptions,
    mut observer: impl FnMut(&SwarmSnapshot),
) -> Result<SwarmReport, SwarmError> {
    let (mut members, mut grounds, joining) = connect_visitors(address, options).await?;
    let (mut misses, mut renewal) = (Misses::default(), Renewal::default());
    let servers = Process::listening_on([address].iter().chain(&options.others));
    let mut statistics =
        SwarmStatistics::new(members.iter().map(|member| &member.session), joining, servers);
    let mut steps = tokio::time::interval(STEP);
    steps.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let start = Instant::now();
    let (mut before, mut next_snapshot) = (Duration::ZERO, Duration::ZERO);
    loop {
        steps.tick().await;
        let elapsed = start.elapsed();
        if elapsed >= options.duration || members.iter().all(|member| member.has_ended) {
            break;
        }
        statistics.stepped(elapsed - before);
        let dt_s = (elapsed - before).as_secs_f32();
        before = elapsed;
        for member in &mut members {
            member.step(&grounds, dt_s, elapsed, &mut statistics);
        }
        let mut present = members.iter().filter(|member| !member.has_ended);
        let elsewhere = present.find(|member| !grounds.are_of(&member.world));
        if let Some(member) = elsewhere
            && let Some(found) = renewal.of(&member.world, options.trace.is_none()).await?
        {
            grounds = found;
        }
        if elapsed >= next_snapshot {
            next_snapshot += options.snapshot_interval;
            let snapshot = snapshot(&members, elapsed);
            let are_here =
                |member: &ConnectedVisitor| member.has_ended || grounds.are_of(&member.world);
            if members.iter().all(are_here) {
                statistics.observe(&snapshot, &grounds.sight);
                misses.observe(&snapshot, &grounds.sight);
                statistics.misses = misses.count();
            }
            observer(&snapshot);
        }
    }
    let lost = members.iter().filter(|member| !member.has_ended && !member.session.is_present());
    statistics.disconnected += lost.count();
    let report = statistics.report(members.iter().map(|member| &member.session), start.elapsed());
    let mut leaving = JoinSet::new();
    for member in members {
        leaving.spawn(member.session.leave());
    }
    leaving.join_all().await;
    Ok(report)
}

impl ConnectedVisitor {
    fn step(
        &mut self,
        grounds: &Grounds,
        dt_s: f32,
        elapsed: Duration,
        statistics: &mut SwarmStatistics,
    ) {
        if self.has_ended {
            return;
        }
        if let Some(reason) = self.session.end() {
            tracing::warn!(avatar = self.session.avatar().0, reason, "a visitor was disconnected");
            statistics.disconnected += 1;
            self.has_ended = true;
            return;
        }
        for event in self.session.events() {
            match event {
                Event::Corrected(pose) => {
                    statistics.corrections += 1;
                    self.leapt = Some(elapsed);
                    self.visitor.correct(pose);
                }
                // It has come back, or is in another building.
                Event::Entered(pose) => {
                    self.world = self.session.world();
                    self.leapt = Some(elapsed);
                    self.pose = pose;
                    self.visitor.move_over(&self.world, pose);
                }
                _ => {}
            }
        }
        if dt_s > LEAP_S {
            self.leapt = Some(elapsed);
        }
        // Nobody walks outside of a world, or where no ways are known yet.
        if self.session.is_present() && grounds.are_of(&self.world) {
            self.pose = self.visitor.step(grounds, dt_s, elapsed.as_secs_f64());
        } else {
            self.pose.velocity = glam::Vec3::ZERO;
        }
        self.session.set_pose(self.pose);
        statistics.moved(self.session.avatar(), elapsed, self.pose, dt_s);
    }
}

fn snapshot(members: &[ConnectedVisitor], elapsed: Duration) -> SwarmSnapshot {
    let view = |member: &ConnectedVisitor| {
        let stats = member.session.stats();
        VisitorView {
            avatar: member.session.avatar(),
            pose: member.pose,
            reporting_state: stats.reporting_state,
            leapt: member.leapt,
            round_trip: stats.round_trip,
            held: member.session.held(),
            shown: member.session.shown_avatars(),
        }
    };
    let tick = members.first().map(|member| member.session.tick_interval()).unwrap_or_default();
    let visitors = members.iter().filter(|member| !member.has_ended).map(view);
    SwarmSnapshot { elapsed, tick, visitors: visitors.collect() }
}

/// Connects all visitors: the first one alone, because it downloads the world, then the others.
/// Also returns the grounds, and how they came in.
async fn connect_visitors(
    address: SocketAddr,
    options: &SwarmOptions,
) -> Result<(Vec<ConnectedVisitor>, Arc<Grounds>, Joining), SwarmError> {
    let tracks: Option<Vec<Track>> = options.trace.as_ref().map(Trace::tracks);
    let tracks = tracks.as_deref();
    if let Some(tracks) = tracks
        && tracks.len() < options.clients
    {
        return Err(SwarmError::TraceTooSmall { tracks: tracks.len(), clients: options.clients });
    }
    let start = |i: usize| tracks.and_then(|tracks| Some(tracks.get(i)?.at(0.0).eye));
    let dialer = options.dialer.clone();
    // The first visitor starts at a spawn point: nothing else is known of the building yet.
    let first = dialer.connect(address, &connect_options(options, 0, start(0))?).await?;
    let world = first.world();
    let grounds = Grounds::find(world.clone(), tracks.is_none()).await?;
    let mut random = SmallRng::seed_from_u64(options.seed);
    let options_by_number = (1..options.clients)
        .map(|i| {
            let place = start(i).or_else(|| grounds.navigation.random(&mut random));
            Ok((i, connect_options(options, i, place)?))
        })
        .collect::<Result<_, IdentityError>>()?;
    let servers: Vec<SocketAddr> = [address].iter().chain(&options.others).copied().collect();
    let (mut sessions, joining) = connect_all(&dialer, &servers, options_by_number).await;
    sessions.insert(0, (0, first));
    let members = sessions.into_iter().map(|(i, session)| {
        let pose = session.pose();
        let visitor = match tracks.and_then(|tracks| tracks.get(i)) {
            Some(track) => Visitor::Recorded(track.clone()),
            None => {
                let seed = options.seed.wrapping_mul(0x9e37_79b9).wrapping_add(i as u64);
                Visitor::Wandering(Box::new(Wanderer::new(&world, pose.eye, seed)))
            }
        };
        let world = session.world();
        // It begins where it has just entered.
        session.events();
        ConnectedVisitor { session, visitor, world, pose, leapt: None, has_ended: false }
    });
    Ok((members.collect(), grounds, joining))
}

/// Connects with each of the options, a few at a time and one after the other, to the servers in
/// turns. Returns the sessions in order, and how they came in.
async fn connect_all(
    dialer: &Arc<Dialer>,
    servers: &[SocketAddr],
    mut options_by_number: VecDeque<(usize, ConnectOptions)>,
) -> (Vec<(usize, Session)>, Joining) {
    let (mut sessions, mut joining) = (Vec::new(), Joining::default());
    let mut connecting = JoinSet::new();
    let begin = Instant::now();
    let mut turns = tokio::time::interval(JOIN_INTERVAL);
    turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        while connecting.len() < CONNECTING_MAX
            && let Some((i, hello)) = options_by_number.pop_front()
        {
            turns.tick().await;
            let (dialer, begin) = (dialer.clone(), Instant::now());
            let address = servers[i % servers.len()];
            connecting.spawn(async move {
                let session = dialer.connect(address, &hello).await;
                (i, session, begin.elapsed())
            });
        }
        match connecting.join_next().await {
            Some(Ok((i, Ok(session), time))) => {
                sessions.push((i, session));
                joining.times.push(time);
            }
            Some(Ok((i, Err(error), _))) => {
                tracing::warn!(visitor = i + 1, %error, "a visitor could not come in");
                joining.refused += 1;
            }
            Some(Err(_)) => joining.refused += 1,
            None => break,
        }
    }
    debug_assert!(connecting.is_empty(), "every attempt has ended");
    joining.whole = begin.elapsed();
    sessions.sort_by_key(|(i, _)| *i);
    (sessions, joining)
}

/// The options of a visitor, which has a key of its own.
fn connect_options(
    options: &SwarmOptions,
    i: usize,
    place: Option<glam::Vec3>,
) -> Result<ConnectOptions, IdentityError> {
    let mut random = SmallRng::seed_from_u64(options.seed ^ i as u64);
    // Bright colours, seldom twice the same.
    let mut colour = [255, random.random_range(40..=255), 40];
    colour.rotate_right(random.random_range(0..3));
    if random.random_bool(0.5) {
        colour.swap(0, 1);
    }
    Ok(ConnectOptions {
        name: Name::clipped(&format!("Visitor {}", i + 1)),
        colour,
        place,
        trust: options.trust.clone(),
        identity: Arc::new(Identity::generate()?),
        invitation: None,
        in_pieces: false,
        progress: None,
    })
}
