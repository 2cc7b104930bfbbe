//! The program `sightline-server`. Its commands are the modules of [`cli`].

mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sightline_cli::exit;

/// Compiles buildings into worlds, serves them to clients, and replays recorded walks.
///
/// To begin: `sightline-server serve` serves a demo building; `sightline-client walk` enters it.
#[derive(Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

/// The name of the program in its errors.
const PROGRAM: &str = "sightline-server";

#[derive(Subcommand)]
enum Command {
    Allow(cli::people::AllowArgs),
    Audit(cli::people::AuditArgs),
    Chat(cli::people::ChatArgs),
    Compile(cli::compile::CompileArgs),
    LightCheck(cli::light_check::LightCheckArgs),
    DemoBuilding(cli::demo_building::DemoBuildingArgs),
    Inspect(cli::inspect::InspectArgs),
    Invite(cli::people::InviteArgs),
    Owner(cli::people::OwnerArgs),
    Replay(cli::replay::ReplayArgs),
    Serve(Box<cli::serve::ServeArgs>),
    #[cfg(feature = "http")]
    Status(cli::status::StatusArgs),
}

fn main() -> ExitCode {
    let outcome = match exit::arguments::<Args>(PROGRAM).command {
        Command::Allow(args) => cli::people::allow(&args),
        Command::Audit(args) => cli::people::audit(&args),
        Command::Chat(args) => cli::people::chat(&args),
        Command::Compile(args) => cli::compile::run(&args),
        Command::LightCheck(args) => cli::light_check::run(&args),
        Command::DemoBuilding(args) => cli::demo_building::run(&args),
        Command::Inspect(args) => cli::inspect::run(&args),
        Command::Invite(args) => cli::people::invite(&args),
        Command::Owner(args) => cli::people::make_owner(&args),
        Command::Replay(args) => cli::replay::run(&args),
        Command::Serve(args) => cli::serve::run(&args),
        #[cfg(feature = "http")]
        Command::Status(args) => cli::status::run(&args),
    };
    exit::code(PROGRAM, outcome)
}
