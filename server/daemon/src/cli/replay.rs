//! The command `sightline-server replay`.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    str::FromStr,
    sync::Arc,
    time::Duration,
};

use anyhow::Context;
use sightline_cli::{
    files::{check_output, read_world},
    output,
    progress::Progress,
    trace::Trace,
};
use sightline_engine::{Config, Policy, PolicyError, TbvShape, Validity};
use sightline_replay::{
    Comparison, Configuration, ConfigurationReport, ConfigurationTable, OracleStride,
    ReplayOptions, TickView,
};
use sightline_world::{World, rooms::Rooms};

/// Runs the engine over a recorded walk, in virtual time and without a network.
///
/// It prints what each client is sent, and checks by rays that nobody visible is missed. Example:
/// `sightline-server replay house.slw walk.csv --policy all` compares all policies.
#[derive(clap::Args)]
pub struct ReplayArgs {
    /// The world file (.slw).
    world: PathBuf,
    /// The trace: where everybody was (.csv or .csv.gz). Its columns are t_ms, id, x, y, z, yaw,
    /// pitch, vx, vy and vz.
    trace: PathBuf,
    /// The policy that decides who is told of whom: broadcast, radius:METRES, grid:METRES,
    /// region:METRES[:MARGIN] (squares with a margin), room[:DOORS] (rooms up to DOORS doors away),
    /// pvs or tbv. With `all`, a table has a row for each. With `peers`, a table compares tbv with
    /// one server, with several, and without any, where each visitor has a station of its own.
    #[arg(long, default_value = "tbv", value_parser = policies)]
    policy: PolicyChoice,
    /// With `--policy peers`: how many servers the network has.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=127))]
    servers: u16,
    /// The round trip of every client, in milliseconds: 0 to 10000.
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u32).range(..=10_000))]
    rtt: u32,
    /// The share of messages that are lost, in per cent: 0 to 50. A lost datagram never arrives.
    /// What goes on a stream arrives a round trip later, and so does all that follows it. The same
    /// messages are lost in every run.
    #[arg(long, value_name = "PER_CENT", default_value_t = 0.0, value_parser = loss_percent)]
    loss: f64,
    /// The speed limit in metres a second, in place of the world's own. An avatar that moves faster
    /// announces a jump.
    #[arg(long, value_name = "METRES")]
    speed_max: Option<f32>,
    /// How long TBVs last: until-left (until the client is about to leave it), maximal (as long as
    /// it stays unseen), adaptive (by how the last one ended), or a number of milliseconds. With
    /// `all`, a table has a row for each, in both shapes.
    #[arg(long, value_name = "VALIDITY", default_value = "until-left", value_parser = validities)]
    validity: ValidityChoice,
    /// What bounds a TBV in space: reach (where the body can get, through portals) or sphere
    /// (greatest speed times validity, through walls as well).
    #[arg(long, default_value = "reach")]
    shape: TbvShape,
    /// The budget of a tick for sight tests between regions. 100000 units take one to five
    /// milliseconds. A pair that the budget does not decide is sent.
    #[arg(long, alias = "look-budget", value_name = "UNITS", default_value_t = Config::default().sight_test_budget)]
    sight_test_budget: u32,
    /// Let live clients report at every tick, and not only when their avatars depart from their
    /// courses.
    #[arg(long)]
    every_tick: bool,
    /// Ignore the rooms and windows of the building's author.
    #[arg(long)]
    no_rooms: bool,
    /// Run only this number of seconds of the trace; by default all of it.
    #[arg(long, value_name = "S")]
    seconds: Option<u32>,
    /// How often rays check what clients hold: off, auto, or an interval in milliseconds.
    #[arg(long, default_value = "auto", value_parser = stride)]
    oracle: OracleStride,
    /// Explain why a viewer was told of an avatar at a time, or was not, in place of the table.
    /// Give two ids and a time of the trace, such as 3,7,12500.
    #[arg(long, value_name = "VIEWER,AVATAR,T_MS")]
    explain: Option<ExplainQuery>,
    /// Write every event to this file, as CSV: t_ms,viewer,avatar,what.
    #[arg(long, value_name = "EVENTS.csv")]
    dump: Option<PathBuf>,
    /// Also write the figures of the table, and those of each client, to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The value of `--policy`.
#[derive(Clone, Copy, Debug)]
enum PolicyChoice {
    One(Policy),
    All,
    Peers,
}

/// The value of `--validity`.
#[derive(Clone, Copy, Debug)]
enum ValidityChoice {
    One(Validity),
    All,
}

