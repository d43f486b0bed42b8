//! `controller bench`: the cost of the control law on this machine.

mod count;
mod workload;

use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;
use std::{fmt, io};

use serde_json::{Map, Value, json};

use count::{CountError, Counts};
use leg_control::policy::Policy;
use leg_process::policy_file::{PolicyFile, PolicyFileError};
use leg_process::stdout;
use workload::{PreparedTick, TickSamples, WorkKind, infer};

/// Calls that are timed together, because reading the clock takes as long as a tick.
const BATCH: usize = 64;
/// Batches of each kind.
const BATCHES: usize = 4_000;
/// Hidden option that marks the traced copy of this process.
const COPY: &str = "--as-the-copy-that-is-counted";

/// Measure the control law on this machine: nanoseconds (means over 64 calls) and
/// instructions of an inference, of ticks in flight and in stance, and of a tick at an
/// apex.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Policy file [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Print the result as one JSON object: for each kind of work `ns` {p50, p99, `p99_9`,
    /// max} and `instructions` (null if they cannot be counted).
    #[arg(long)]
    json: bool,
    #[arg(long = "as-the-copy-that-is-counted", hide = true)]
    copy: bool,
}

/// The measurement failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The policy cannot be loaded.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The traced copy failed.
    #[error("cannot count instructions: {0}")]
    Copy(String),
    /// The result cannot be printed.
    #[error("cannot print the result: {0}")]
    Print(#[from] io::Error),
}

/// Quantiles of the times of one kind of work, ns. Each time is the mean of a batch.
struct TimesNs([f64; 4]);

impl TimesNs {
    const NAMES: [&'static str; 4] = ["p50", "p99", "p99_9", "max"];

    fn of(mut batches: Vec<f64>) -> Self {
        batches.sort_unstable_by(f64::total_cmp);
        let last = batches.len() - 1;
        Self([0.5, 0.99, 0.999, 1.0].map(|share| batches[(last as f64 * share) as usize]))
    }
}

/// The result of the measurement.
struct BenchReport {
    policy: String,
    times: Vec<TimesNs>,
    counts: Result<Counts, CountError>,
}

/// Runs the measurement and prints the result.
///
/// # Errors
/// Returns [`BenchError`]. Instructions that cannot be counted are not an error; the
/// result gives the reason.
pub fn run(args: &Args) -> Result<(), BenchError> {
    let blob = PolicyFile::load(args.policy.as_deref())?;
    let policy = blob.policy()?;
    if args.copy {
        return count::run_traced(&policy).map_err(|cause| BenchError::Copy(cause.to_string()));
    }
    let report = BenchReport {
        policy: policy.manifest().name.to_owned(),
        times: times(&policy),
        counts: traced_copy(args)
            .map_err(CountError::Start)
            .and_then(|mut copy| count::count(&mut copy)),
    };
    if args.json {
        stdout::print_line(report.json())?;
    } else {
        stdout::print_line(report)?;
    }
    Ok(())
}

/// Returns the command that starts this program again as the traced copy.
fn traced_copy(args: &Args) -> std::io::Result<Command> {
    let mut copy = Command::new(leg_process::program::current()?);
    // Called as `controller bench` or as `sim-host controller bench`.
    copy.args(std::env::args_os().skip(1).take_while(|arg| arg != "bench")).arg("bench");
    if let Some(policy) = &args.policy {
        copy.arg("--policy").arg(policy);
    }
    copy.arg(COPY);
    Ok(copy)
}

/// Measures the times of all kinds. The kinds alternate, so that other load on the
/// machine affects all alike.
fn times(policy: &Policy<'_>) -> Vec<TimesNs> {
    let ticks = TickSamples::of(policy);
    let mut batches: Vec<Vec<f64>> = WorkKind::ALL.map(|_| Vec::with_capacity(BATCHES)).into();
    for round in 0..BATCHES {
        for (kind, batches) in WorkKind::ALL.into_iter().zip(&mut batches) {
            batches.push(match kind {
                WorkKind::Inference => mean_ns(&mut [(); BATCH], |()| infer(policy.actor())),
                _ => mean_ns(&mut batch(ticks.of_kind(kind), round), PreparedTick::run),
            });
        }
    }
    batches.into_iter().map(TimesNs::of).collect()
}

fn batch<'a>(ticks: &[PreparedTick<'a>], round: usize) -> Vec<PreparedTick<'a>> {
    (0..BATCH).map(|i| ticks[(round * BATCH + i) % ticks.len()].clone()).collect()
}

fn mean_ns<T>(items: &mut [T], mut work: impl FnMut(&mut T)) -> f64 {
    let start = Instant::now();
    for item in items.iter_mut() {
        work(item);
    }
    start.elapsed().as_nanos() as f64 / items.len() as f64
}

impl BenchReport {
    fn json(&self) -> Value {
        let mut object = Map::new();
        object.insert("policy".to_owned(), json!(self.policy));
        for (i, (kind, times)) in WorkKind::ALL.into_iter().zip(&self.times).enumerate() {
            let ns: Map<_, _> = TimesNs::NAMES
                .into_iter()
                .zip(times.0)
                .map(|(name, ns)| (name.to_owned(), json!(ns)))
                .collect();
            let instructions = self.counts.as_ref().ok().map(|counts| counts[i]);
            object.insert(kind.key().to_owned(), json!({ "ns": ns, "instructions": instructions }));
        }
        Value::Object(object)
    }
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "policy {}; times in ns, each the mean of {BATCH} calls\n", self.policy)?;
        writeln!(
            f,
            "{:<16}{:>9}{:>9}{:>9}{:>9}  {:>12}",
            "", "p50", "p99", "p99.9", "max", "instructions"
        )?;
        for (i, (kind, TimesNs(ns))) in WorkKind::ALL.into_iter().zip(&self.times).enumerate() {
            write!(f, "{:<16}", kind.key().replace('_', " "))?;
            for ns in ns {
                write!(f, "{ns:>9.1}")?;
            }
            match &self.counts {
                Ok(counts) => writeln!(f, "  {:>12}", counts[i])?,
                Err(_) => writeln!(f, "  {:>12}", "-")?,
            }
        }
        match &self.counts {
            Ok(_) => writeln!(f, "\ninstructions: of the median call, counted by single-stepping")?,
            Err(cause) => writeln!(f, "\ninstructions: not counted: {cause}")?,
        }
        write!(f, "on a Cortex-M4F: `cargo xtask budget --policy FILE` counts them in an emulator")
    }
}
