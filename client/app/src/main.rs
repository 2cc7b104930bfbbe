//! `sightline-client`: walk in a building, draw pictures of it, simulate visitors, measure drawing.

mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sightline_cli::exit;

/// The thin client: walks in a shared building, and draws it on the CPU.
#[derive(Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

/// The name of the program in its errors.
const PROGRAM: &str = "sightline-client";

#[derive(Subcommand)]
enum Command {
    Bench(cli::bench::Args),
    Shot(cli::shot::Args),
    Swarm(cli::swarm::Args),
    #[cfg(feature = "desktop")]
    Walk(cli::walk::Args),
}

fn main() -> ExitCode {
    let outcome = match exit::arguments::<Args>(PROGRAM).command {
        Command::Bench(args) => cli::bench::run(&args),
        Command::Shot(args) => cli::shot::run(&args),
        Command::Swarm(args) => cli::swarm::run(&args),
        #[cfg(feature = "desktop")]
        Command::Walk(args) => cli::walk::run(&args),
    };
    exit::code(PROGRAM, outcome)
}
