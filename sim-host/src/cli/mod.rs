//! The `sim-host` command line: one file a subcommand.
//!
//! Exit status: 0 when all went well; 2 for what the caller can put right, a
//! wrong option or bad input (`Misuse`, and whatever clap refuses); 1 for any
//! other failure, a leg that falls among them.

mod apex;
mod bench;
mod bridge;
mod faults;
mod hint;
mod plot;
mod real_time;
mod recording;
mod replay;
mod robustness;
mod run;
mod shore;
mod watch;

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use leg_process::policy_file::PolicyFile;

/// Plays the leg to a controller. Without a command: the shore, the leg's way
/// out of the sea onto land.
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
    /// Play a scenario to a controller, in lock-step or in real time.
    Run(Box<run::Args>),
    /// Be the controller: as the `controller` program.
    Controller(leg_host::cli::Call),
    /// Be the controller by way of a flashed one, on a serial line.
    Bridge(Box<bridge::Args>),
    /// Watch a running leg in the terminal, and operate it.
    Watch(watch::Args),
    /// Replay a recording: are the commands those of its controller, bit for bit?
    Replay(replay::Args),
    /// Draw a recording as an SVG picture.
    Plot(plot::Args),
    /// Write a recording: what `run --record` starts.
    #[command(hide = true)]
    Recorder {
        /// The file.
        path: PathBuf,
    },
    /// Sweep: how much of each fault a policy stands.
    Robustness(robustness::Args),
    /// List the faults that `run --fault` can put into a run.
    Faults,
    /// Measure what a tick costs on this machine.
    Bench {
        /// What.
        #[command(subcommand)]
        what: bench::Bench,
    },
    /// Take hops: from one apex to the next, for each row of a CSV file.
    Apex(apex::Args),
}

/// Runs the program; gives its exit status.
#[must_use]
pub fn main() -> ExitCode {
    let outcome = if faults::asked_for() { faults::main() } else { play(&Program::parse()) };
    outcome.unwrap_or_else(|error| {
        eprintln!("sim-host: {}", hint::with_hint(&error));
        ExitCode::from(if error.is::<Misuse>() { 2 } else { 1 })
    })
}

fn play(program: &Program) -> anyhow::Result<ExitCode> {
    match &program.command {
        None => shore::main(&program.shore),
        Some(Command::Run(args)) => run::main(args),
        Some(Command::Bridge(args)) => bridge::main(args),
        Some(Command::Watch(args)) => watch::main(args),
        Some(Command::Replay(args)) => replay::main(args),
        Some(Command::Robustness(args)) => robustness::main(args),
        Some(Command::Faults) => faults::main(),
        Some(Command::Plot(args)) => plot::main(args),
        Some(Command::Recorder { path }) => Ok(crate::record::writer_process(path)),
        Some(Command::Apex(args)) => apex::main(args),
        Some(Command::Bench { what }) => bench::main(what),
        Some(Command::Controller(args)) => Ok(leg_host::cli::main(args)),
    }
}

/// An error that the caller can put right: exit status 2.
#[derive(Debug)]
struct Misuse(String);

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}

/// What is said as an error that the caller can put right.
fn misuse(error: impl fmt::Display) -> anyhow::Error {
    Misuse(error.to_string()).into()
}

/// The policy to run, checked. A controller process checks it too; first here,
/// so that what is wrong with it is said once, by the program that was called.
fn checked_policy(path: Option<&Path>) -> anyhow::Result<PolicyFile> {
    let blob = PolicyFile::load(path).map_err(misuse)?;
    blob.policy().map_err(misuse)?;
    Ok(blob)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    /// What clap checks only in debug builds, and only of the command called.
    #[test]
    fn the_command_line_is_of_one_piece() {
        super::Program::command().debug_assert();
    }
}
