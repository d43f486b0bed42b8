//! `sim-host record`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_host::discovery::{DEFAULT_DOMAIN, DomainError};
use leg_process::{stderr, stdout};

use super::misuse;
use super::recording::DISPLAY_RATE_HZ;
use crate::scenario::{Scenario, Settings};
use crate::watch::{self, Assumed, ObserveError, ObserveOptions};

/// Records a run of any leg and any controller, as an observer: its samples and commands, the
/// apexes that the controller finds, and its policies. There is no true state, and what the
/// observer misses is counted. Start it before the leg: `controller` then waits until it
/// receives, so that it misses nothing. It ends with the run, or by a signal.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The domain of leg and controller.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_DOMAIN)]
    domain: String,
    /// Recording to write, a new file.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Pictures of the leg per second in the recording, for viewers such as Foxglove and Rerun; 0
    /// leaves out all that is for viewers.
    #[arg(long, value_name = "HZ", default_value_t = DISPLAY_RATE_HZ)]
    display_rate: u32,
    /// Ticks per second, of a controller without a status [default: 1000].
    #[arg(long, value_name = "HZ")]
    rate: Option<u32>,
    /// Gravity, of a controller without a status, m/s2 [default: 9.81].
    #[arg(long, value_name = "M_S2", allow_negative_numbers = true)]
    gravity: Option<f64>,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let assumed =
        Settings { rate_hz: args.rate, gravity_m_s2: args.gravity, ..Settings::default() };
    let assumed = Scenario::from_settings(&assumed).map_err(misuse)?;
    let assumed =
        Assumed { rate_hz: assumed.rate_hz, gravity_m_s2: assumed.controller_gravity_m_s2() };
    let options = ObserveOptions {
        domain: args.domain.clone(),
        file: args.out.clone(),
        display_rate_hz: args.display_rate,
        assumed,
    };
    let observed = watch::record(&options).map_err(|error| match error {
        ObserveError::Exists(_) => misuse(format!("{error}; --out FILE names another file")),
        ObserveError::Domain(cause @ DomainError::Name(_)) => misuse(cause),
        ObserveError::Domain(cause) => anyhow::Error::new(cause),
        ObserveError::Record(cause) => anyhow::Error::new(cause),
        error => error.into(),
    })?;
    stdout::print_line(format_args!(
        "{}: {} ticks, {} missed; {}",
        args.out.display(),
        observed.ticks,
        observed.missed,
        observed.ending
    ))?;
    if !observed.has_status {
        stderr::print_line(format_args!(
            "sim-host: note: the controller has no status, so rate ({} Hz, --rate) and gravity \
             ({} m/s2, --gravity) are assumed, and its policy is not in the recording: `sim-host \
             replay` needs --policy",
            assumed.rate_hz, assumed.gravity_m_s2
        ));
    }
    if observed.missed > 0 {
        stderr::print_line(format_args!(
            "sim-host: warning: {} ticks are missing from the recording: it began within the run, \
             the machine was too busy, or the leg did not send them",
            observed.missed
        ));
    }
    Ok(ExitCode::SUCCESS)
}
