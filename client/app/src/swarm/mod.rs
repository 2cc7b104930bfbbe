//! Simulated visitors, many in one process. They wander from room to room, or follow recorded
//! walks. Each has a connection and a replica of its own. What they receive is counted, and what
//! they should have received.

mod grounds;
mod history;
mod joining;
mod misses;
mod processes;
mod promises;
mod report;
mod sight;
mod visitor;

use std::{collections::BTreeMap, net::SocketAddr, sync::Arc, time::Duration};

use sightline_cli::{identity::IdentityError, trace::Trace};
use sightline_client_core::replica::{Event, HeldAvatar, ShownAvatar};
use sightline_world::{
    World,
    motion::{AvatarId, Pose, ReportingState},
};
use tokio::{
    task::JoinSet,
    time::{Instant, MissedTickBehavior},
};

use crate::net::{ConnectError, Dialer, Session, Trust};
use grounds::{Grounds, Renewal};
use misses::Misses;
use processes::Process;
use report::SwarmStatistics;
use visitor::Visitor;

pub use report::SwarmReport;

/// The time between two steps of the visitors.
const STEP: Duration = Duration::from_millis(25);
/// After more time than this without a step, visitors leap. In seconds.
const LEAP_S: f32 = 0.2;
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
    /// Is told how many visitors are in, whenever another one has come in.
    pub on_join: Option<JoinListener>,
}

/// Is told how many visitors are in.
pub type JoinListener = Arc<dyn Fn(usize) + Send + Sync>;

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
            on_join: None,
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

/// Sends visitors to a server, and reports what they received. Where the server lets nobody in for half
/// a minute, they walk without those who are not in. Calls the observer at each
/// [`SwarmOptions::snapshot_interval`]. Must be called within a tokio runtime.
///
/// # Errors
/// When no visitor can come in, the trace has too few walks, or there is no floor.
pub async fn run(
    address: SocketAddr,
    options: &SwarmOptions,
    mut observer: impl FnMut(&SwarmSnapshot),
) -> Result<SwarmReport, SwarmError> {
    let (mut members, mut grounds, joining) = joining::connect_visitors(address, options).await?;
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
                (statistics.misses, statistics.looks) = (misses.count(), misses.looks());
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
