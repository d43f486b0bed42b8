//! `sim-host replay`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_host::recorded::RecordedError;
use leg_process::policy_file::PolicyFile;
use leg_process::stdout;

use super::{hint, misuse};
use crate::replay::{self, ReplayError};

/// Feeds the samples of a recording to a controller and compares its commands, and its
/// estimates where they are recorded, with the recorded ones bit for bit. Exit status 0 if
/// all are equal, 1 if one differs or, for a part, it cannot be told: in real time a recording
/// does not show which samples the controller received. The result then names the gap, in JSON
/// as `not_compared`, and `equal` stays true.
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
    let report =
        replay::replay(&args.recording, other.as_ref()).map_err(|error| with_hint(&error))?;
    hint::print_warnings(&args.recording, &report.warnings, report.is_complete);
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(&report)?;
    }
    Ok(if report.is_the_same() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Adds the option that helps; the caller can correct every error of a replay.
fn with_hint(error: &ReplayError) -> anyhow::Error {
    let hint = match error {
        ReplayError::Law(RecordedError::NoPolicy(_)) => Some("--policy FILE names it".to_owned()),
        ReplayError::Read(cause) | ReplayError::Law(RecordedError::Read(cause)) => {
            hint::read_error(cause)
        }
        _ => None,
    };
    misuse(leg_host::cli::hint::with_hint(error, hint))
}
