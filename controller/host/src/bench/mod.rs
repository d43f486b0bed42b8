//! `controller bench`: what the control law costs on this machine.

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
use workload::{Kind, Moment, Ticks, infer};

/// Calls that are timed together: a look at the clock takes as long as a tick.
const BATCH: usize = 64;
/// Batches of each kind.
const BATCHES: usize = 4_000;
/// How the copy whose instructions are counted is told so.
const COPY: &str = "--as-the-copy-that-is-counted";

/// Measures the control law on this machine: nanoseconds (means over 64 calls)
/// and instructions of an inference, of ordinary ticks, and of a tick at an apex.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The policy blob [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Print the result as one JSON object: for each kind `ns` {p50, p99,
    /// `p99_9`, max} and `instructions` (null where they cannot be counted).
    #[arg(long)]
    json: bool,
    #[arg(long = "as-the-copy-that-is-counted", hide = true)]
    copy: bool,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// There is no policy to measure.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// The instructions' counter failed in the copy.
    #[error("cannot be counted: {0}")]
    Copy(String),
    /// The figures cannot be printed.
    #[error("cannot print the figures: {0}")]
    Print(#[from] io::Error),
}

/// Times of one kind of work, ns, each the mean of a batch.
struct TimesNs([f64; 4]);

impl TimesNs {
    const NAMES: [&'static str; 4] = ["p50", "p99", "p99_9", "max"];

    fn of(mut batches: Vec<f64>) -> Self {
        batches.sort_unstable_by(f64::total_cmp);
        let last = batches.len() - 1;
        Self([0.5, 0.99, 0.999, 1.0].map(|share| batches[(last as f64 * share) as usize]))
    }
}

/// What was measured.
struct Measured {
    policy: String,
    times: Vec<TimesNs>,
    counts: Result<Counts, CountError>,
}

/// Measures and prints.
///
/// # Errors
/// [`BenchError`]. Instructions that cannot be counted are no error: it says why.
pub fn run(args: &Args) -> Result<(), BenchError> {
    let blob = PolicyFile::load(args.policy.as_deref())?;
    let policy = blob.policy()?;
    if args.copy {
        return count::be_counted(&policy).map_err(|cause| BenchError::Copy(cause.to_string()));
    }
    let measured = Measured {
        policy: policy.manifest().name.to_owned(),
        times: times(&policy),
        counts: copy(args).map_err(CountError::Start).and_then(|mut copy| count::count(&mut copy)),
    };
    if args.json {
        stdout::print_line(measured.json())?;
    } else {
        stdout::print_line(measured)?;
    }
    Ok(())
}

/// This call once more, as the copy.
fn copy(args: &Args) -> std::io::Result<Command> {
    let mut copy = Command::new(std::env::current_exe()?);
    // Be it `controller bench` or `sim-host controller bench`.
    copy.args(std::env::args_os().skip(1).take_while(|word| word != "bench")).arg("bench");
    if let Some(policy) = &args.policy {
        copy.arg("--policy").arg(policy);
    }
    copy.arg(COPY);
    Ok(copy)
}

/// Times of every kind, the kinds taken in turn, so that what else the machine
/// does hits all alike.
fn times(policy: &Policy<'_>) -> Vec<TimesNs> {
    let ticks = Ticks::of(policy);
    let mut batches: Vec<Vec<f64>> = Kind::ALL.map(|_| Vec::with_capacity(BATCHES)).into();
    for round in 0..BATCHES {
        for (kind, batches) in Kind::ALL.into_iter().zip(&mut batches) {
            batches.push(match kind {
                Kind::Inference => mean_ns(&mut [(); BATCH], |()| infer(policy.actor())),
                _ => mean_ns(&mut batch(ticks.of_kind(kind), round), Moment::pass),
            });
        }
    }
    batches.into_iter().map(TimesNs::of).collect()
}

fn batch<'a>(moments: &[Moment<'a>], round: usize) -> Vec<Moment<'a>> {
    (0..BATCH).map(|i| moments[(round * BATCH + i) % moments.len()].clone()).collect()
}

fn mean_ns<T>(pieces: &mut [T], mut work: impl FnMut(&mut T)) -> f64 {
    let start = Instant::now();
    for piece in pieces.iter_mut() {
        work(piece);
    }
    start.elapsed().as_nanos() as f64 / pieces.len() as f64
}

impl Measured {
    fn json(&self) -> Value {
        let mut object = Map::new();
        object.insert("policy".to_owned(), json!(self.policy));
        for (i, (kind, times)) in Kind::ALL.into_iter().zip(&self.times).enumerate() {
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

impl fmt::Display for Measured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "policy {}; ns, each the mean of {BATCH} calls\n", self.policy)?;
        writeln!(
            f,
            "{:<16}{:>9}{:>9}{:>9}{:>9}  {:>12}",
            "", "p50", "p99", "p99.9", "max", "instructions"
        )?;
        for (i, (kind, TimesNs(ns))) in Kind::ALL.into_iter().zip(&self.times).enumerate() {
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
            Ok(_) => write!(f, "\ninstructions: of the median call, counted one by one"),
            Err(cause) => write!(f, "\ninstructions: not counted: {cause}"),
        }
    }
}
