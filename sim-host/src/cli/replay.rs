//! `sim-host replay`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_process::policy_file::PolicyFile;
use leg_process::stdout;

use super::misuse;
use crate::replay;

/// Feeds the samples of a recording to a controller and compares its commands
/// with the recorded ones, bit for bit. Exit status 0 when they are the same,
/// 1 when they are not.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// What `sim-host run --record` wrote.
    recording: PathBuf,
    /// Let this policy answer, instead of the recorded one, and show where the
    /// two part.
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let other = args.policy.as_deref().map(PolicyFile::read).transpose().map_err(misuse)?;
    let report = replay::replay(&args.recording, other.as_ref()).map_err(misuse)?;
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
