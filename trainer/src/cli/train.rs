//! The command `trainer train`.

use super::config::ConfigArguments;
use super::eval::{MOST_STARTS, SEED, text};
use super::output::{Target, print};
use super::{Failure, IsaArgument, failed, input};
use crate::config::{Config, Length};
use crate::evaluate::report::Report;
use crate::run::checkpoint::{self, Checkpoint};
use crate::run::error::{Purpose, RunError};
use crate::run::{Run, RunEnd, RunOptions};
use crate::trained::TrainedPolicy;
use anyhow::{Context, anyhow};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use leg_control::policy::{ParseError, Policy};
use leg_process::Stop;
use leg_process::policy_file::AlignedBytes;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Longest stage that the options accept.
const LONGEST: u64 = 1_000_000_000_000;

#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub(super) struct Arguments {
    #[command(flatten)]
    choice: ConfigArguments,
    /// Seed of all random numbers [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// Policy file to write
    #[arg(long)]
    out: PathBuf,
    /// CSV log to write, with a row for every episode [default: the policy file's name with
    /// .csv]
    #[arg(long)]
    log: Option<PathBuf>,
    /// Folder for TensorBoard event files
    #[arg(long, value_name = "DIR")]
    tensorboard: Option<PathBuf>,
    /// Length of the last stage in environment steps, instead of the configuration's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=LONGEST), conflicts_with = "episodes")]
    steps: Option<u64>,
    /// Length of the last stage in episodes, instead of the configuration's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=LONGEST))]
    episodes: Option<u64>,
    /// Seconds between checkpoints, which are beside --out; 0 disables them
    #[arg(long, value_name = "SECONDS", default_value = "30", value_parser = seconds)]
    checkpoint_every: f64,
    /// Resume from the checkpoint beside --out; without one, begin the training of --preset or
    /// --config
    #[arg(long, conflicts_with = "restart")]
    resume: bool,
    /// Begin anew and discard the checkpoint beside --out
    #[arg(long)]
    restart: bool,
    /// Continue a training that has collapsed
    #[arg(long)]
    allow_collapse: bool,
    /// Suppress progress output
    #[arg(long)]
    quiet: bool,
    /// Number of random starts of the final evaluation at each density ratio, at most 1000000;
    /// 0 skips it
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(0..=MOST_STARTS)
    )]
    eval_starts: u32,
    /// Instruction set to use; the result does not depend on it
    #[arg(long, value_enum, default_value = "best")]
    isa: IsaArgument,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(s) if (0.0..=1e6).contains(&s) => Ok(s),
        _ => Err("expected seconds, from 0 to 1000000".into()),
    }
}

impl Arguments {
    /// Returns the chosen configuration; without a preset or file, `otherwise` with the
    /// changes.
    fn config(&self, otherwise: Option<&Config>) -> Result<Config, Failure> {
        let mut config = self.choice.config(otherwise)?;
        if let Some(last) = config.stages.last_mut() {
            if let Some(n) = self.steps {
                last.length = Length::Steps(n);
            }
            if let Some(n) = self.episodes {
                // The selection needs the completed share of the stage in steps.
                if config.selection.evaluations > 0 {
                    return Err(input(anyhow!(
                        "--episodes {n}: the preset {} is counted in steps; use --steps",
                        config.preset
                    )));
                }
                last.length = Length::Episodes(n);
            }
        }
        let options = self.choice.options();
        config.check().map_err(|e| input(anyhow!("{options}: {e}")))?;
        Ok(config)
    }

    /// Returns the checkpoint to resume, if there is one.
    fn checkpoint(&self) -> Result<Option<Checkpoint>, Failure> {
        let path = checkpoint::path(&self.out);
        if self.restart || !path.exists() {
            if self.resume && !self.choice.is_given() {
                return Err(input(anyhow!(
                    "--resume: there is no checkpoint {}; give --preset or --config to begin",
                    path.display()
                )));
            }
            return Ok(None);
        }
        if !self.resume {
            return Err(input(anyhow!(
                "{}: a training with this --out is not complete; continue it with --resume, or \
                 discard it with --restart",
                path.display()
            )));
        }
        Checkpoint::read(&self.out).map_err(failure)
    }

    /// Checks that the options given beside --resume agree with the checkpoint.
    fn check_agreement(&self, checkpoint: &Checkpoint) -> Result<(), Failure> {
        let there = checkpoint.config(&checkpoint::path(&self.out)).map_err(failure)?;
        if let Some(seed) = self.seed.filter(|&seed| seed != checkpoint.seed) {
            let there = checkpoint.seed;
            return Err(input(anyhow!("--seed {seed}: the checkpoint's is {there}; leave it out")));
        }
        match there.difference(&self.config(Some(&there))?) {
            None => Ok(()),
            Some(what) => Err(input(anyhow!(
                "--resume: the checkpoint is of another configuration ({what}, the checkpoint's \
                 first); leave --preset, --config, --set, --steps and --episodes out"
            ))),
        }
    }