/// Runs the command.
pub fn run(args: &ReplayArgs) -> anyhow::Result<()> {
    for file in [&args.dump, &args.json] {
        file.as_deref().map_or(Ok(()), check_output)?;
    }
    let mut world = read_world(&args.world)?;
    if args.no_rooms {
        world.rooms = Rooms::default();
    }
    let world = Arc::new(world);
    let trace = Trace::open(&args.trace).with_context(|| args.trace.display().to_string())?;
    let options = options(args)?;
    let with = |change: &dyn Fn(&mut Config)| {
        let mut changed = options.clone();
        change(&mut changed.config);
        changed
    };
    match (args.policy, args.validity) {
        (PolicyChoice::All, ValidityChoice::One(_)) => {
            let policies = |(policy, by_exception)| {
                with(&|config| (config.policy, config.by_exception) = (policy, by_exception))
            };
            let all = Comparison::POLICIES.map(policies);
            compare(args, &world, &trace, &all)
        }
        (PolicyChoice::One(Policy::Tbv), ValidityChoice::All) => {
            let tbvs = |(shape, validity)| {
                with(&|config| (config.shape, config.validity) = (shape, validity))
            };
            compare(args, &world, &trace, &Comparison::TBVS.map(tbvs))
        }
        (PolicyChoice::Peers, ValidityChoice::One(_)) => {
            configurations(args, &world, &trace, &options)
        }
        (_, ValidityChoice::All) => {
            anyhow::bail!("--validity all needs --policy tbv: other policies have no TBVs")
        }
        (PolicyChoice::One(_), ValidityChoice::One(_)) => match &args.explain {
            Some(query) => explain(query, args, &world, &trace, &options),
            None => run_one(args, &world, &trace, &options),
        },
    }
}

fn run_one(
    args: &ReplayArgs,
    world: &Arc<World>,
    trace: &Trace,
    options: &ReplayOptions,
) -> anyhow::Result<()> {
    let mut dump = args.dump.as_deref().map(create).transpose()?;
    let progress = Progress::new();
    let dump = dump.as_mut().map(|file| file as &mut dyn Write);
    let show = &mut |done| progress.show("replay", done);
    let report = sightline_replay::run(world, trace, options, dump, show);
    progress.finish();
    let report = report.context("cannot write the dump")?;
    output::write_json(args.json.as_deref(), &report)?;
    output::print(&report.to_string())
}

/// Runs a trace, and explains the decision at the tick that was asked about. The audit is off,
/// since it decides nothing.
fn explain(
    query: &ExplainQuery,
    args: &ReplayArgs,
    world: &Arc<World>,
    trace: &Trace,
    options: &ReplayOptions,
) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump goes without --explain");
    anyhow::ensure!(args.json.is_none(), "--json goes without --explain");
    let (first, last) = trace.span();
    let length = options.length.map_or(last - first, |length| length.min(last - first));
    anyhow::ensure!(query.at <= first + length, "--explain: the trace ends before that time");
    let length = (query.at + options.config.tick).saturating_sub(first);
    let (length, oracle) = (Some(length), OracleStride::Off);
    let options = ReplayOptions { length, oracle, ..options.clone() };
    let progress = Progress::new();
    let mut answer = None;
    let mut watch = |tick: &TickView<'_>| {
        progress.show("replay", tick.done);
        if tick.now >= query.at && answer.is_none() {
            answer = Some(query.answer(tick));
        }
    };
    sightline_replay::run_watched(world, trace, &options, None, &mut watch)?;
    progress.finish();
    output::print(&answer.context("--explain: the trace ends before that time")??)
}

/// The value of `--explain`: a viewer and an avatar by the trace's ids, and a time.
#[derive(Clone, Copy, Debug)]
struct ExplainQuery {
    viewer: u32,
    avatar: u32,
    at: Duration,
}

impl ExplainQuery {
    fn answer(&self, tick: &TickView<'_>) -> anyhow::Result<String> {
        let t_ms = tick.now.as_millis();
        let find = |id: u32| {
            let mut present = tick.engine.avatars();
            let found = present.find(|avatar| tick.trace_id(*avatar) == id);
            found.with_context(|| format!("--explain: avatar {id} is not present at {t_ms} ms"))
        };
        let explanation = tick.engine.explain(find(self.viewer)?, find(self.avatar)?);
        let explanation = explanation.context("both are present")?;
        Ok(format!("{:<34} {t_ms} ms\n{explanation}", "at the tick at"))
    }
}

