//! `sightline-client walk`.

use std::{path::PathBuf, sync::Arc, time::Duration};

use anyhow::{Context, bail, ensure};
use sightline_cli::{
    files::read_world,
    flags,
    identity::Identity,
    log::{self, LogFormat},
    output,
};
use sightline_client::{
    desktop::{self, Drawing, WalkSummary, WorldSource},
    net::{self, Connector, Trust},
};
use sightline_protocol::{
    fingerprint::Fingerprint,
    text::{ChatLine, Name},
};

use super::flags::ModeFlag;

/// Opens a window in a shared building.
///
/// The window opens at once and joins the server meanwhile. When the server is lost it says so, and
/// joins it again by itself. WASD walk, the mouse (after a click) or the arrow keys look around,
/// Shift runs, Space jumps, F flies, Enter chats, Tab lists the people near you, M shows the plan
/// of the storey, Home goes back to the entrance, R shows rooms, V what rooms hide, F1 all keys.
/// Escape leaves.
#[derive(clap::Args)]
pub struct Args {
    /// The server, as host:port.
    #[arg(value_name = "ADDR", default_value = "localhost:4777")]
    address: String,
    /// The name that others see; when absent, your user name.
    #[arg(long)]
    name: Option<String>,
    /// The fingerprint of the server's certificate. When absent, the server first met at this
    /// address is trusted.
    #[arg(long, value_name = "HEX")]
    fingerprint: Option<Fingerprint>,
    /// The file with your key, by which servers know you again. It is made if there is none. By
    /// default it is in your home folder.
    #[arg(long, value_name = "FILE")]
    identity: Option<PathBuf>,
    /// An invitation, for a server that does not let everybody in. It is needed once.
    #[arg(long, value_name = "TEXT")]
    invitation: Option<String>,
    /// Walk in a world file (.slw) without a server. Ctrl and a number bookmark the view, and the
    /// number alone flies to it.
    #[arg(long, value_name = "WORLD.slw", conflicts_with_all = ["address", "fingerprint", "identity"])]
    world: Option<PathBuf>,
    /// Leave out the nodes that cannot be seen from a box around the eye. A separate thread finds
    /// them ahead of the eye. The picture is the same; `bench --fuzzy` measures what it saves.
    #[arg(long)]
    fuzzy: bool,
    /// How the building is drawn. The picture is the same.
    #[arg(long, value_name = "MODE", value_enum, default_value_t)]
    mode: ModeFlag,
    /// Leave after this many seconds; by default only when told to.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    log::show_log("warn,winit=error", LogFormat::Text);
    ensure!(desktop::has_display(), "there is no display to open a window on");
    let end = match args.seconds.map(Duration::try_from_secs_f64) {
        None => None,
        Some(Ok(end)) => Some(end),
        Some(Err(_)) => bail!("--seconds must be a positive number of seconds"),
    };
    let summary = match &args.world {
        Some(path) => {
            let world = Arc::new(read_world(path)?);
            let spawn = *world.spawns.first().context("the world has no spawn point")?;
            desktop::run(WorldSource::Alone(&world, spawn), options(args, &world.title, end))?
        }
        None => visit(args, end)?,
    };
    print_summary(&summary)
}

fn visit(args: &Args, end: Option<Duration>) -> anyhow::Result<WalkSummary> {
    let name = match &args.name {
        Some(name) => Name::new(name).context("--name")?,
        None => {
            let user = std::env::var("USER").or_else(|_| std::env::var("USERNAME"));
            Name::new(&user.unwrap_or_default()).or_else(|_| Name::new("visitor"))?
        }
    };
    let invitation = args.invitation.as_deref().map(ChatLine::new).transpose();
    let invitation = invitation.context("--invitation")?;
    let trust = match args.fingerprint {
        Some(fingerprint) => Trust::Pinned(fingerprint),
        None => Trust::of_user().context("there is no home folder: give --fingerprint")?,
    };
    let own_file = || net::identity_of_user().context("there is no home folder: give --identity");
    let identity = Identity::keep_in(&args.identity.clone().map_or_else(own_file, Ok)?)?;
    output::note(&format!("your key is {}", identity.key_fingerprint()));
    let address = flags::resolve(&args.address)?;
    let colour = colour_of(name.as_str());
    let identity = Arc::new(identity);
    let joins = net::ConnectOptions {
        colour,
        name,
        place: None,
        trust,
        identity,
        invitation,
        // Hidden nodes are found in a whole building.
        in_pieces: !args.fuzzy,
        progress: None,
    };
    let connector = Connector::new(address, joins, net::world_folder_of_user())?;
    let server = WorldSource::Server(Box::new(connector), args.address.clone());
    let summary = desktop::run(server, options(args, "Sightline", end))?;
    match &summary.ended {
        Some(reason) if !summary.came_in => bail!("{reason}"),
        _ => Ok(summary),
    }
}

fn options<'a>(args: &Args, title: &'a str, end: Option<Duration>) -> desktop::WindowOptions<'a> {
    desktop::WindowOptions {
        title,
        end,
        stop: None,
        drawing: Drawing { fuzzy: args.fuzzy, mode: args.mode.into() },
    }
}

/// A strong colour that depends on the name alone.
fn colour_of(name: &str) -> [u8; 3] {
    let hash = blake3::hash(name.as_bytes());
    let hue = f32::from(hash.as_bytes()[0]) / 256.0 * 6.0;
    let ramp = |shift: f32| ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
    [0.0, 4.0, 2.0].map(|shift| (60.0 + 180.0 * ramp(shift).clamp(0.0, 1.0)) as u8)
}

fn print_summary(summary: &WalkSummary) -> anyhow::Result<()> {
    let (width, height) = summary.size;
    output::print(&format!(
        "{} frames in {:.1} s ({:.1} per second, {:.1} ms each to draw) at {width} × {height}\n",
        summary.frames,
        summary.seconds,
        summary.frames_per_s(),
        summary.draw_ms,
    ))?;
    if let Some(reason) = &summary.ended {
        output::print(&format!("at the end there was no connection: {reason}\n"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_a_strong_colour() {
        for name in ["Ada", "Bob", "visitor", ""] {
            let colour = colour_of(name);
            let (min, max) = (colour.iter().min(), colour.iter().max());
            assert!(min == Some(&60) && max == Some(&240), "{colour:?}");
        }
    }
}
