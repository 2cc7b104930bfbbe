//! `sightline-server replay`.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    str::FromStr,
    sync::Arc,
    time::Duration,
};

use anyhow::Context;
use sightline_cli::{output, progress::Progress, trace::Trace};
use sightline_engine::{Config, Policy, PolicyError, TbvShape, Validity};
use sightline_replay::{self as replay, Comparison, OracleStride, ReplayOptions, TickView};
use sightline_world::{World, rooms::Rooms};

/// Runs the engine over a recorded trace, without sockets.
#[derive(clap::Args)]
pub struct Args {
    /// The world (.slw).
    world: PathBuf,
    /// Where everyone was (.csv or .csv.gz).
    trace: PathBuf,
    /// Who is told what: broadcast, radius:METRES, grid:METRES, region:METRES[:MARGIN] (squares with
    /// a margin), room[:DOORS] (rooms, and those so many doors away), pvs or tbv; or all, one after
    /// the other, for a table with a row each.
    #[arg(long, default_value = "tbv", value_parser = policies)]
    policy: Policies,
    /// Every client's round trip, in milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u32).range(..=10_000))]
    rtt: u32,
    /// Faster than this nobody moves without announcing a jump, in metres a second, in place of the
    /// limit that the world has.
    #[arg(long, value_name = "METRES")]
    speed_max: Option<f32>,
    /// How long a TBV is made to last: until-left (its client says when it is about to leave it),
    /// maximal (as long as it stays unseen), adaptive (by how the last one ended), or so many milliseconds;
    /// or all, in both shapes, for a table with a row each.
    #[arg(long, value_name = "VALIDITY", default_value = "until-left", value_parser = validities)]
    validity: Validities,
    /// What bounds a TBV in space: reach (what the body can do, and what portals lead to), or
    /// sphere (maximum speed times validity, whatever is in between).
    #[arg(long, default_value = "reach")]
    shape: TbvShape,
    /// What all sight tests between regions may cost in a tick, in units of which 100,000 take one to
    /// five milliseconds. A pair that the budget does not decide is sent.
    #[arg(long, alias = "look-budget", value_name = "UNITS", default_value_t = Config::default().sight_test_budget)]
    sight_test_budget: u32,
    /// Leaves aside what the building's author says of rooms and windows.
    #[arg(long)]
    no_rooms: bool,
    /// Only so many seconds of the trace.
    #[arg(long, value_name = "S")]
    seconds: Option<u32>,
    /// How often rays check what is held: off, auto, or every so many milliseconds.
    #[arg(long, default_value = "auto", value_parser = stride)]
    oracle: OracleStride,
    /// Tells why an avatar was sent to a viewer at a time, or not, in place of the table.
    #[arg(long, value_name = "VIEWER,AVATAR,T_MS")]
    explain: Option<Question>,
    /// Writes every event as CSV: t_ms,viewer,avatar,what.
    #[arg(long, value_name = "EVENTS.csv")]
    dump: Option<PathBuf>,
    /// Writes the figures of the closing table, and those of each client, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What `--policy` names.
#[derive(Clone, Copy, Debug)]
enum Policies {
    One(Policy),
    All,
}

/// What `--validity` names.
#[derive(Clone, Copy, Debug)]
enum Validities {
    One(Validity),
    All,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut world = World::read(&args.world)?;
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
        (Policies::All, Validities::One(_)) => {
            let all = Comparison::POLICIES.map(|policy| with(&|config| config.policy = policy));
            compare(args, &world, &trace, &all)
        }
        (Policies::One(Policy::Tbv), Validities::All) => {
            let tbvs = |(shape, validity)| {
                with(&|config| (config.shape, config.validity) = (shape, validity))
            };
            compare(args, &world, &trace, &Comparison::TBVS.map(tbvs))
        }
        (_, Validities::All) => anyhow::bail!("--validity all goes with --policy tbv"),
        (Policies::One(_), Validities::One(_)) => match &args.explain {
            Some(question) => explain(question, args, &world, &trace, &options),
            None => run_one(args, &world, &trace, &options),
        },
    }
}

fn run_one(
    args: &Args,
    world: &Arc<World>,
    trace: &Trace,
    options: &ReplayOptions,
) -> anyhow::Result<()> {
    let mut dump = args.dump.as_deref().map(create).transpose()?;
    let progress = Progress::new();
    let dump = dump.as_mut().map(|file| file as &mut dyn Write);
    let show = &mut |done| progress.show("replay", done);
    let report = replay::run(world, trace, options, dump, show);
    progress.finish();
    let report = report.context("cannot write the dump")?;
    output::write_json(args.json.as_deref(), &report)?;
    output::print(&report.to_string())
}

