//! `sightline-server owner`, `allow` and `invite`: who may do what, and who is let in. `chat` and
//! `audit`: what was said and done.

use std::path::PathBuf;

use sightline_cli::output;
use sightline_protocol::fingerprint::KeyFingerprint;
use sightline_server::people::{
    Act, AuditRecord, ChatRecord, Database, Role, hash, new_invitation,
};

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

/// Prints what visitors said lately.
///
/// Only a server whose settings have `chat_days` keeps it. Times are in UTC.
#[derive(clap::Args)]
pub struct ChatArgs {
    #[command(flatten)]
    records: RecordFlags,
}

/// Prints what moderators and operators did lately: roles, bans, invitations.
///
/// Times are in UTC.
#[derive(clap::Args)]
pub struct AuditArgs {
    #[command(flatten)]
    records: RecordFlags,
}

#[derive(clap::Args)]
struct RecordFlags {
    /// How many lines are printed, the last ones.
    #[arg(long, value_name = "N", default_value_t = 100)]
    lines: u32,
    #[command(flatten)]
    data: DataFlag,
}

/// Runs `owner`.
pub fn make_owner(args: &OwnerArgs) -> anyhow::Result<()> {
    act(&args.data, Act::SetRole(args.key, Role::Owner))?;
    output::print(&format!("{} is an owner\n", args.key))
}

/// Runs `allow`.
pub fn allow(args: &AllowArgs) -> anyhow::Result<()> {
    act(&args.data, Act::Allow(args.key))?;
    output::print(&format!("{} is let in\n", args.key))
}

/// Runs `invite`.
pub fn invite(args: &InviteArgs) -> anyhow::Result<()> {
    let invitation = new_invitation()?;
    act(&args.data, Act::Invite(hash(&invitation), args.uses))?;
    output::print(&format!("{invitation}\n"))
}

/// Runs `chat`.
pub fn chat(args: &ChatArgs) -> anyhow::Result<()> {
    let records = args.records.data.open()?.chat(args.records.lines)?;
    let lines = records
        .into_iter()
        .map(|ChatRecord { at, key, name, text }| format!("{at}  {key}  {name}: {text}"));
    print(lines)
}

/// Runs `audit`.
pub fn audit(args: &AuditArgs) -> anyhow::Result<()> {
    let records = args.records.data.open()?.audit(args.records.lines)?;
    let lines = records.into_iter().map(|AuditRecord { at, author, act, subject, reason }| {
        format!("{at}  {author}  {act} {subject} {reason}").trim_end().to_owned()
    });
    print(lines)
}

/// Prints lines.
fn print(lines: impl Iterator<Item = String>) -> anyhow::Result<()> {
    let shown = |line: String| super::printable(&line) + "\n";
    output::print(&lines.map(shown).collect::<String>())
}

impl DataFlag {
    fn open(&self) -> anyhow::Result<Database> {
        let folder = self.data.clone().map_or_else(data_folder, Ok)?;
        Ok(Database::open(&folder)?)
    }
}

fn act(data: &DataFlag, act: Act) -> anyhow::Result<()> {
    Ok(data.open()?.act(OPERATOR, act, "")?)
}
