//! `sim-host replay`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_process::policy_file::PolicyFile;
use leg_process::stdout;

use super::misuse;
use crate::replay::{self, ReplayError};

/// Feeds the samples of a recording to a controller and compares its commands
/// with the recorded ones bit for bit. Exit status 0 if they are equal, 1 if not.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Recording made by `sim-host run --record`.
    recording: PathBuf,
    /// Use this policy instead of the recorded one, and show where their commands
    /// differ.
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let other = args.policy.as_deref().map(PolicyFile::read).transpose().map_err(misuse)?;
    let report = replay::replay(&args.recording, other.as_ref()).map_err(with_hint)?;
    for warning in &report.warnings {
        eprintln!("sim-host: warning: {warning}");
    }
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(&report)?;
    }
    Ok(if report.equal { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn with_hint(error: ReplayError) -> anyhow::Error {
    match error {
        ReplayError::NoPolicy(_) => misuse(format!("{error}; name it by --policy FILE")),
        error => misuse(error),
    }
}
