//! The command `trainer train`.

use super::config::ConfigArguments;
use super::eval::{MOST_STARTS, SEED, text};
use super::output::{Target, pool, print, remedy};
use super::stoppable::unless_stopped;
use super::{Failure, IsaArgument, failed, input};
use crate::config::{Config, Length};
use crate::evaluate::report::Report;
use crate::run::checkpoint::{self, Checkpoint};
use crate::run::error::{Purpose, RunError};
use crate::run::paths::{log_candidates, other_policy, place, usual_log};
use crate::run::{Run, RunEnd, RunOptions};
use crate::trained::TrainedPolicy;
use anyhow::{Context, anyhow};
use clap::Args;
use leg_control::policy::{ParseError, Policy};
use leg_process::policy_file::{AlignedBytes, PolicyFile};
use leg_process::{Stop, stderr};
use std::path::{Path, PathBuf};
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
    /// .csv, in place of .bin if it ends so; with --resume, the log of the checkpoint]
    #[arg(long)]
    log: Option<PathBuf>,
    /// Folder for TensorBoard event files; the training writes into a folder of its own below
    /// it, named after the policy file
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
    /// --config, unless it is complete
    #[arg(long, conflicts_with = "restart")]
    resume: bool,
    /// Begin anew, and discard the policy at --out, the checkpoint beside it and the rows of an
    /// interrupted training without one
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

    /// Returns the path of a new log. It must differ from the policy's, and from the log of
    /// another policy.
    fn log(&self) -> Result<PathBuf, Failure> {
        let out = &self.out;
        let Some(path) = &self.log else {
            if out.extension().is_some_and(|ending| ending == "csv") {
                return Err(input(anyhow!(
                    "--out {}: this is the name of a log, such as that of {}; let the policy's \
                     name end otherwise, such as in .bin, or name the log with --log",
                    out.display(),
                    out.with_extension("bin").display()
                )));
            }
            let other = other_policy(out);
            let is_policy = || PolicyFile::read(&other).is_ok_and(|file| file.policy().is_ok());
            if checkpoint::path(&other).exists() || is_policy() {
                let (out, log, other) = (out.display(), usual_log(out), other.display());
                let log = log.display();
                return Err(input(anyhow!(
                    "--out {out}: its log would be {log}, which is that of {other}; name another \
                     log with --log, or another policy with --out"
                )));
            }
            return Ok(usual_log(out));
        };
        if place(path) == place(out) {
            let path = path.display();
            return Err(input(anyhow!(
                "--log {path}: this is the policy file, --out; give the log another name"
            )));
        }
        Ok(path.clone())
    }

    /// Returns where the log of a checkpoint may be.
    fn logs(&self, checkpoint: &Checkpoint) -> Vec<PathBuf> {
        match &self.log {
            Some(path) => vec![path.clone()],
            None => log_candidates(&self.out, &checkpoint.log_path),
        }
    }

    /// Returns the policy that a training without a checkpoint would overwrite.
    fn finished(&self) -> Option<PolicyFile> {
        if checkpoint::path(&self.out).exists() {
            return None;
        }
        // What is no policy may be overwritten, as the outputs of other commands are.
        PolicyFile::read(&self.out).ok().filter(|file| file.policy().is_ok())
    }

    /// Checks that a finished policy is of the same training, which gives it again to the last bit.
    fn check_same(&self, finished: &PolicyFile, config: &Config) -> Result<(), Failure> {
        let policy = finished.policy().map_err(input)?;
        let from = &policy.manifest().provenance;
        let seed = self.seed.unwrap_or(0);
        let what = if from.seed != seed {
            format!("its seed is {}, not {seed}", from.seed)
        } else if from.config != config.to_toml() {
            match toml::from_str::<Config>(from.config) {
                Ok(there) => there.difference(config).unwrap_or_else(|| "another preset".into()),
                Err(_) => "it is not made by such a training".into(),
            }
        } else {
            return Ok(());
        };
        let out = self.out.display();
        Err(input(anyhow!(
            "--out {out}: this is another policy ({what}); name another file with --out, or \
             replace it with --restart"
        )))
    }

    /// Returns whether there is nothing to resume because the training is complete.
    fn is_complete(&self) -> Result<bool, Failure> {
        let Some(finished) = self.finished().filter(|_| self.resume) else { return Ok(false) };
        if self.choice.is_given() {
            self.check_same(&finished, &self.config(None)?)?;
        }
        Ok(true)
    }

    /// Checks that policy and log can be written, and do not replace the configuration.
    fn check_outputs(&self, log: &Path) -> Result<(), Failure> {
        let log = Target { path: log, option: "--log" };
        log.check_apart(self.choice.file())?;
        self.target().check(self.choice.file())
    }

    fn target(&self) -> Target<'_> {
        Target { path: &self.out, option: "--out" }
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
        RunError::Unwritten { purpose, cause, .. } => {
            let option = match purpose {
                // The checkpoint is a new file beside the policy.
                Purpose::Checkpoint => "--out, or disable checkpoints with --checkpoint-every 0",
                Purpose::Log => "--log",
                Purpose::Events => "--tensorboard",
            };
            remedy(cause, option)
        }
        RunError::Busy(_) => "end it, or name another file with --log".into(),
        RunError::OtherLog { checkpoint: Some(_), .. } => {
            "resume that training first, or name another log with --log".into()
        }
        RunError::OtherLog { checkpoint: None, .. } => {
            "name another log with --log; --restart discards these rows".into()
        }
        RunError::Log { .. } => "name the checkpoint's log with --log; --restart would discard \
                                 the checkpoint and begin anew"
            .into(),
        RunError::Checkpoint { .. } | RunError::State { .. } => {
            "--restart would discard it and begin anew".into()
        }
        RunError::Collapsed(_) => "--allow-collapse continues all the same".into(),
        _ => return None,
    })
}

