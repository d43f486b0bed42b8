//! `sim-host estimation`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueEnum;
use leg_process::stdout;

use super::{checked_policy, misuse};
use crate::estimation::{CASES, Case, Size, study};
use crate::robustness::Media;

const MOST_RUNS: u64 = 100_000;

/// What the control law takes for the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum State {
    /// An estimate from the readings; their noise is not stated.
    Estimate,
    /// The readings themselves.
    Readings,
}

/// Plays a policy with noisy, late and lost readings, with the state estimator or without,
/// from seeded starts in each medium. Prints the share of runs that still hop, and how good
/// the estimate is.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Policy file [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Cases, separated by commas [default: all].
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    case: Vec<String>,
    /// What the control law takes for the state.
    #[arg(long, value_name = "SOURCE", default_value = "estimate")]
    state: State,
    /// Runs of each case, each from another start.
    #[arg(long, value_name = "N", default_value_t = 20, allow_negative_numbers = true)]
    runs: u64,
    /// Threads [default: one per core]; the result is the same for any number.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    jobs: Option<usize>,
    /// Media in which the leg hops.
    #[arg(long, value_name = "MEDIA", value_delimiter = ',', default_value = "water,shore,land")]
    media: Vec<Media>,
    /// List the cases and end.
    #[arg(long)]
    list: bool,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    if args.list {
        for case in &CASES {
            stdout::print_line(format_args!("{:<14} {}", case.name, case.about))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    if !(1..=MOST_RUNS).contains(&args.runs) {
        return Err(misuse(format!("--runs is {}; it must be from 1 to {MOST_RUNS}", args.runs)));
    }
    let jobs = args.jobs.unwrap_or(0);
    if args.jobs.is_some_and(|jobs| !(1..=1024).contains(&jobs)) {
        return Err(misuse(format!("--jobs is {jobs}; it must be from 1 to 1024")));
    }
    let mut media = args.media.clone();
    let mut seen = Vec::new();
    media.retain(|one| {
        !seen.contains(one) && {
            seen.push(*one);
            true
        }
    });
    let cases = cases(&args.case)?;
    let estimates = args.state == State::Estimate;
    let blob = checked_policy(args.policy.as_deref())?;
    let policy = blob.policy().map_err(misuse)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build()?;
    let size = Size { runs: args.runs, media, estimates };
    let report = pool.install(|| study(&policy, &cases, &size))?;
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(&report)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns the cases of these names, or all.
fn cases(names: &[String]) -> anyhow::Result<Vec<Case>> {
    if names.is_empty() {
        return Ok(CASES.to_vec());
    }
    let find = |name: &String| {
        Case::named(name).copied().ok_or_else(|| {
            let all = CASES.map(|case| case.name).join(", ");
            misuse(format!("--case {name}: there is no such case; the cases are {all}"))
        })
    };
    names.iter().map(find).collect()
}
