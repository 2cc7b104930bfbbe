//! One row: a crowd, its clients, and the engine that they talk to.

use std::{
    collections::VecDeque,
    fmt,
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::Context;
use cpu_time::ProcessTime;
use rand::{Rng, SeedableRng, rngs::SmallRng};
use serde::{Deserialize, Serialize};
use sightline_cli::percentile::percentile;
use sightline_client_core::reporting::Reporter;
use sightline_engine::{Config, Engine, Input, Margin, Output};
use sightline_world::{
    World,
    motion::{AvatarId, Tbv, Tolerance},
};

use super::{
    Args, annex,
    crowd::{Floors, Pedestrians},
};

/// The figures of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EngineRow {
    /// The policy, as on the command line of `replay`.
    pub policy: String,
    /// The number of threads that share a tick.
    pub threads: usize,
    /// The number of avatars that walk in the building.
    pub walkers: usize,
    /// The number of avatars in closed rooms of their own.
    pub hidden: usize,
    /// The number of measured ticks.
    pub ticks: usize,
    /// The median CPU time of the engine per tick, in milliseconds.
    pub cpu_median_ms: f64,
    /// The 99th percentile of the CPU time per tick, in milliseconds.
    pub cpu_p99_ms: f64,
    /// The mean CPU time per tick, in milliseconds.
    pub cpu_mean_ms: f64,
    /// The median wall-clock time per tick, in milliseconds.
    pub wall_median_ms: f64,
    /// The 99th percentile of the wall-clock time per tick, in milliseconds.
    pub wall_p99_ms: f64,
    /// The mean number of avatars that a walker's client holds.
    pub held_mean: f64,
    /// The mean number of live clients.
    pub live_mean: f64,
    /// The mean number of quiet clients.
    pub quiet_mean: f64,
    /// Avatar states sent to clients, per tick.
    pub states_a_tick: f64,
    /// Reports received, per tick.
    pub reports_a_tick: f64,
    /// Expiries, per tick.
    pub expiries_a_tick: f64,
    /// Reveals, per tick.
    pub reveals_a_tick: f64,
    /// The memory of the engine, the crowd and its messages, in 10^6 bytes; 0 where the system does
    /// not tell.
    pub memory_mb: f64,
}

impl EngineRow {
    /// The names of the columns.
    pub fn heading() -> String {
        format!(
            "{:<10} {:>7} {:>8} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>9} {:>9} {:>10} {:>9} {:>8} {:>8} {:>9} {:>6}",
            "policy",
            "threads",
            "walking",
            "hidden",
            "median ms",
            "p99 ms",
            "mean ms",
            "wall ms",
            "its p99",
            "held",
            "live",
            "quiet",
            "states",
            "reports",
            "expired",
            "revealed",
            "memory MB",
            "ticks"
        )
    }
}

impl fmt::Display for EngineRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:<10} {:>7} {:>8} {:>8} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>8.2} {:>9.0} {:>9.0} {:>10.0} \
             {:>9.0} {:>8.1} {:>8.1} {:>9.0} {:>6}",
            self.policy,
            self.threads,
            self.walkers,
            self.hidden,
            self.cpu_median_ms,
            self.cpu_p99_ms,
            self.cpu_mean_ms,
            self.wall_median_ms,
            self.wall_p99_ms,
            self.held_mean,
            self.live_mean,
            self.quiet_mean,
            self.states_a_tick,
            self.reports_a_tick,
            self.expiries_a_tick,
            self.reveals_a_tick,
            self.memory_mb,
            self.ticks
        )
    }
}

/// The size of a crowd.
#[derive(Clone, Copy, Debug)]
pub struct CrowdSize {
    /// The number of avatars that walk in the building.
    pub walkers: usize,
    /// The number of avatars in closed rooms of their own.
    pub hidden: usize,
}

