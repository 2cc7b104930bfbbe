//! `sightline-server owner`, `allow` and `invite`: who may do what, and who is let in.

use std::path::{Path, PathBuf};

use sightline_cli::output;
use sightline_protocol::fingerprint::KeyFingerprint;
use sightline_server::people::{Act, Database, Role, hash, new_invitation};

use super::serve::data_folder;

/// Who acts, for the audit log.
const OPERATOR: &str = "operator";

/// Where the server remembers people.
#[derive(clap::Args)]
struct DataFlag {
    /// The data folder of the server. By default it is in your home folder.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// Makes somebody an owner of the server, who may make moderators and do all that they may.
///
/// A server that runs takes it in within a second.
#[derive(clap::Args)]
pub struct OwnerArgs {
    /// The fingerprint of their key, which `sightline-client walk` prints.
    #[arg(value_name = "FINGERPRINT")]
    key: KeyFingerprint,
    #[command(flatten)]
    data: DataFlag,
}

/// Puts somebody on the list of those who are let in, where not everybody is.
///
/// A server that runs takes it in within a second. `access` in its settings says who is let in.
#[derive(clap::Args)]
pub struct AllowArgs {
    /// The fingerprint of their key, which `sightline-client walk` prints.
    #[arg(value_name = "FINGERPRINT")]
    key: KeyFingerprint,
    #[command(flatten)]
    data: DataFlag,
}

/// Prints an invitation, with which people come in where not everybody is let in.
///
/// They give it once, with `sightline-client walk --invitation`, and are on the list from then on.
#[derive(clap::Args)]
pub struct InviteArgs {
    /// How many people it lets in.
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    uses: u32,
    #[command(flatten)]
    data: DataFlag,
}

/// Runs `owner`.
pub fn make_owner(args: &OwnerArgs) -> anyhow::Result<()> {
    act(args.data.data.as_deref(), Act::SetRole(args.key, Role::Owner))?;
    output::print(&format!("{} is an owner\n", args.key))
}

/// Runs `allow`.
pub fn allow(args: &AllowArgs) -> anyhow::Result<()> {
    act(args.data.data.as_deref(), Act::Allow(args.key))?;
    output::print(&format!("{} is let in\n", args.key))
}

/// Runs `invite`.
pub fn invite(args: &InviteArgs) -> anyhow::Result<()> {
    let invitation = new_invitation()?;
    act(args.data.data.as_deref(), Act::Invite(hash(&invitation), args.uses))?;
    output::print(&format!("{invitation}\n"))
}

fn act(data: Option<&Path>, act: Act) -> anyhow::Result<()> {
    let folder = data.map_or_else(data_folder, |folder| Ok(folder.to_owned()))?;
    Ok(Database::open(&folder)?.act(OPERATOR, act, "")?)
}
