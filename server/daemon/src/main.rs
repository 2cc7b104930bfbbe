//! `sightline-server`: compile, inspect, demo-building, serve, replay.

mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sightline_cli::exit;

/// Compiles buildings into worlds, decides who can see whom, and serves them.
#[derive(Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Compile(cli::compile::Args),
    DemoBuilding(cli::demo_building::Args),
    Inspect(cli::inspect::Args),
    Replay(cli::replay::Args),
    Serve(cli::serve::Args),
}

fn main() -> ExitCode {
    let outcome = match Args::parse().command {
        Command::Compile(args) => cli::compile::run(&args),
        Command::DemoBuilding(args) => cli::demo_building::run(&args),
        Command::Inspect(args) => cli::inspect::run(&args),
        Command::Replay(args) => cli::replay::run(&args),
        Command::Serve(args) => cli::serve::run(&args),
    };
    exit::code("sightline-server", outcome)
}
