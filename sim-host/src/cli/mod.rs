//! The `sim-host` command line: one file a subcommand.
//!
//! Exit status: 0 for success; 2 for errors that the caller can correct, such as
//! a wrong option or bad input (`Misuse`, and the errors of clap); 1 for any other
//! failure, including a fall of the leg.

mod apex;
mod bench;
mod bridge;
mod estimation;
mod export;
mod faults;
mod hint;
mod plot;
mod record;
mod recording;
mod recover;
mod replay;
mod robustness;
mod run;
mod sensors;
mod shore;
mod study;
mod watch;

use leg_process::{remedy, stderr};
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use leg_process::policy_file::PolicyFile;

/// Simulates the leg for a controller. Without a command it runs the demonstration:
/// from water over the shore onto land.
#[derive(Debug, Parser)]
#[command(name = "sim-host", version, about, args_conflicts_with_subcommands = true)]
struct Program {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    shore: shore::Args,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Play a scenario with a controller, in lock-step or in real time.
    Run(Box<run::Args>),
    /// Run the controller, like the `controller` program.
    Controller(Box<leg_host::cli::Call>),
    /// Connect a flashed controller on a serial line as the controller.
    Bridge(Box<bridge::Args>),
    /// Watch a running leg in the terminal, and operate it.
    Watch(watch::Args),
    /// Record a run of any leg and any controller, as an observer.
    Record(record::Args),
    /// Replay a recording and compare the commands bit for bit.
    Replay(replay::Args),
    /// Plot a recording as SVG.
    Plot(plot::Args),
    /// Write a recording as CSV, a log for `controller estimate`.
    Export(export::Args),
    /// Make a complete recording of what a killed recorder has left.
    Recover(recover::Args),
    /// Write a recording; `run --record` starts this.
    #[command(hide = true)]
    Recorder {
        /// The file.
        path: PathBuf,
    },
    /// Measure how much of each fault a policy tolerates.
    Robustness(robustness::Args),
    /// Measure what the state estimator makes of noisy, late and lost readings.
    Estimation(estimation::Args),
    /// List the faults for `run --fault`.
    Faults,
    /// List the sensors for `run --sensors`: profiles, figures, ranges and sources.
    Sensors(sensors::Args),
    /// Measure the time of a tick on this machine.
    Bench {
        /// The benchmark.
        #[command(subcommand)]
        what: bench::Bench,
    },
    /// Compute the next apex for each row of a CSV file.
    Apex(apex::Args),
}

/// Runs the program and returns its exit status.
#[must_use]
pub fn main() -> ExitCode {
    leg_process::signals::report_size_limit();
    let outcome =
        if faults::is_requested() { faults::main() } else { run_command(&Program::parse()) };
    outcome.unwrap_or_else(|error| {
        stderr::print_line(format_args!("sim-host: {}", hint::with_hint(&error)));
        ExitCode::from(if error.is::<Misuse>() { 2 } else { 1 })
    })
}

fn run_command(program: &Program) -> anyhow::Result<ExitCode> {
    match &program.command {
        None => shore::main(&program.shore),
        Some(Command::Run(args)) => run::main(args),
        Some(Command::Bridge(args)) => bridge::main(args),
        Some(Command::Watch(args)) => watch::main(args),
        Some(Command::Record(args)) => record::main(args),
        Some(Command::Replay(args)) => replay::main(args),
        Some(Command::Robustness(args)) => robustness::main(args),
        Some(Command::Estimation(args)) => estimation::main(args),
        Some(Command::Faults) => faults::main(),
        Some(Command::Sensors(args)) => sensors::main(args),
        Some(Command::Plot(args)) => plot::main(args),
        Some(Command::Export(args)) => export::main(args),
        Some(Command::Recover(args)) => recover::main(args),
        Some(Command::Recorder { path }) => Ok(crate::record::writer_process(path)),
        Some(Command::Apex(args)) => apex::main(args),
        Some(Command::Bench { what }) => bench::main(what),
        Some(Command::Controller(args)) => Ok(leg_host::cli::main(args)),
    }
}

/// An error that the caller can correct: exit status 2.
#[derive(Debug)]
struct Misuse(String);

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}

/// Marks an error as one that the caller can correct.
fn misuse(error: impl fmt::Display) -> anyhow::Error {
    Misuse(error.to_string()).into()
}

/// Returns the error of an output that cannot be written: misuse if its path cannot be that of a
/// file.
fn unwritable(error: std::io::Error, message: String) -> anyhow::Error {
    if remedy::is_wrong_path(&error) {
        misuse(format!("{message}: {error}"))
    } else {
        anyhow::Error::new(error).context(message)
    }
}

/// Loads and checks a policy file. A controller process checks it too; checking it
/// here first reports an error once, by the program that the user called.
fn checked_policy(path: Option<&Path>) -> anyhow::Result<PolicyFile> {
    let blob = PolicyFile::load(path).map_err(misuse)?;
    blob.policy().map_err(misuse)?;
    Ok(blob)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    /// Clap checks this in debug builds only, and only for the command called.
    #[test]
    fn the_command_line_definition_is_consistent() {
        super::Program::command().debug_assert();
    }
}