/// Begins or resumes the training. All input errors are found here.
fn open(arguments: &Arguments) -> Result<Run, Failure> {
    let isa = arguments.isa.isa()?;
    let checkpoint = arguments.checkpoint()?;
    let every = arguments.checkpoint_every;
    let logs = match &checkpoint {
        Some(checkpoint) => arguments.logs(checkpoint),
        None => vec![arguments.log()?],
    };
    let options = RunOptions {
        out: arguments.out.clone(),
        log: logs[0].clone(),
        tensorboard: arguments.tensorboard.clone(),
        checkpoint_every: (every > 0.0).then(|| Duration::from_secs_f64(every)),
        quiet: arguments.quiet,
        allow_collapse: arguments.allow_collapse,
        discard: arguments.restart,
    };
    let run = if let Some(checkpoint) = checkpoint {
        arguments.check_agreement(&checkpoint)?;
        arguments.check_outputs(&logs[0])?;
        Run::resume(checkpoint, &logs, isa, &options)
    } else {
        let config = arguments.config(None)?;
        // Before the training: the output must be writable.
        arguments.check_outputs(&logs[0])?;
        if let Some(finished) = arguments.finished().filter(|_| !arguments.restart) {
            arguments.check_same(&finished, &config)?;
        }
        Run::begin(config, arguments.seed.unwrap_or(0), isa, &options)
    };
    run.map_err(|error| {
        let is_wrong_path = error.is_wrong_path();
        match failure(error) {
            // Nothing was done yet: the caller can name another path.
            Failure::Run(message) if is_wrong_path => Failure::Input(message),
            failure => failure,
        }
    })
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Before any file exists, so that a signal leaves none unfinished.
    let stop = Stop::on_signals().context("signals").map_err(failed)?;
    if arguments.is_complete()? {
        let out = arguments.out.display();
        return print(&format!("{out}: this training is complete, nothing is left to resume"));
    }
    let pool = pool()?;
    let began = Instant::now();
    let mut run = open(arguments)?;
    let before = run.training().total_steps();
    if before > 0 && !arguments.quiet {
        stderr::print_line(format_args!("resuming from step {before}"));
    }
    let ended = pool.install(|| run.learn(&stop)).map_err(failure)?;
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
    let trained = unless_stopped(pool, &stop, "searching the cascade's gains…", search)
        .ok_or_else(stopped)?;
    let bytes = trained.blob().map_err(failed)?;
    arguments.target().write(bytes.as_slice())?;
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
        let report = unless_stopped(pool, &stop, "evaluating…", evaluate).ok_or_else(|| {
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
