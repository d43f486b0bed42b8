//! `sim-host watch`.

use std::process::ExitCode;

use leg_host::discovery::DEFAULT_DOMAIN;
use leg_process::stdout;

use super::misuse;
use crate::watch::{self, ServeError, WatchError};

/// The port at which Foxglove looks for a server by itself.
const FOXGLOVE_PORT: &str = "8765";

/// Shows a running leg live in this terminal: its motion, its velocity at each
/// apex, the density and the loop's counts. Watching does not change the run; leg
/// and controller may start and stop meanwhile.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The domain of leg and controller.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_DOMAIN)]
    domain: String,
    /// Serve the leg to Foxglove over a WebSocket at this port, without a terminal; 0 takes a
    /// free one, which is printed [default: 8765].
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = FOXGLOVE_PORT)]
    foxglove: Option<u16>,
    /// Address at which it listens: who can reach it can operate the leg.
    #[arg(long, value_name = "HOST", requires = "foxglove", default_value = "127.0.0.1")]
    foxglove_host: String,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(port) = args.foxglove {
        return serve(&args.domain, &args.foxglove_host, port);
    }
    match watch::run(&args.domain) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(WatchError::NoTerminal) => Err(misuse(format!(
            "{}; `--foxglove`, `sim-host run --record FILE` and `sim-host plot` need none",
            WatchError::NoTerminal
        ))),
        Err(error @ (WatchError::Connect(_) | WatchError::PlainTerminal(_))) => Err(misuse(error)),
        Err(error) => Err(error.into()),
    }
}

fn serve(domain: &str, host: &str, port: u16) -> anyhow::Result<ExitCode> {
    let started = |port| -> anyhow::Result<()> {
        let host = if host.contains(':') { format!("[{host}]") } else { host.to_owned() };
        Ok(stdout::print_line(format_args!("serving domain `{domain}` at ws://{host}:{port}"))?)
    };
    match watch::serve(domain, host, port, started) {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error) => Err(match error.downcast_ref() {
            Some(ServeError::Connect(cause)) => misuse(cause),
            Some(cause @ ServeError::InUse { .. }) => anyhow::anyhow!(
                "{cause}; --foxglove PORT names another one, and --foxglove 0 takes a free one"
            ),
            Some(cause @ ServeError::Bind { .. }) => anyhow::anyhow!(
                "{cause}; --foxglove-host names an address of this machine, and ports below 1024 \
                 need rights"
            ),
            _ => error,
        }),
    }
}
