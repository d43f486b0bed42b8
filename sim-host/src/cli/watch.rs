//! `sim-host watch`.

use std::process::ExitCode;

use leg_host::discovery::DEFAULT_DOMAIN;

use super::misuse;
use crate::watch::{self, WatchError};

/// Shows a running leg live in this terminal: its motion, its velocity at each
/// apex, the density and the loop's counts. Watching does not change the run; leg
/// and controller may start and stop meanwhile.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The domain of leg and controller.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_DOMAIN)]
    domain: String,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    match watch::run(&args.domain) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(WatchError::NoTerminal) => Err(misuse(format!(
            "{}; `sim-host run --record FILE` and `sim-host plot` need none",
            WatchError::NoTerminal
        ))),
        Err(error @ (WatchError::Connect(_) | WatchError::PlainTerminal(_))) => Err(misuse(error)),
        Err(error) => Err(error.into()),
    }
}