/// Measures one row.
pub fn row(world: &World, args: &Args, size: CrowdSize) -> anyhow::Result<EngineRow> {
    let CrowdSize { walkers, hidden } = size;
    let (world, closed) = annex::with_annex(world, hidden);
    annex::check(&world, &closed);
    let plan = sightline_demo_building::plan(args.rooms(), args.seed);
    let mut seeds = SmallRng::seed_from_u64(args.seed);
    let mut rng = || SmallRng::seed_from_u64(seeds.random());
    let before = resident_bytes();
    let crowd = Pedestrians::new(Floors::new(&plan), walkers, &closed, &mut rng);
    let mut run = EngineRun::new(&world, args, crowd);
    let wanted = args.seconds.max(1) * 20;
    run.steps(wanted as usize, args.patience);
    run.count = TickSums::default();
    let stats = run.engine.stats();
    run.steps(wanted as usize, args.patience);
    let memory = resident_bytes().saturating_sub(before);
    let now = run.engine.stats();
    let ended = [now.expiries - stats.expiries, now.reveals - stats.reveals];
    let policy = args.policy.to_string();
    let row = run.count.row(policy, size, ended, memory);
    Ok(EngineRow { threads: args.threads, ..row.context("nothing was measured")? })
}

/// Sums over the measured ticks.
#[derive(Default)]
struct TickSums {
    cpu: Vec<f64>,
    wall: Vec<f64>,
    held: u64,
    live: u64,
    quiet: u64,
    states: u64,
    reports: u64,
}

impl TickSums {
    fn row(
        mut self,
        policy: String,
        size: CrowdSize,
        ended: [u64; 2],
        memory_bytes: u64,
    ) -> Option<EngineRow> {
        let ticks = self.cpu.len();
        let of = |count: u64| count as f64 / ticks as f64;
        self.cpu.sort_unstable_by(f64::total_cmp);
        self.wall.sort_unstable_by(f64::total_cmp);
        Some(EngineRow {
            policy,
            threads: 1,
            walkers: size.walkers,
            hidden: size.hidden,
            ticks,
            cpu_median_ms: percentile(&self.cpu, 50)?,
            cpu_p99_ms: percentile(&self.cpu, 99)?,
            wall_median_ms: percentile(&self.wall, 50)?,
            wall_p99_ms: percentile(&self.wall, 99)?,
            cpu_mean_ms: self.cpu.iter().sum::<f64>() / ticks as f64,
            held_mean: of(self.held) / size.walkers as f64,
            live_mean: of(self.live),
            quiet_mean: of(self.quiet),
            states_a_tick: of(self.states),
            reports_a_tick: of(self.reports),
            expiries_a_tick: of(ended[0]),
            reveals_a_tick: of(ended[1]),
            memory_mb: memory_bytes as f64 / 1e6,
        })
    }
}

/// What the server told a client to do.
#[derive(Clone, Copy, Debug)]
enum ClientOrder {
    Enter,
    Live(Tolerance),
    Quiet(Tbv),
    Ask,
}

struct EngineRun {
    world: Arc<World>,
    engine: Engine,
    crowd: Pedestrians,
    /// By avatar id, in the order of the crowd's pedestrians.
    clients: Vec<Reporter>,
    one_way: Duration,
    now: Duration,
    /// By time of arrival.
    up: VecDeque<(Duration, Input)>,
    down: VecDeque<(Duration, AvatarId, ClientOrder)>,
    outputs: Vec<Output>,
    count: TickSums,
}

impl EngineRun {
    fn new(world: &Arc<World>, args: &Args, crowd: Pedestrians) -> Self {
        let config = Config {
            policy: args.policy,
            margin: Margin::Fixed(Duration::ZERO),
            avatars_max: crowd.walkers.len(),
            threads: args.threads,
            by_exception: !args.every_tick,
            ..Config::default()
        };
        let mut engine = Engine::new(Arc::clone(world), config);
        let round_trip = Duration::from_millis(args.rtt.into());
        for (i, walker) in crowd.walkers.iter().enumerate() {
            let (avatar, name) = (AvatarId(i as u32), format!("walker {i}"));
            let place = Some(walker.eye);
            engine.handle(Duration::ZERO, Input::Join { avatar, name, colour: [128; 3], place });
            engine.handle(Duration::ZERO, Input::RoundTrip { avatar, round_trip });
        }
        let client = Reporter::new(engine.config().tick, engine.agility());
        Self {
            world: Arc::clone(world),
            engine,
            clients: vec![client; crowd.walkers.len()],
            crowd,
            one_way: round_trip / 2,
            now: Duration::ZERO,
            up: VecDeque::new(),
            down: VecDeque::new(),
            outputs: Vec::new(),
            count: TickSums::default(),
        }
    }

