//! `sim-host bridge`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_host::cli::Meeting;
use leg_host::discovery::DomainError;
use leg_host::serial::stream::EndpointArgs;
use leg_host::serial::{ByteStream, Noisy, OpenError};
use leg_host::shm::ConnectError;
use leg_host::socket::SocketError;
use leg_process::stdout;
use leg_process::{Stop, remedy, stderr};

use leg_control::serial::message::{Mode, SessionParams};
use leg_host::law::{LawError, LawSettings};

use super::misuse;
use crate::bridge::{self, BridgeError, Connector, OnUnplug, Options, RunParams};

/// Be the controller by way of a flashed one: pass the simulator's samples to a
/// serial line, and the commands back.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    endpoint: EndpointArgs,
    /// Ticks a second; the simulator's must be the same.
    #[arg(long, value_name = "HZ", default_value_t = 1000, allow_negative_numbers = true)]
    rate: u32,
    /// Gravity where the leg is, m/s2; the simulator's must be the same.
    #[arg(long, value_name = "M_S2", default_value_t = 9.81, allow_negative_numbers = true)]
    gravity: f32,
    #[command(flatten)]
    law: LawSettings,
    #[command(flatten)]
    meeting: Meeting,
    /// What starts the controller's ticks.
    #[arg(long, value_enum, default_value_t)]
    mode: ModeArg,
    /// When the line breaks: open it again and continue, or end with an error.
    #[arg(long, value_enum, default_value_t, value_name = "WHAT")]
    on_unplug: OnUnplug,
    /// Take requests of other programs on this unix socket, too, as on that of the domain:
    /// `controller policy upload --unix PATH …`.
    #[arg(long, value_name = "PATH")]
    share: Option<PathBuf>,
    /// Fault injection: damage this fraction of the bytes, both ways.
    #[arg(long, value_name = "FRACTION", value_parser = parse_fraction, allow_negative_numbers = true)]
    noise: Option<f64>,
    /// Which bytes --noise damages.
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "noise")]
    noise_seed: u64,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum ModeArg {
    /// Each sample, so that simulated time waits for its command. The simulator runs without
    /// --real-time.
    #[default]
    LockStep,
    /// The board's own timer, in real time: each tick uses the newest sample. The simulator runs
    /// with --real-time; without, it waits for the timer.
    Live,
}

fn parse_fraction(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fraction) if (0.0..=0.5).contains(&fraction) => Ok(fraction),
        _ => Err("it must be a number from 0 to 0.5".into()),
    }
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let of_law = |error: LawError| {
        misuse(format!("{}: {error}", leg_host::cli::hint::law_option(error.key)))
    };
    let law = SessionParams {
        rate_hz: args.rate,
        gravity_m_s2: args.gravity,
        // At most a second.
        stale_limit_ns: args.law.stale_limit_ns().map_err(of_law)? as u32,
        estimator: args.law.estimator().map_err(of_law)?.unwrap_or_default(),
    };
    law.config().map_err(misuse)?;
    let options = Options {
        params: RunParams {
            law,
            mode: match args.mode {
                ModeArg::LockStep => Mode::LockStep,
                ModeArg::Live => Mode::Live,
            },
        },
        domain: args.meeting.domain().to_owned(),
        timeout: args.meeting.timeout(),
        on_unplug: args.on_unplug,
        share: args.share.clone(),
    };
    let stop = Stop::on_signals()?;
    let on_notice =
        |notice: &bridge::Notice| stderr::print_line(format_args!("sim-host: {notice}"));
    let report =
        bridge::run(&options, connect(args), Box::new(on_notice), &stop).map_err(|error| {
            match &error {
                BridgeError::Connect(ConnectError::Domain(DomainError::Name(_))) => misuse(error),
                BridgeError::RequestMux(SocketError::Io { cause, .. })
                    if remedy::is_wrong_path(cause) =>
                {
                    misuse(error)
                }
                _ => error.into(),
            }
        })?;
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(report)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Opens the line, each time with other noise if there is to be any.
fn connect(args: &Args) -> Connector {
    let (endpoint, noise, mut seed) = (args.endpoint.endpoint(), args.noise, args.noise_seed);
    Box::new(move || -> Result<Box<dyn ByteStream>, OpenError> {
        let stream = endpoint.open()?;
        let Some(share) = noise else { return Ok(stream) };
        seed = seed.wrapping_add(1);
        Ok(Box::new(Noisy::new(stream, share, seed)))
    })
}
