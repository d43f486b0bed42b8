//! `trainer eval`

use super::output::print;
use super::{Failure, input};
use crate::evaluate::conditions::Extent;
use crate::evaluate::report::Report;
use clap::Args;
use leg_process::policy_file::PolicyFile;
use std::path::PathBuf;

/// Seed of the starts, unless another is asked for. Trainings draw theirs
/// otherwise: no policy has seen these.
pub(super) const SEED: u64 = 4_607_469;

/// Most starts at each density: a share is then known to within 0.0005.
pub(super) const MOST_STARTS: i64 = 1_000_000;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The policy file
    #[arg(long)]
    policy: PathBuf,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// Random starts at each density, from 1 to 1000000
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(1..=MOST_STARTS)
    )]
    starts: u32,
    /// Seed of the starts
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    /// Moon and mars at every density, not only on land
    #[arg(long)]
    full: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyFile::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let extent = if arguments.full { Extent::Full } else { Extent::Land };
    let report = Report::of(&policy, arguments.starts as usize, arguments.seed, extent);
    if arguments.json { print(&report.to_json()) } else { print(&report.to_string()) }
}