    /// Simulates some ticks. Stops after `patience_s` seconds of real time, but not within the
    /// first virtual second.
    fn steps(&mut self, wanted: usize, patience_s: u64) {
        let start = Instant::now();
        for step in 0..wanted {
            if step >= 20 && start.elapsed().as_secs() >= patience_s {
                return;
            }
            self.step();
        }
    }

    /// Simulates one tick, and everything that leads up to it.
    fn step(&mut self) {
        let tick = self.engine.config().tick;
        self.now += tick;
        self.crowd.step(&self.world, tick.as_secs_f32());
        self.obey();
        self.report();
        let arrived = self.up.partition_point(|(at, _)| *at <= self.now);
        let inputs: Vec<_> = self.up.drain(..arrived).collect();
        self.count.reports += inputs.len() as u64;
        self.outputs.clear();
        let (start, wall) = (ProcessTime::now(), Instant::now());
        for (at, input) in inputs {
            self.engine.handle(at, input);
        }
        self.engine.tick(self.now, &mut self.outputs);
        self.count.cpu.push(start.elapsed().as_secs_f64() * 1e3);
        self.count.wall.push(wall.elapsed().as_secs_f64() * 1e3);
        self.take_in();
    }

    /// Applies the orders that have reached the clients.
    fn obey(&mut self) {
        let arrived = self.down.partition_point(|(at, ..)| *at <= self.now);
        let orders: Vec<_> = self.down.drain(..arrived).collect();
        for (_, to, order) in orders {
            let client = &mut self.clients[to.0 as usize];
            match order {
                ClientOrder::Enter => client.enter(),
                ClientOrder::Live(tolerance) => client.expect_reports(tolerance),
                ClientOrder::Quiet(tbv) => client.expect_silence(tbv),
                ClientOrder::Ask => client.ask(),
            }
        }
    }

    /// Sends the reports that are due.
    fn report(&mut self) {
        let arrival = self.now + self.one_way;
        for (i, (client, walker)) in (0..).zip(self.clients.iter_mut().zip(&self.crowd.walkers)) {
            if let Some((_, report)) = client.tick(self.now, &walker.pose(), 2 * self.one_way) {
                self.up.push_back((arrival, Input::Report { avatar: AvatarId(i), report }));
            }
        }
    }

    fn take_in(&mut self) {
        for output in &self.outputs {
            let (to, order) = match output {
                Output::Entered { to, .. } => (*to, ClientOrder::Enter),
                Output::Live { to, tolerance } => (*to, ClientOrder::Live(*tolerance)),
                Output::Quiet { to, tbv } => (*to, ClientOrder::Quiet(*tbv)),
                Output::Ask { to } => (*to, ClientOrder::Ask),
                Output::Appear { .. } => {
                    self.count.states += 1;
                    continue;
                }
                Output::Poses { poses, .. } => {
                    self.count.states += poses.len() as u64;
                    continue;
                }
                _ => continue,
            };
            self.down.push_back((self.now + self.one_way, to, order));
        }
        let counts = self.engine.counts();
        self.count.live += counts.live as u64;
        self.count.quiet += counts.quiet as u64;
        let held = |i: usize| self.engine.held_by(AvatarId(i as u32)).count() as u64;
        self.count.held += (0..self.clients.len()).map(held).sum::<u64>();
    }
}

/// The resident memory of this process, in bytes; 0 where the system does not tell.
fn resident_bytes() -> u64 {
    let pages = std::fs::read_to_string("/proc/self/statm").ok();
    let pages = pages.and_then(|text| text.split(' ').nth(1)?.parse::<u64>().ok());
    pages.unwrap_or(0) * 4_096
}
