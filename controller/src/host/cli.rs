//! The `controller` command line.
//!
//! Exit status 0 when the run ended in good order, 2 for what the user must
//! change (a bad blob, a bad rate), 1 for anything else.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use super::bench::{self, BenchError};
use super::blob::{BlobError, PolicyBlob};
use super::domain::{DEFAULT_DOMAIN, Domain, DomainError};
use super::realtime::cli::RealTimeArgs;
use super::realtime::{self, Ends, LoopReport, Plain, Served, Shared};
use super::serial::commands;
use super::serve::{ServeError, serve};
use super::shm::{ConnectError, ShmController};
use super::{LinkError, Pace, Role, Stop, Terms};
use crate::control::{Config, ConfigError, Controller};
use crate::guard::Counts;
use crate::policy::Manifest;

/// Longest patience that `--timeout` accepts, s.
const MAX_TIMEOUT_S: f64 = 86_400.0;
/// A peer that is not there by then is worth a word.
pub const SAY_AFTER: Duration = Duration::from_secs(1);

/// What the program is called with: how to run, or a command to a flashed controller.
#[derive(Clone, Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Call {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    args: Args,
}

/// What else the program does.
#[derive(Clone, Debug, clap::Subcommand)]
enum Command {
    /// Measure the control law on this machine.
    Bench(bench::Args),
    #[command(flatten)]
    Flashed(commands::Command),
}

/// Runs a policy on a leg: a command for every sample, in lock-step.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The policy blob to run [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    pub policy: Option<PathBuf>,
    /// Ticks a second; the simulator's must be the same.
    #[arg(long, value_name = "HZ", default_value_t = 1000, allow_negative_numbers = true)]
    pub rate: u32,
    /// Gravity where the leg is, m/s2; the simulator's must be the same (the
    /// density estimate needs it).
    #[arg(long, value_name = "M_S2", default_value_t = 9.81, allow_negative_numbers = true)]
    pub gravity: f32,
    /// Where to find the simulator.
    #[command(flatten)]
    pub meeting: Meeting,
    /// How to tick by the clock.
    #[command(flatten)]
    pub real_time: RealTimeArgs,
    /// Print the figures of a loop in real time as one JSON object.
    #[arg(long, requires = "real_time")]
    pub json: bool,
}

/// Where two processes meet, and how long one waits for the other.
#[derive(Clone, Debug, clap::Args)]
pub struct Meeting {
    /// Only processes of the same domain see each other [default: default].
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// How long to wait for a missing or silent peer, s.
    #[arg(long, value_name = "S", default_value = "10", value_parser = parse_timeout, allow_negative_numbers = true)]
    pub timeout: Duration,
}

impl Meeting {
    /// The domain to meet in.
    #[must_use]
    pub fn domain(&self) -> &str {
        self.domain.as_deref().unwrap_or(DEFAULT_DOMAIN)
    }
}

/// Reads a waiting time in seconds.
///
/// # Errors
/// A message with the value and its limits.
pub fn parse_timeout(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s <= MAX_TIMEOUT_S => Ok(Duration::from_secs_f64(s)),
        _ => Err(format!("it must be a number of seconds, above 0 and at most {MAX_TIMEOUT_S}")),
    }
}

/// Why the controller did not run to the end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CliError {
    /// There is no policy to run.
    #[error(transparent)]
    Policy(#[from] BlobError),
    /// A rate or gravity out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A signal handler could not be set.
    #[error("cannot listen to signals: {0}")]
    Signals(io::Error),
    /// No simulator, or not a fitting one.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The run broke off.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// The loop in real time broke off.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing was measured.
    #[error(transparent)]
    Bench(#[from] BenchError),
}

impl CliError {
    /// Whether the user must change the call, not only call again.
    fn is_misuse(&self) -> bool {
        matches!(
            self,
            Self::Policy(_)
                | Self::Bench(BenchError::Policy(_))
                | Self::Config(_)
                | Self::Connect(ConnectError::Domain(DomainError::Name(_)))
        )
    }
}

impl From<DomainError> for CliError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Name of the policy.
    pub policy: String,
    /// Samples answered.
    pub ticks: u64,
    /// Apexes in the last epoch.
    pub apexes: u32,
    /// What the guard rejected in the last epoch.
    pub counts: Counts,
    /// The figures of the loop, in real time.
    pub real_time: Option<LoopReport>,
    /// What ended a loop in real time before its time, if anything did.
    pub ended: Result<(), LinkError>,
}

