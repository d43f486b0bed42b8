//! `sim-host estimation`.

use std::process::ExitCode;

use clap::ValueEnum;
use leg_process::stdout;

use super::misuse;
use super::study::{Study, StudyArgs};
use crate::estimation::{CASES, Case, Size, study};

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
    #[command(flatten)]
    study: StudyArgs,
    /// Cases, separated by commas [default: all].
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    case: Vec<String>,
    /// What the control law takes for the state.
    #[arg(long, value_name = "SOURCE", default_value = "estimate")]
    state: State,
    /// List the cases and end.
    #[arg(long)]
    list: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    if args.list {
        for case in &CASES {
            stdout::print_line(format_args!("{:<14} {}", case.name, case.about))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let cases = cases(&args.case)?;
    let estimates = args.state == State::Estimate;
    let Study { policy: blob, runs, media, pool } = args.study.study()?;
    let policy = blob.policy().map_err(misuse)?;
    let size = Size { runs, media, estimates };
    let report = pool.install(|| study(&policy, &cases, &size))?;
    if args.study.json {
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