/// Runs a trace up to the tick that is asked about. What rays would say of it changes nothing.
fn explain(
    question: &Question,
    args: &Args,
    world: &Arc<World>,
    trace: &Trace,
    options: &ReplayOptions,
) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump goes without --explain");
    anyhow::ensure!(args.json.is_none(), "--json goes without --explain");
    let (first, last) = trace.span();
    let length = options.length.map_or(last - first, |length| length.min(last - first));
    anyhow::ensure!(question.at <= first + length, "the trace ends before that time");
    let length = (question.at + options.config.tick).saturating_sub(first);
    let (length, oracle) = (Some(length), OracleStride::Off);
    let options = ReplayOptions { length, oracle, ..options.clone() };
    let progress = Progress::new();
    let mut answer = None;
    let mut watch = |moment: &TickView<'_>| {
        progress.show("replay", moment.done);
        if moment.now >= question.at && answer.is_none() {
            answer = Some(question.answer(moment));
        }
    };
    replay::run_watched(world, trace, &options, None, &mut watch)?;
    progress.finish();
    output::print(&answer.context("the trace ends before that time")??)
}

/// Of whom `--explain` is asked, by the trace's ids, and when.
#[derive(Clone, Copy, Debug)]
struct Question {
    viewer: u32,
    avatar: u32,
    at: Duration,
}

impl Question {
    fn answer(&self, moment: &TickView<'_>) -> anyhow::Result<String> {
        let t_ms = moment.now.as_millis();
        let find = |walker: u32| {
            let mut present = moment.engine.avatars();
            let found = present.find(|id| moment.trace_id(*id) == walker);
            found.with_context(|| format!("{walker} is not present at {t_ms} ms"))
        };
        let explanation = moment.engine.explain(find(self.viewer)?, find(self.avatar)?);
        let explanation = explanation.context("both are present")?;
        Ok(format!("{:<34} {t_ms} ms\n{explanation}", "at the tick at"))
    }
}

impl FromStr for Question {
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

/// Runs a trace in several ways, one after the other.
fn compare(
    args: &Args,
    world: &Arc<World>,
    trace: &Trace,
    ways: &[ReplayOptions],
) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump wants one policy and one validity");
    anyhow::ensure!(args.explain.is_none(), "--explain wants one policy and one validity");
    let progress = Progress::new();
    let mut comparison = Comparison::default();
    for options in ways {
        let done = comparison.reports.len() as f32;
        let show = &mut |share| progress.show("replay", (done + share) / ways.len() as f32);
        let report = replay::run(world, trace, options, None, show)?;
        comparison.reports.push(report);
    }
    progress.finish();
    output::write_json(args.json.as_deref(), &comparison)?;
    output::print(&comparison.to_string())
}

/// As the arguments say; where they say all, as it is served.
fn options(args: &Args) -> anyhow::Result<ReplayOptions> {
    let policy = if let Policies::One(policy) = args.policy { policy } else { Policy::Tbv };
    let mut options = ReplayOptions::new(policy, Duration::from_millis(args.rtt.into()));
    if let Some(speed_max) = args.speed_max {
        anyhow::ensure!(
            speed_max.is_finite() && speed_max > 0.0 && speed_max <= 1_000.0,
            "--speed-max must be above 0 and at most 1000 metres a second"
        );
        options.config.speed_max = Some(speed_max);
    }
    if let Validities::One(validity) = args.validity {
        options.config.validity = validity;
    }
    options.config.shape = args.shape;
    options.config = options.config.with_sight_test_budget(args.sight_test_budget);
    options.length = args.seconds.map(|seconds| Duration::from_secs(seconds.into()));
    options.oracle = args.oracle;
    Ok(options)
}

fn create(path: &Path) -> anyhow::Result<File> {
    File::create(path).with_context(|| format!("cannot write {}", path.display()))
}

fn policies(text: &str) -> Result<Policies, PolicyError> {
    if text == "all" { Ok(Policies::All) } else { text.parse().map(Policies::One) }
}

fn validities(text: &str) -> Result<Validities, &'static str> {
    if text == "all" { Ok(Validities::All) } else { text.parse().map(Validities::One) }
}

fn stride(text: &str) -> Result<OracleStride, String> {
    match text {
        "off" => Ok(OracleStride::Off),
        "auto" => Ok(OracleStride::Auto),
        ms => match ms.parse() {
            Ok(ms @ 1..=3_600_000) => Ok(OracleStride::Every(Duration::from_millis(ms))),
            _ => Err("use off, auto, or milliseconds above 0".to_owned()),
        },
    }
}
