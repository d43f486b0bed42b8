//! The subcommands, and what all of them share.
//!
//! Exit status: 0 when all went well; 2 for what the caller can put right, a wrong option or
//! bad input ([`Misuse`], and whatever clap refuses); 1 for any other failure.

mod apex;

use std::fmt;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Plays the spring-legged hopper.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Apex(apex::ApexArgs),
}

/// Runs the command line of this process.
pub(crate) fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Apex(args) => apex::run(&args),
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
pub(crate) struct Misuse(pub(crate) String);

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misuse {}
