//! The `controller` process.

use std::process::ExitCode;

use clap::Parser;
use leg_host::cli;

/// Runs a policy on a leg over shared memory; with a command, speaks to a
/// flashed controller.
#[derive(Parser)]
#[command(name = "controller", version, about)]
struct Program {
    #[command(flatten)]
    call: cli::Call,
}

fn main() -> ExitCode {
    cli::main(&Program::parse().call)
}
