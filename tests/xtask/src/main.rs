//! The repository's own commands; `cargo xtask --help` lists them.

mod budget;
mod chaos;
mod ci;
mod examples;
mod flash;
mod hil;
mod image;
mod lanes;
mod programs;
mod python;
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
    /// Run every check, after installing what is missing.
    Ci,
    /// Measure instructions, flash, RAM and stack of the firmware against the budgets.
    Budget(budget::Args),
    /// Kill and stop real processes in real time, and check that their peers recover.
    Chaos(chaos::Args),
    /// Install what the checks need, or print what to install.
    Setup,
    /// Flash a real board with probe-rs.
    Flash(flash::Args),
    /// Run the shore with the firmware as the controller (hardware in the loop).
    Hil(hil::Args),
    /// Check that no firmware image can panic.
    Image,
    /// Build the Python package, install it into an environment of its own, and test it.
    Python(python::Args),
    /// Run the tests of the firmware over many ticks.
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
        Command::Python(args) => python::run(&args),
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

/// A wrong call or bad input: exit status 2.
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