impl Summary {
    /// The figures, for a script: those of a [`LoopReport`] in `loop`, and the
    /// guard's in `rejected`.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "policy": self.policy,
            "ticks": self.ticks,
            "apexes": self.apexes,
            "rejected": self.counts.rejected(),
            "safe_entered": self.counts.safe_entered,
            "loop": self.real_time,
        })
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, ticks, apexes, counts, real_time, .. } = self;
        if let Some(report) = real_time {
            writeln!(f, "{report}")?;
        }
        write!(f, "policy {policy}: {ticks} ticks, {apexes} apexes, ")?;
        write!(f, "{} samples rejected", counts.rejected())?;
        for (kind, count) in counts.by_kind().into_iter().filter(|(_, count)| *count > 0) {
            write!(f, ", {count} {kind}")?;
        }
        match counts.safe_entered {
            0 => Ok(()),
            times => write!(f, "; safe state entered {times} times"),
        }
    }
}

/// What to warn of when a policy was trained for another leg than the one that
/// is `played`, by its [`fingerprint`](crate::leg::LegModel::fingerprint).
#[must_use]
pub fn other_leg(policy: &Manifest<'_>, played: Option<u32>) -> Option<String> {
    let Manifest { name, leg, .. } = policy;
    played.filter(|played| *played != leg.fingerprint()).map(|_| {
        format!(
            "warning: the policy {name} was trained for another leg ({} kg, {} N/m, {} m) than \
             the simulator plays; it runs all the same, --policy chooses another",
            leg.mass_kg, leg.stiffness_n_m, leg.rest_length_m
        )
    })
}

/// Runs the controller until the simulator's run is over.
///
/// # Errors
/// [`CliError`], with what to do about it.
pub fn run(args: &Args) -> Result<Summary, CliError> {
    let config = Config::at_rate(args.rate)?.with_gravity(args.gravity)?;
    let blob = PolicyBlob::load(args.policy.as_deref())?;
    let policy = blob.policy()?;
    let name = policy.manifest().name.to_owned();
    let mut controller = Controller::new(policy, config);

    let stop = Stop::on_signals().map_err(CliError::Signals)?;
    let timeout = args.meeting.timeout;
    let domain = Domain::join(args.meeting.domain())?;
    let leg = controller.policy().manifest().leg;
    let pace = if args.real_time.real_time { Pace::RealTime } else { Pace::LockStep };
    let terms = Terms::at(args.rate).with_gravity(args.gravity).with_leg(&leg).with_pace(pace);
    let mut said = false;
    let mut link = ShmController::connect_watching(&domain, terms, timeout, &stop, |missing| {
        if !said && missing.waited >= SAY_AFTER {
            said = true;
            eprintln!("{}: {missing}; still waiting", Role::Controller);
        }
        true
    })?;
    if let Some(warning) = other_leg(controller.policy().manifest(), link.peer_leg()) {
        eprintln!("{}: {warning}", Role::Controller);
    }

    if pace == Pace::RealTime {
        let mut law = Plain { controller, config };
        let options = args.real_time.options(Role::Controller, args.rate, Shared::default());
        let (gave_up, look) = realtime::watch(&link, &stop, Some(timeout));
        let Served { ended, samples, last, report } =
            realtime::serve(link, &mut law, Ends::AtFarewell, &options, &stop, look);
        let ended = gave_up.get().cloned().map_or(ended, Err);
        return Ok(Summary {
            policy: name,
            ticks: samples,
            apexes: last.apexes,
            counts: *law.controller.counts(),
            real_time: Some(report),
            ended,
        });
    }
    let mut apexes = 0;
    let ticks = serve(&mut link, timeout, |sample| {
        let command = controller.tick(Some(sample));
        apexes = command.apexes;
        command
    })?;
    let counts = *controller.counts();
    Ok(Summary { policy: name, ticks, apexes, counts, real_time: None, ended: Ok(()) })
}

/// The whole program after its arguments: runs, reports, and gives the exit
/// status.
#[must_use]
pub fn main(call: &Call) -> ExitCode {
    let done = match &call.command {
        Some(Command::Flashed(command)) => return commands::main(command),
        Some(Command::Bench(args)) => bench::run(args).map_err(CliError::from),
        None => run(&call.args).and_then(|summary| {
            if call.args.json {
                println!("{}", summary.json());
            } else {
                println!("{}: {summary}", Role::Controller);
            }
            Ok(summary.ended?)
        }),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", Role::Controller);
            ExitCode::from(if error.is_misuse() { 2 } else { 1 })
        }
    }
}
