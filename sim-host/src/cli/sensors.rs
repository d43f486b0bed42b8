//! `sim-host sensors`.

use std::process::ExitCode;

use leg_process::stdout;

use crate::sensors::{Listing, help};

/// Lists the profiles of sensors and their figures for `run --sensors` and `--sensor`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print the list as one JSON object.
    #[arg(long)]
    json: bool,
}

/// Prints all profiles and figures.
pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    if args.json {
        stdout::print_line(serde_json::to_string(&Listing::new())?)?;
    } else {
        stdout::print_line(help())?;
    }
    Ok(ExitCode::SUCCESS)
}
