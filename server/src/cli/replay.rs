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
use sightline_server::{
    engine::{Policy, PolicyError, Shape, Validity},
    progress::Progress,
    replay::{self, Comparison, Moment, Options, OracleStride},
    trace::Trace,
};
use sightline_shared::{rooms::Rooms, world::World};

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
    /// How long a TBV is made to last: maximal, adaptive, or so many milliseconds.
    #[arg(long, value_name = "MS", default_value = "maximal")]
    validity: Validity,
    /// What bounds a TBV in space: reach (what the body can do, and what portals lead to), or
    /// sphere (maximum speed times validity, whatever is in between).
    #[arg(long, default_value = "reach")]
    shape: Shape,
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
    /// Writes the figures of the closing table as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What `--policy` names.
#[derive(Clone, Copy, Debug)]
enum Policies {
    One(Policy),
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
    match args.policy {
        Policies::One(policy) => run_one(args, &world, &trace, policy),
        Policies::All => compare(args, &world, &trace),
    }
}

fn run_one(args: &Args, world: &Arc<World>, trace: &Trace, policy: Policy) -> anyhow::Result<()> {
    let options = options(args, policy)?;
    let mut dump = args.dump.as_deref().map(create).transpose()?;
    let progress = Progress::new();
    let mut explanation = None;
    let mut watch = |moment: &Moment<'_>| {
        progress.show("replay", moment.done);
        if let Some(question) = &args.explain
            && explanation.is_none()
            && moment.now >= question.at
        {
            explanation = Some(question.answer(moment));
        }
    };
    let dump = dump.as_mut().map(|file| file as &mut dyn Write);
    let report = replay::run_watched(world, trace, &options, dump, &mut watch);
    progress.finish();
    let report = report.context("cannot write the dump")?;
    super::write_json(args.json.as_deref(), &report)?;
    match explanation {
        Some(text) => super::print(&text),
        None if args.explain.is_some() => anyhow::bail!("the trace ends before that time"),
        None => super::print(&report.to_string()),
    }
}

/// Of whom `--explain` is asked, by the trace's ids, and when.
#[derive(Clone, Copy, Debug)]
struct Question {
    viewer: u32,
    avatar: u32,
    at: Duration,
}

impl Question {
    fn answer(&self, moment: &Moment<'_>) -> String {
        let find = |walker: u32| moment.engine.avatars().find(|id| moment.walker(*id) == walker);
        let both = find(self.viewer).zip(find(self.avatar));
        let found = both.and_then(|(viewer, avatar)| moment.engine.explain(viewer, avatar));
        let when = format!("{:<34} {} ms\n", "at the tick at", moment.now.as_millis());
        match found {
            Some(explanation) => when + &explanation.to_string(),
            None => when + "one of the two is not present\n",
        }
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

fn compare(args: &Args, world: &Arc<World>, trace: &Trace) -> anyhow::Result<()> {
    anyhow::ensure!(args.dump.is_none(), "--dump wants one policy");
    anyhow::ensure!(args.explain.is_none(), "--explain wants one policy");
    let progress = Progress::new();
    let mut comparison = Comparison::default();
    let all = Comparison::POLICIES.len() as f32;
    for policy in Comparison::POLICIES {
        let done = comparison.reports.len() as f32;
        let show = &mut |share| progress.show("replay", (done + share) / all);
        let report = replay::run(world, trace, &options(args, policy)?, None, show)?;
        comparison.reports.push(report);
    }
    progress.finish();
    super::write_json(args.json.as_deref(), &comparison)?;
    super::print(&comparison.to_string())
}

fn options(args: &Args, policy: Policy) -> anyhow::Result<Options> {
    let mut options = Options::new(policy, Duration::from_millis(args.rtt.into()));
    if let Some(speed_max) = args.speed_max {
        anyhow::ensure!(
            speed_max.is_finite() && speed_max > 0.0 && speed_max <= 1_000.0,
            "--speed-max must be above 0 and at most 1000 metres a second"
        );
        options.config.speed_max = Some(speed_max);
    }
    (options.config.validity, options.config.shape) = (args.validity, args.shape);
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
