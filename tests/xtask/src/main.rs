//! The repository's own commands; `cargo xtask --help` lists them.

mod budget;
mod chaos;
mod ci;
mod examples;
mod flash;
mod hil;
mod image;
mod programs;
mod setup;
mod soak;
mod step;

use clap::{Parser, Subcommand};
use std::fmt;
use std::process::ExitCode;

/// The repository's own commands.
#[derive(Parser)]
#[command(name = "cargo xtask", disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Install what is missing, then format, lints, tests, docs, targets and the main job.
    Ci,
    /// Count instructions of the firmware in the emulator and compare them with the budgets.
    Budget(budget::Args),
    /// Kill and stop real processes in real time, and see the others stand.
    Chaos(chaos::Args),
    /// Install what is missing, or say what to install.
    Setup,
    /// Flash a real board by probe-rs.
    Flash(flash::Args),
    /// Hardware in the loop: the shore, played to a flashed controller.
    Hil(hil::Args),
    /// Check that no image of the firmware has a way to panic.
    Image,
    /// The tests of the flashed controller, long.
    Soak(soak::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Ci => ci::run(),
        Command::Budget(args) => budget::run(&args),
        Command::Chaos(args) => chaos::run(&args),
        Command::Setup => setup::run(),
        Command::Flash(args) => flash::run(&args),
        Command::Hil(args) => hil::run(&args),
        Command::Image => image::run(),
        Command::Soak(args) => soak::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(if error.is::<Misuse>() { 2 } else { 1 })
        }
    }
}

/// An error that the caller can put right: exit status 2.
#[derive(Debug)]
struct Misuse(String);

impl Misuse {
    fn of(what: String) -> anyhow::Error {
        Self(what).into()
    }
}

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}
