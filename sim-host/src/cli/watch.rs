//! `sim-host watch`.

use std::process::ExitCode;

use leg_host::discovery::DEFAULT_DOMAIN;

use super::misuse;
use crate::watch::{self, WatchError};

/// Shows a running leg in this terminal, live: how it hops, its velocity at
/// each apex, the density, what the loop counts. Who watches disturbs nothing;
/// leg and controller may come and go.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The domain in which they meet.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_DOMAIN)]
    domain: String,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    match watch::run(&args.domain) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error @ (WatchError::Connect(_) | WatchError::NoTerminal)) => Err(misuse(error)),
        Err(error) => Err(error.into()),
    }
}
