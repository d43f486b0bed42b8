//! `trainer train`

use super::eval::{MOST_STARTS, SEED};
use super::output::{Target, print};
use super::{Failure, IsaArgument, failed, input};
use crate::config::{Config, Length};
use crate::evaluate::report::Report;
use crate::finish::Finished;
use crate::preset::Preset;
use crate::train::Training;
use anyhow::{Context, anyhow};
use clap::Args;
use controller::host::Stop;
use controller::host::blob::AlignedBytes;
use controller::policy::{ParseError, Policy};
use indicatif::{ProgressBar, ProgressStyle};
use sim_host::output::Pending;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// The progress bar counts in thousandths.
const BAR: f64 = 1000.0;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// What to train
    #[arg(long)]
    preset: Preset,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The policy file to write
    #[arg(long)]
    out: PathBuf,
    /// CSV file with a row for every episode: reward, steps, q0 [default: the
    /// policy file's name with .csv]
    #[arg(long)]
    log: Option<PathBuf>,
    /// Length of the last stage in environment steps, instead of the preset's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "episodes")]
    steps: Option<u64>,
    /// Length of the last stage in episodes, instead of the preset's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    episodes: Option<u64>,
    /// Starts at each density of the evaluation at the end, at most 1000000; 0 for none
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(0..=MOST_STARTS)
    )]
    eval_starts: u32,
    /// Instruction set to compute with; the result does not depend on it
    #[arg(long, value_enum, default_value = "best")]
    isa: IsaArgument,
}

impl Arguments {
    fn config(&self) -> Result<Config, Failure> {
        let mut config = self.preset.config();
        if let Some(last) = config.stages.last_mut() {
            if let Some(n) = self.steps {
                last.length = Length::Steps(n);
            }
            if let Some(n) = self.episodes {
                // It needs to know how far it is: to select the actor that is kept.
                if config.selection.evaluations > 0 {
                    return Err(input(anyhow!(
                        "--episodes {n}: the preset {} is counted in steps; use --steps",
                        config.preset
                    )));
                }
                last.length = Length::Episodes(n);
            }
        }
        config.check().context("--preset").map_err(input)?;
        Ok(config)
    }

    /// Where the log goes: never where the policy goes.
    fn log(&self) -> Result<PathBuf, Failure> {
        let path = self.log.clone().unwrap_or_else(|| self.out.with_extension("csv"));
        if place(&path) != place(&self.out) {
            return Ok(path);
        }
        let path = path.display();
        Err(input(if self.log.is_some() {
            anyhow!("--log {path}: this is the policy file, --out; give the log another name")
        } else {
            anyhow!(
                "--out {path}: the log would get the same name; name the log with --log, \
                 or let the policy's name end otherwise, such as in .bin"
            )
        }))
    }
}

/// A file's place, whatever it is called by, and whether or not it is there.
fn place(path: &Path) -> PathBuf {
    let in_folder = || {
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

/// Trains to the end, with a row of the log for every episode, unless a signal
/// asks to stop.
fn learn(
    training: &mut Training,
    log: &mut csv::Writer<Pending>,
    target: Target<'_>,
    stop: &Stop,
) -> Result<(), Failure> {
    let bar = progress_bar();
    while !stop.is_raised()
        && let Some(record) = training.episode().map_err(failed)?
    {
        log.serialize(record).map_err(|e| target.unwritten(&e.into()))?;
        bar.set_position((BAR * training.share_done()) as u64);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Does work that takes seconds, with a word of it on a terminal; `None` when a
/// signal asks to stop meanwhile. The work then ends with the process.
fn unless_stopped<T: Send + 'static>(
    stop: &Stop,
    doing: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let style = ProgressStyle::with_template("{spinner} {msg}  {elapsed}").expect("a template");
    let spinner = ProgressBar::new_spinner().with_style(style).with_message(doing);
    spinner.enable_steady_tick(Duration::from_millis(200));
    let (sender, receiver) = channel();
    // A receiver that is gone has been stopped.
    let worker = std::thread::spawn(move || _ = sender.send(work()));
    let result = loop {
        match receiver.recv_timeout(Duration::from_millis(50)) {
            Ok(_) | Err(RecvTimeoutError::Timeout) if stop.is_raised() => break None,
            Ok(result) => break Some(result),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                spinner.finish_and_clear();
                match worker.join() {
                    Err(panic) => std::panic::resume_unwind(panic),
                    Ok(()) => unreachable!("it sends before it ends"),
                }
            }
        }
    };
    spinner.finish_and_clear();
    result
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let config = arguments.config()?;
    let isa = arguments.isa.isa()?;
    let log_path = arguments.log()?;
    let out = Target { path: &arguments.out, option: "--out" };
    let log_target = Target { path: &log_path, option: "--log" };
    // Before there is any file: a signal must leave none half made.
    let stop = Stop::on_signals().context("signals").map_err(failed)?;
    // Before the training, not after it: whether there is anywhere to write to.
    drop(out.begin()?);
    let mut log = csv::Writer::from_writer(log_target.begin()?);
    let began = Instant::now();
    let mut training = Training::new(config.clone(), arguments.seed, isa);
    let learnt = learn(&mut training, &mut log, log_target, &stop);
    // Also of a training that diverged or was stopped: the log says how far it came.
    let log = log.into_inner().map_err(|e| log_target.unwritten(e.error()))?;
    log_target.finish(log)?;
    learnt?;
    let steps = training.total_steps();
    let stopped = || {
        failed(anyhow!(
            "stopped by a signal after {steps} steps; no policy written (log: {})",
            log_path.display()
        ))
    };
    if stop.is_raised() {
        return Err(stopped());
    }
    let took = began.elapsed();
    let finished =
        unless_stopped(&stop, "searching the cascade's gains…", move || Finished::new(&training))
            .ok_or_else(stopped)?;
    let bytes = finished.blob().map_err(failed)?;
    out.write(bytes.as_slice())?;
    let policy = Policy::parse(bytes.as_slice()).map_err(failed)?;
    let seconds = took.as_secs_f64();
    print(&format!(
        "{}: {} with seed {}, {steps} steps in {seconds:.1} s ({}), CRC-32 {:08x}",
        arguments.out.display(),
        config.preset,
        arguments.seed,
        isa.name(),
        policy.crc32()
    ))?;
    if let Some(standing) = finished.standing {
        print(&format!(
            "Kept: the actor after {} steps, the best of {} evaluations.",
            standing.steps, config.selection.evaluations
        ))?;
    }
    if arguments.eval_starts > 0 {
        let starts = arguments.eval_starts as usize;
        let evaluate = move || evaluate(&bytes, starts);
        let report = unless_stopped(&stop, "evaluating…", evaluate).ok_or_else(|| {
            let out = arguments.out.display();
            failed(anyhow!("stopped by a signal; {out} is written, but was not evaluated"))
        })?;
        print(&format!("\n{}", report.map_err(failed)?))?;
    }
    Ok(())
}

fn evaluate(bytes: &AlignedBytes, starts: usize) -> Result<Report, ParseError> {
    let policy = Policy::parse(bytes.as_slice())?;
    Ok(Report::new(&policy, starts, SEED))
}

/// On a terminal only: elsewhere it draws nothing.
fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed}, {eta} to go")
        .expect("a valid template");
    let bar = ProgressBar::new(BAR as u64).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}