impl FromStr for ExplainQuery {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = "use VIEWER,AVATAR,T_MS: two ids of the trace and a time, as in 3,7,12500";
        let numbers: Result<Vec<u32>, _> = text.split(',').map(str::parse).collect();
        match numbers.map_err(|_| wrong)?[..] {
            [viewer, avatar, t_ms] if viewer != avatar => {
                Ok(Self { viewer, avatar, at: Duration::from_millis(t_ms.into()) })
            }
            _ => Err(wrong),
        }
    }
}

/// Runs a trace with one server, several, and none, and prints a table.
fn configurations(
    args: &ReplayArgs,
    world: &Arc<World>,
    trace: &Trace,
    options: &ReplayOptions,
) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump needs one policy, not peers");
    anyhow::ensure!(args.explain.is_none(), "--explain needs one policy, not peers");
    let (progress, visitors) = (Progress::new(), trace.ids().count());
    let mut table = ConfigurationTable::default();
    let all = Configuration::all(args.servers.into());
    for (done, configuration) in all.into_iter().enumerate() {
        let options = configuration.options(options, visitors);
        let share = |part: f32| (done as f32 + part) / all.len() as f32;
        let show =
            &mut |part| progress.show_with_note("replay", share(part), &configuration.to_string());
        let report = sightline_replay::run(world, trace, &options, None, show)?;
        table.rows.push(ConfigurationReport { configuration, report });
    }
    progress.finish();
    output::write_json(args.json.as_deref(), &table)?;
    output::print(&table.to_string())
}

/// Runs a trace with several options, one after the other, and prints a table.
fn compare(
    args: &ReplayArgs,
    world: &Arc<World>,
    trace: &Trace,
    all: &[ReplayOptions],
) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump needs one policy and one validity, not all");
    anyhow::ensure!(args.explain.is_none(), "--explain needs one policy and one validity, not all");
    let progress = Progress::new();
    let mut comparison = Comparison::default();
    for options in all {
        let done = comparison.reports.len() as f32;
        let show = &mut |share| progress.show("replay", (done + share) / all.len() as f32);
        let report = sightline_replay::run(world, trace, options, None, show)?;
        comparison.reports.push(report);
    }
    progress.finish();
    output::write_json(args.json.as_deref(), &comparison)?;
    output::print(&comparison.to_string())
}

/// The options of one run. Where a flag says `all`, this has what `serve` does.
fn options(args: &ReplayArgs) -> anyhow::Result<ReplayOptions> {
    let policy = if let PolicyChoice::One(policy) = args.policy { policy } else { Policy::Tbv };
    let mut options = ReplayOptions::new(policy, Duration::from_millis(args.rtt.into()));
    if args.loss > 0.0 {
        options.network.loss = args.loss / 100.0;
        // Some messages are late now, so the engine measures by how much, as it is served.
        options.config.margin = Config::default().margin;
    }
    if let Some(speed_max) = args.speed_max {
        anyhow::ensure!(
            speed_max.is_finite() && speed_max > 0.0 && speed_max <= 1_000.0,
            "--speed-max must be above 0 and at most 1000 metres a second"
        );
        options.config.speed_max = Some(speed_max);
    }
    if let ValidityChoice::One(validity) = args.validity {
        options.config.validity = validity;
    }
    options.config.shape = args.shape;
    options.config.by_exception = !args.every_tick;
    options.config = options.config.with_sight_test_budget(args.sight_test_budget);
    options.length = args.seconds.map(|seconds| Duration::from_secs(seconds.into()));
    options.oracle = args.oracle;
    Ok(options)
}

fn create(path: &Path) -> anyhow::Result<File> {
    File::create(path).with_context(|| format!("cannot write {}", path.display()))
}

fn policies(text: &str) -> Result<PolicyChoice, PolicyError> {
    match text {
        "all" => Ok(PolicyChoice::All),
        "peers" => Ok(PolicyChoice::Peers),
        _ => text.parse().map(PolicyChoice::One),
    }
}

fn validities(text: &str) -> Result<ValidityChoice, &'static str> {
    if text == "all" { Ok(ValidityChoice::All) } else { text.parse().map(ValidityChoice::One) }
}

fn loss_percent(text: &str) -> Result<f64, &'static str> {
    let loss = text.parse().ok().filter(|loss| (0.0..=50.0).contains(loss));
    loss.ok_or("use a number from 0 to 50")
}

fn stride(text: &str) -> Result<OracleStride, String> {
    match text {
        "off" => Ok(OracleStride::Off),
        "auto" => Ok(OracleStride::Auto),
        ms => match ms.parse() {
            Ok(ms @ 1..=3_600_000) => Ok(OracleStride::Every(Duration::from_millis(ms))),
            _ => Err("use off, auto, or an interval from 1 to 3600000 milliseconds".to_owned()),
        },
    }
}
