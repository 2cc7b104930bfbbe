//! The command `sightline-server status`.

use std::{
    io::IsTerminal,
    net::SocketAddr,
    path::PathBuf,
    time::{Duration, Instant},
};

use sightline_cli::{flags::local_address, output};
use sightline_server::{http::ask_overview, operate::Overview};
use tokio::time::sleep;

use super::status_table::StatusFigures;

/// Shows what a running server does: clients, tick times, traffic.
///
/// On a terminal it is a live table, until Ctrl-C. Elsewhere it is a line a second. The server must
/// listen for operators (`serve --http`).
#[derive(clap::Args)]
pub struct StatusArgs {
    /// The address for operators that `serve` prints: a port of this machine, or an address and a
    /// port.
    #[arg(default_value = "127.0.0.1:4778", value_parser = local_address)]
    address: SocketAddr,
    /// Show the present state and end.
    #[arg(long)]
    once: bool,
    /// Write the present state to a JSON file and end.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// How often the state is shown.
const INTERVAL: Duration = Duration::from_secs(1);
/// Moves to the top left of a terminal, and clears what is below.
const CLEAR: &str = "\x1b[H\x1b[J";

/// Runs the command.
pub fn run(args: &StatusArgs) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(show(args))
}

async fn show(args: &StatusArgs) -> anyhow::Result<()> {
    let is_live = std::io::stdout().is_terminal() && !args.once;
    let mut before: Option<(Instant, Overview)> = None;
    let mut ended = std::pin::pin!(super::interrupt::ended());
    loop {
        let overview = tokio::select! {
            signal = &mut ended => return Ok(signal?),
            overview = ask_overview(args.address) => overview?,
        };
        let since = before.as_ref().map(|(at, overview)| (at.elapsed(), overview));
        let figures = StatusFigures::new(&overview, since);
        if args.json.is_some() {
            return output::write_json(args.json.as_deref(), &figures);
        }
        if is_live {
            output::print(&format!("{CLEAR}{}", figures.whole()))?;
        } else if args.once {
            return output::print(&figures.whole());
        } else {
            output::print(&figures.line())?;
        }
        before = Some((Instant::now(), overview));
        tokio::select! {
            signal = &mut ended => return Ok(signal?),
            () = sleep(INTERVAL) => {}
        }
    }
}
