//! `sightline-client`: walk, shot, swarm.

mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Walks in a shared building, drawn on the CPU.
#[derive(Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Shot(cli::shot::Args),
    Swarm(cli::swarm::Args),
    #[cfg(feature = "desktop")]
    Walk(cli::walk::Args),
}

fn main() -> ExitCode {
    let outcome = match Args::parse().command {
        Command::Shot(args) => cli::shot::run(&args),
        Command::Swarm(args) => cli::swarm::run(&args),
        #[cfg(feature = "desktop")]
        Command::Walk(args) => cli::walk::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sightline-client: {}", cli::one_line(&error));
            ExitCode::FAILURE
        }
    }
}
