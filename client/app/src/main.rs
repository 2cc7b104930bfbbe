//! `sightline-client`: bench, shot, swarm, walk.

mod cli;

use std::{io::Write, process::ExitCode};

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
    Bench(cli::bench::Args),
    Shot(cli::shot::Args),
    Swarm(cli::swarm::Args),
    #[cfg(feature = "desktop")]
    Walk(cli::walk::Args),
}

fn main() -> ExitCode {
    let outcome = match Args::parse().command {
        Command::Bench(args) => cli::bench::run(&args),
        Command::Shot(args) => cli::shot::run(&args),
        Command::Swarm(args) => cli::swarm::run(&args),
        #[cfg(feature = "desktop")]
        Command::Walk(args) => cli::walk::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where nobody reads it, there is nobody to tell that either.
            let _ = writeln!(std::io::stderr(), "sightline-client: {}", cli::one_line(&error));
            ExitCode::FAILURE
        }
    }
}
