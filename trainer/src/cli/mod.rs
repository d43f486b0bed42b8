//! The command line. The exit status is 0, 1 after a failure, and 2 when the input cannot be
//! used.

mod bench;
mod columns;
mod compare;
mod config;
mod eval;
mod export;
mod import;
mod infer;
mod inspect;
mod output;
mod plot;
mod stoppable;
mod study;
mod train;

use clap::{Parser, Subcommand, ValueEnum};
use leg_process::stderr;
use std::process::ExitCode;

use leg_simd::Isa;
use output::pool;

#[derive(Debug, Parser)]
#[command(name = "trainer", version, about = "Trains, evaluates and converts the leg's policies")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a policy; the same seed gives the same file, bit for bit
    Train(train::Arguments),
    /// Show and check configurations
    Config(config::Arguments),
    /// Train and evaluate many seeds, on one machine or a cluster
    Study(study::Arguments),
    /// Evaluate a policy: survival, stopping, tracking, highest speed
    Eval(eval::Arguments),
    /// Compare two policies from the same starts, with confidence intervals
    Compare(compare::Arguments),
    /// Print everything that a policy file states
    Inspect(inspect::Arguments),
    /// Compute the actions for observations in a CSV file
    Infer(infer::Arguments),
    /// Convert an actor trained elsewhere (safetensors, ONNX, JSON) to a policy file
    Import(import::Arguments),
    /// Draw learning curves from the logs of trainings, as SVG
    Plot(plot::Arguments),
    /// Write a policy's actor as safetensors, ONNX or C
    Export(export::Arguments),
    /// Measure the speed of training
    Bench(bench::Arguments),
}

/// The reason why a command fails.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The input cannot be used: exit status 2.
    Input(anyhow::Error),
    /// The command failed: exit status 1.
    Run(anyhow::Error),
}

/// Makes a failure of input that cannot be used.
pub(crate) fn input(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Input(error.into())
}

/// Makes a failure of the command.
pub(crate) fn failed(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Run(error.into())
}

/// An instruction set, as an option.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum IsaArgument {
    /// The best one of this CPU
    Best,
    /// The baseline of this architecture
    Baseline,
    Avx2,
    Avx512,
}

impl IsaArgument {
    fn isa(self) -> Result<Isa, Failure> {
        let isa = match self {
            Self::Best => Isa::best(),
            Self::Baseline => Isa::Baseline,
            Self::Avx2 => Isa::Avx2,
            Self::Avx512 => Isa::Avx512,
        };
        if isa.available() {
            Ok(isa)
        } else {
            Err(input(anyhow::anyhow!("--isa: this CPU does not have {}; use best", isa.name())))
        }
    }
}

/// Runs the command line of this process and returns its exit status.
#[must_use]
pub fn main() -> ExitCode {
    leg_process::signals::report_size_limit();
    let (error, status) = match run(&Cli::parse().command) {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Input(error)) => (error, 2),
        Err(Failure::Run(error)) => (error, 1),
    };
    // A reader that has closed the pipe, such as `head`, is not a failure.
    let broken_pipe = error
        .downcast_ref::<std::io::Error>()
        .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe);
    if broken_pipe {
        return ExitCode::SUCCESS;
    }
    stderr::print_line(format_args!("trainer: {}", leg_process::chain(error.as_ref())));
    ExitCode::from(status)
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Train(arguments) => train::run(arguments),
        Command::Config(arguments) => config::run(arguments),
        Command::Study(arguments) => study::run(arguments),
        Command::Eval(arguments) => pool()?.install(|| eval::run(arguments)),
        Command::Compare(arguments) => pool()?.install(|| compare::run(arguments)),
        Command::Inspect(arguments) => inspect::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
        Command::Import(arguments) => pool()?.install(|| import::run(arguments)),
        Command::Plot(arguments) => plot::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Bench(arguments) => pool()?.install(|| bench::run(arguments)),
    }
}