    /// Returns the path of the log, which must differ from the policy's.
    fn log(&self, checkpoint: Option<&Checkpoint>) -> Result<PathBuf, Failure> {
        let path = match (&self.log, checkpoint) {
            (Some(path), _) => path.clone(),
            (None, Some(checkpoint)) => checkpoint.log_path.clone(),
            (None, None) => self.out.with_extension("csv"),
        };
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

    /// Returns how a stopped training can be resumed.
    fn how_to_resume(&self) -> String {
        if self.checkpoint_every > 0.0 {
            format!("resume with: trainer train --resume --out {}", self.out.display())
        } else {
            "with --checkpoint-every 0 it cannot be resumed".into()
        }
    }
}

/// Returns the canonical path of a file, whether or not it exists.
fn place(path: &Path) -> PathBuf {
    let in_folder = || {
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

fn failure(error: RunError) -> Failure {
    let is_input = error.is_input();
    let error = match hint(&error) {
        Some(hint) => anyhow!("{error}; {hint}"),
        None => error.into(),
    };
    if is_input { input(error) } else { failed(error) }
}

/// Returns the options that help with an error.
fn hint(error: &RunError) -> Option<String> {
    Some(match error {
        RunError::Unwritten { purpose, .. } => {
            let option = match purpose {
                Purpose::Checkpoint => "--out",
                Purpose::Log => "--log",
                Purpose::Events => "--tensorboard",
            };
            format!("name another place with {option}")
        }
        RunError::Busy(_) => "end it, or name another file with --log".into(),
        RunError::Log { .. } | RunError::Checkpoint { .. } | RunError::State { .. } => {
            "--restart begins anew".into()
        }
        RunError::Collapsed(_) => "--allow-collapse continues all the same".into(),
        _ => return None,
    })
}

/// Runs `work` on a thread, with a spinner on a terminal. Returns `None` when a signal stops
/// it; the thread then ends with the process.
fn unless_stopped<T: Send + 'static>(
    stop: &Stop,
    doing: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let style = ProgressStyle::with_template("{spinner} {msg}  {elapsed}").expect("a template");
    let spinner = ProgressBar::new_spinner().with_style(style).with_message(doing);
    spinner.enable_steady_tick(Duration::from_millis(200));
    let (sender, receiver) = channel();
    // Sending fails only after a stop.
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

/// Begins or resumes the training. All input errors are found here.
fn open(arguments: &Arguments) -> Result<Run, Failure> {
    let isa = arguments.isa.isa()?;
    let checkpoint = arguments.checkpoint()?;
    let every = arguments.checkpoint_every;
    let options = RunOptions {
        out: arguments.out.clone(),
        log: arguments.log(checkpoint.as_ref())?,
        tensorboard: arguments.tensorboard.clone(),
        checkpoint_every: (every > 0.0).then(|| Duration::from_secs_f64(every)),
        quiet: arguments.quiet,
        allow_collapse: arguments.allow_collapse,
    };
    let run = if let Some(checkpoint) = checkpoint {
        arguments.check_agreement(&checkpoint)?;
        Run::resume(checkpoint, isa, &options)
    } else {
        let config = arguments.config(None)?;
        // Before the training: the output must be writable.
        drop(Target { path: &arguments.out, option: "--out" }.begin()?);
        Run::begin(config, arguments.seed.unwrap_or(0), isa, &options)
    };
    run.map_err(failure)
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Before any file exists, so that a signal leaves none unfinished.
    let stop = Stop::on_signals().context("signals").map_err(failed)?;
    let began = Instant::now();
    let mut run = open(arguments)?;
    let before = run.training().total_steps();
    if before > 0 && !arguments.quiet {
        eprintln!("resuming from step {before}");
    }
    let ended = run.learn(&stop).map_err(failure)?;
    let took = began.elapsed();
    let (training, closing) = run.close();
    let steps = training.total_steps();
    let stopped = || {
        let how = arguments.how_to_resume();
        failed(anyhow!("stopped by a signal after {steps} steps; no policy written; {how}"))
    };
    if ended == RunEnd::Stopped {
        return Err(stopped());
    }
    let (config, seed) = (training.config().clone(), training.seed());
    let search = move || TrainedPolicy::new(&training);
    let trained =
        unless_stopped(&stop, "searching the cascade's gains…", search).ok_or_else(stopped)?;
    let bytes = trained.blob().map_err(failed)?;
    Target { path: &arguments.out, option: "--out" }.write(bytes.as_slice())?;
    closing.close().map_err(failure)?;
    let policy = Policy::parse(bytes.as_slice()).map_err(failed)?;
    let seconds = took.as_secs_f64();
    let since = if before > 0 { format!(" since step {before}") } else { String::new() };
    print(&format!(
        "{}: {} with seed {seed}, {steps} steps{since} in {seconds:.1} s ({}), CRC-32 {:08x}",
        arguments.out.display(),
        config.preset,
        arguments.isa.isa()?.name(),
        policy.crc32()
    ))?;
    if let Some(score) = trained.score {
        print(&format!(
            "Best actor: after {} steps, the best of {} evaluations.",
            score.steps, config.selection.evaluations
        ))?;
    }
    if arguments.eval_starts > 0 {
        let starts = arguments.eval_starts as usize;
        let evaluate = move || evaluate(&bytes, starts);
        let report = unless_stopped(&stop, "evaluating…", evaluate).ok_or_else(|| {
            let out = arguments.out.display();
            failed(anyhow!("stopped by a signal; {out} is written, but not evaluated"))
        })?;
        print(&format!("\n{}", text(&report.map_err(failed)?)))?;
    }
    Ok(())
}

fn evaluate(bytes: &AlignedBytes, starts: usize) -> Result<Report, ParseError> {
    let policy = Policy::parse(bytes.as_slice())?;
    Ok(Report::new(&policy, starts, SEED))
}
