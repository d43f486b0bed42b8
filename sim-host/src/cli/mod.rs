//! The `sim-host` command line.
//!
//! Exit status 0 when the run went well, 2 for what the user must change, 1
//! for anything else.

mod run;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Plays the leg to a controller.
#[derive(Debug, Parser)]
#[command(name = "sim-host", version, about)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Play a scenario to a controller, in lock-step.
    Run(Box<run::Args>),
    /// Be the controller: as the `controller` program.
    Controller(controller::host::cli::Args),
}

/// Why a command failed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The call, or a file that it names, must be changed.
    Misuse(anyhow::Error),
    /// It went wrong.
    Failed(anyhow::Error),
}

impl Failure {
    fn misuse(error: impl Into<anyhow::Error>) -> Self {
        Self::Misuse(error.into())
    }

    fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }
}

/// Runs the program; gives its exit status.
#[must_use]
pub fn main() -> ExitCode {
    let outcome = match Program::parse().command {
        Command::Run(args) => run::main(*args),
        Command::Controller(args) => return controller::host::cli::main(&args),
    };
    match outcome {
        Ok(status) => status,
        Err(Failure::Misuse(error)) => {
            eprintln!("sim-host: {error:#}");
            ExitCode::from(2)
        }
        Err(Failure::Failed(error)) => {
            eprintln!("sim-host: {error:#}");
            ExitCode::from(1)
        }
    }
}
