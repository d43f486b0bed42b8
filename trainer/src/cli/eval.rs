//! `trainer eval`

use super::output::print;
use super::{Failure, input};
use crate::evaluate::report::Report;
use clap::Args;
use controller::host::blob::PolicyBlob;
use std::path::PathBuf;

/// Seed of the starts, unless another is asked for. Trainings draw theirs
/// otherwise: no policy has seen these.
pub(super) const SEED: u64 = 4_607_469;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The policy file
    #[arg(long)]
    policy: PathBuf,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// Random starts at each density
    #[arg(long, default_value_t = 5000, value_parser = clap::value_parser!(u32).range(1..))]
    starts: u32,
    /// Seed of the starts
    #[arg(long, default_value_t = SEED)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyBlob::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let report = Report::new(&policy, arguments.starts as usize, arguments.seed);
    if arguments.json { print(&report.to_json()) } else { print(&report.to_string()) }
}
