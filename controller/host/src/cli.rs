//! The `controller` command line.
//!
//! The process serves run after run until a signal ends it; [`commands`] reach it
//! meanwhile. Exit status 0 means success, 2 bad input or a wrong option, 1 any other
//! failure.

mod background;
pub mod commands;
mod domain;
pub mod estimate;
pub mod hint;
mod real_time;
mod run_server;
mod status_text;
pub mod target;

use std::fmt;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use super::bench::{self, BenchError};
use super::discovery::{DEFAULT_DOMAIN, DomainError};
use super::law::{LawError, LawSettings};
use super::link::{LinkError, Role, TimeMode};
use super::node_loop::RunResult;
use super::policy_cache::PolicyCacheError;
use super::realtime::LoopReport;
use super::realtime::args::RealTimeArgs;
use super::serve::ServeError;
use super::shm::ConnectError;
use leg_control::config::ConfigError;
use leg_control::policy::Manifest;
use leg_process::policy_file::PolicyFileError;
use leg_process::stderr;

/// Longest timeout that `--timeout` accepts, s.
const MAX_TIMEOUT_S: f64 = 86_400.0;
/// How long to wait for a peer by default.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Time after which a missing peer is reported.
pub const REPORT_AFTER: Duration = Duration::from_secs(1);

/// Arguments of the program: how to run, or a command to a running controller.
#[derive(Clone, Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Call {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    args: Args,
}

/// A command in place of a run.
#[derive(Clone, Debug, clap::Subcommand)]
enum Command {
    /// Measure the control law on this machine.
    Bench(bench::Args),
    Estimate(Box<estimate::Args>),
    Domain(domain::Args),
    #[command(flatten)]
    Running(commands::Command),
}

/// Runs a policy on a leg: a command for every sample, in lock-step, in run
/// after run. SIGHUP has it read the file of --policy again; that policy takes
/// over at the next apex.
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
    /// What the control law takes for the state, and how old a sample may be.
    #[command(flatten)]
    pub law: LawSettings,
    /// End after one run, instead of waiting for the next leg.
    #[arg(long)]
    pub once: bool,
    /// Where to find the simulator.
    #[command(flatten)]
    pub domain: DomainArgs,
    /// How long to wait for a missing or silent simulator, s [default: as long as it takes;
    /// with --once, 10 for a missing one].
    #[arg(long, value_name = "S", value_parser = parse_timeout, allow_negative_numbers = true)]
    pub timeout: Option<Duration>,
    /// How to tick by the clock.
    #[command(flatten)]
    pub real_time: RealTimeArgs,
    /// Print what came of each run as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Where two processes connect.
#[derive(Clone, Debug, clap::Args)]
pub struct DomainArgs {
    /// Only processes of the same domain see each other [default: default].
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
}

impl DomainArgs {
    /// Returns the name of the domain.
    #[must_use]
    pub fn name(&self) -> &str {
        self.domain.as_deref().unwrap_or(DEFAULT_DOMAIN)
    }
}

/// Where two processes connect, and how long one waits for the other.
#[derive(Clone, Debug, clap::Args)]
pub struct Meeting {
    /// The domain.
    #[command(flatten)]
    pub domain: DomainArgs,
    /// How long to wait for a missing or silent peer, s [default: 10].
    #[arg(long, value_name = "S", value_parser = parse_timeout, allow_negative_numbers = true)]
    pub timeout: Option<Duration>,
}

impl Meeting {
    /// Returns the name of the domain.
    #[must_use]
    pub fn domain(&self) -> &str {
        self.domain.name()
    }

    /// Returns how long to wait.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        self.timeout.unwrap_or(TIMEOUT)
    }
}

/// Parses a waiting time in seconds.
///
/// # Errors
/// Returns a message with the limits.
pub fn parse_timeout(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s <= MAX_TIMEOUT_S => Ok(Duration::from_secs_f64(s)),
        _ => Err(format!("it must be a number of seconds, above 0 and at most {MAX_TIMEOUT_S}")),
    }
}

