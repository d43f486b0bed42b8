//! The `controller` process.

use std::process::ExitCode;

use clap::Parser;
use controller::host::cli;

/// Runs a policy on a leg over shared memory.
#[derive(Parser)]
#[command(name = "controller", version, about)]
struct Program {
    #[command(flatten)]
    args: cli::Args,
}

fn main() -> ExitCode {
    cli::main(&Program::parse().args)
}
