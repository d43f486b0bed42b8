//! The command `trainer eval`.

use super::output::print;
use super::{Failure, input};
use crate::config::Randomisation;
use crate::evaluate::conditions::Extent;
use crate::evaluate::goals::assess;
use crate::evaluate::randomised;
use crate::evaluate::report::Report;
use clap::Args;
use leg_process::policy_file::PolicyFile;
use std::path::PathBuf;

/// Default seed of the starts. Trainings draw their starts from other streams, so no policy
/// was trained or selected on these.
pub(super) const SEED: u64 = 4_607_469;

/// Largest number of starts at each density ratio: the standard error of a share is then at
/// most 0.0005.
pub(super) const MOST_STARTS: i64 = 1_000_000;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Policy file to evaluate
    #[arg(long)]
    policy: PathBuf,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// Number of random starts at each density ratio, from 1 to 1000000
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(1..=MOST_STARTS)
    )]
    starts: u32,
    /// Seed of the random starts
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    /// Evaluate moon and mars at every density ratio, not only on land
    #[arg(long)]
    full: bool,
    /// Evaluate in randomised worlds, too: each quantity of the table [randomisation] of this TOML
    /// file alone, and all together. The file holds the table alone, or a configuration
    #[arg(long, value_name = "FILE")]
    randomisation: Option<PathBuf>,
}

/// Returns the tables of a report and how it compares with the goals.
pub(super) fn text(report: &Report) -> String {
    format!("{report}\n{}", assess(report))
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyFile::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let extent = if arguments.full { Extent::Full } else { Extent::Land };
    let randomisation = arguments.randomisation.as_deref().map(Randomisation::read).transpose();
    let randomisation = randomisation.map_err(input)?;
    let (starts, seed) = (arguments.starts as usize, arguments.seed);
    let mut report = Report::of(&policy, starts, seed, extent);
    if let Some(randomisation) = &randomisation {
        report.randomised = randomised::table(policy.actor(), randomisation, starts, seed);
    }
    if arguments.json { print(&report.to_json()) } else { print(&text(&report)) }
}
