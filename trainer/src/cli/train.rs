//! `trainer train`

use super::output::{begin, finish, print, write_file};
use super::{Failure, IsaArgument, failed, input};
use crate::config::{Config, Length};
use crate::evaluate::report::Report;
use crate::policy::{About, blob};
use crate::preset::Preset;
use crate::train::Training;
use anyhow::Context;
use clap::Args;
use controller::policy::Policy;
use indicatif::{ProgressBar, ProgressStyle};
use sim_host::output::Pending;
use std::path::PathBuf;
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
    /// Starts at each density of the evaluation at the end; 0 for none
    #[arg(long, default_value_t = 5000)]
    eval_starts: usize,
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
                last.length = Length::Episodes(n);
            }
        }
        config.check().context("--preset").map_err(input)?;
        Ok(config)
    }
}

/// Trains to the end, with a row of the log for every episode.
fn learn(training: &mut Training, log: &mut csv::Writer<Pending>) -> Result<(), Failure> {
    let bar = progress_bar();
    while let Some(record) = training.episode().map_err(failed)? {
        log.serialize(record).context("--log: cannot be written").map_err(failed)?;
        bar.set_position((BAR * training.share_done()) as u64);
    }
    bar.finish_and_clear();
    Ok(())
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let config = arguments.config()?;
    let isa = arguments.isa.isa()?;
    // Before the training, not after it: whether there is anywhere to write to.
    drop(begin(&arguments.out)?);
    let log_path = arguments.log.clone().unwrap_or_else(|| arguments.out.with_extension("csv"));
    let mut log = csv::Writer::from_writer(begin(&log_path)?);
    let began = Instant::now();
    let mut training = Training::new(config.clone(), arguments.seed, isa);
    let learnt = learn(&mut training, &mut log);
    // Also of a training that diverged: the log is where to look for the reason.
    finish(&log_path, log.into_inner().map_err(|e| failed(e.into_error()))?)?;
    learnt?;
    let took = began.elapsed();
    let (frozen, standing) = training.kept();
    let gains = if config.gains.is_empty() {
        crate::evaluate::gains::search(&frozen.actor())
    } else {
        config.gains.clone()
    };
    let bytes = blob(
        &frozen,
        &About {
            name: &config.preset,
            preset: &config.preset,
            seed: arguments.seed,
            steps: standing.map_or(training.total_steps(), |s| s.steps),
            density_ratio: config.density_range(),
            config: &config.to_toml(),
            gains: &gains,
        },
    )
    .map_err(failed)?;
    write_file(&arguments.out, bytes.as_slice())?;
    let policy = Policy::parse(bytes.as_slice()).map_err(failed)?;
    let (steps, seconds) = (training.total_steps(), took.as_secs_f64());
    print(&format!(
        "{}: {} with seed {}, {steps} steps in {seconds:.1} s ({}), CRC-32 {:08x}",
        arguments.out.display(),
        config.preset,
        arguments.seed,
        isa.name(),
        policy.crc32()
    ))?;
    if let Some(standing) = standing {
        print(&format!(
            "Kept: the actor after {} steps, the best of {} evaluations.",
            standing.steps, config.selection.evaluations
        ))?;
    }
    if arguments.eval_starts > 0 {
        let report = Report::new(&policy, arguments.eval_starts, super::eval::SEED);
        print(&format!("\n{report}"))?;
    }
    Ok(())
}

/// On a terminal only: elsewhere it draws nothing.
fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {elapsed}, {eta} to go")
        .expect("a valid template");
    let bar = ProgressBar::new(BAR as u64).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}