/// The controller did not run to the end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CliError {
    /// There is no policy to run.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The policy cannot be kept.
    #[error("the policy cannot be run: {0}")]
    Cache(#[from] PolicyCacheError),
    /// The rate or the gravity is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A setting of the law is out of range.
    #[error(transparent)]
    Law(#[from] LawError),
    /// A signal handler could not be set.
    #[error("cannot listen to signals: {0}")]
    Signals(io::Error),
    /// No simulator connected, or one that disagrees.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The run ended early.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// The loop in real time ended early.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The measurement failed.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// The estimation of a log failed.
    #[error(transparent)]
    Estimate(#[from] estimate::CommandError),
}

impl Args {
    fn time_mode(&self) -> TimeMode {
        if self.real_time.real_time { TimeMode::RealTime } else { TimeMode::LockStep }
    }
}

impl CliError {
    /// Returns what the user can do about the error.
    fn hint(&self) -> Option<String> {
        match self {
            Self::Connect(error) => hint::connect_error(error),
            Self::Link(error) => hint::link_error(error),
            Self::Serve(error) => hint::serve_error(error),
            Self::Estimate(error) => error.hint(),
            Self::Law(error) => Some(format!("{} sets it", hint::law_option(error.key))),
            _ => None,
        }
    }

    /// Returns whether the user must change the arguments.
    fn is_misuse(&self) -> bool {
        if let Self::Estimate(error) = self {
            return error.is_misuse();
        }
        matches!(
            self,
            Self::Policy(_)
                | Self::Cache(_)
                | Self::Bench(BenchError::Policy(_))
                | Self::Config(_)
                | Self::Law(_)
                | Self::Connect(ConnectError::Domain(DomainError::Name(_)))
        )
    }
}

impl From<DomainError> for CliError {
    fn from(cause: DomainError) -> Self {
        Self::Connect(cause.into())
    }
}

/// The result of a run, or the total of all runs in real time.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Name of the policy.
    pub policy: String,
    /// Samples answered, apexes, and samples that the guard rejected.
    pub result: RunResult,
    /// Whether this is the total of a controller that serves any number of runs.
    pub is_total: bool,
    /// Timing of the loop in real time, over all runs.
    pub real_time: Option<LoopReport>,
}

impl Summary {
    /// Returns the summary for a script: a [`LoopReport`] in `loop`, the number of samples
    /// that the guard rejected in `rejected`.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "policy": self.policy,
            "is_total": self.is_total,
            "runs": self.result.runs,
            "ticks": self.result.ticks,
            "apexes": self.result.apexes,
            "rejected": self.result.counts.rejected(),
            "safe_entered": self.result.counts.safe_entered,
            "loop": self.real_time,
        })
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, result, is_total, real_time } = self;
        let RunResult { runs, ticks, apexes, counts } = result;
        if let Some(report) = real_time {
            writeln!(f, "{report}")?;
        }
        if *is_total {
            write!(f, "total of {runs} runs: ")?;
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

/// Returns the warning about a policy that was trained for another leg than the
/// `simulated` one, by its [`fingerprint`](leg_control::leg::LegModel::fingerprint).
#[must_use]
pub fn other_leg(policy: &Manifest<'_>, simulated: Option<u32>) -> Option<String> {
    let Manifest { name, leg, .. } = policy;
    simulated.filter(|simulated| *simulated != leg.fingerprint()).map(|_| {
        format!(
            "warning: the policy {name} was trained for another leg ({} kg, {} N/m, {} m) than \
             the simulator has; it runs all the same, --policy chooses another",
            leg.mass_kg, leg.stiffness_n_m, leg.rest_length_m
        )
    })
}

/// Prints a message of the controller on the standard error.
fn log(message: impl fmt::Display) {
    stderr::print_line(format_args!("{}: {message}", Role::Controller));
}

/// Runs the program with these arguments, reports, and returns the exit status.
#[must_use]
pub fn main(call: &Call) -> ExitCode {
    leg_process::signals::report_size_limit();
    let done = match &call.command {
        Some(Command::Running(command)) => return commands::main(command),
        Some(Command::Bench(args)) => bench::run(args).map_err(CliError::from),
        Some(Command::Domain(args)) => domain::run(args),
        Some(Command::Estimate(args)) => estimate::run(args).map_err(CliError::from),
        None => run_server::run(&call.args, |summary| {
            let _ = if call.args.json {
                writeln!(io::stdout(), "{}", summary.json())
            } else {
                writeln!(io::stdout(), "{}: {summary}", Role::Controller)
            };
        }),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            log(hint::with_hint(&error, error.hint()));
            ExitCode::from(if error.is_misuse() { 2 } else { 1 })
        }
    }
}
