//! The command `trainer study`.

use super::config::ConfigArguments;
use super::eval::{MOST_STARTS, SEED};
use super::output::print;
use super::{Failure, failed, input};
use crate::config::{Config, Length};
use crate::run::tensorboard::EventWriter;
use crate::study::folder::{Folder, SeedReport};
use crate::study::plan::{Plan, Seeds};
use crate::study::run::{Jobs, SeedEvent};
use crate::study::shard::{Request, Shard};
use crate::study::summary::Summary;
use crate::study::{StudyError, list, merge, picture};
use crate::threads::redraw;
use anyhow::{Context, anyhow};
use clap::{Args, Subcommand};
use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use leg_process::{Stop, remedy, stderr};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// Steps of the progress bar for each seed.
const BAR: f64 = 1000.0;
/// Largest number of seeds in parallel.
const MOST_JOBS: i64 = 1024;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    // Not within `Study`: clap does not nest an optional group in another.
    #[command(flatten)]
    choice: ConfigArguments,
    #[command(flatten)]
    study: Option<Study>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Merge the folders of shards and write the summary, as one machine would have
    Merge(Merge),
}

#[derive(Debug, Args)]
struct Merge {
    /// Folders of the study's shards
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Folder for the merged study; it may be one of the shards
    #[arg(long)]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct Study {
    /// Range of seeds, from the first to before the last, such as 0..20
    #[arg(long)]
    seeds: Seeds,
    /// Folder of the study; an existing study is continued
    #[arg(long)]
    out: PathBuf,
    /// Number of seeds to train in parallel, each on one thread
    #[arg(long, default_value = "1", value_parser = clap::value_parser!(u16).range(1..=MOST_JOBS))]
    jobs: u16,
    /// Train the seeds of one shard only: I/N is the I-th of N; auto takes the shard from a
    /// Slurm job array, auto/N from an indexed job of Kubernetes with N completions
    #[arg(long, value_name = "I/N|auto|auto/N")]
    shard: Option<Request>,
    /// Folder for TensorBoard event files, one folder a seed
    #[arg(long, value_name = "DIR")]
    tensorboard: Option<PathBuf>,
    /// Length of the last stage in environment steps, instead of the configuration's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Number of random starts of an evaluation, at each density ratio and in each condition
    #[arg(
        long,
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(1..=MOST_STARTS)
    )]
    eval_starts: u32,
}

impl Study {
    fn config(&self, choice: &ConfigArguments) -> Result<Config, Failure> {
        let mut config = choice.config(None)?;
        if let (Some(n), Some(last)) = (self.steps, config.stages.last_mut()) {
            last.length = Length::Steps(n);
        }
        let options = choice.options();
        config.check().map_err(|e| input(anyhow!("{options}: {e}")))?;
        Ok(config)
    }

    fn shard(&self) -> Result<Shard, Failure> {
        let request = self.shard.unwrap_or(Request::Named(Shard::ALL));
        // A value that is not Unicode is not a number either.
        let variable =
            |name: &str| std::env::var_os(name).map(|v| v.to_string_lossy().into_owned());
        request.resolve(variable).context("--shard").map_err(input)
    }

    fn run(&self, choice: &ConfigArguments) -> Result<(), Failure> {
        // Before any file exists, so that a signal leaves none unfinished.
        let stop = Stop::on_signals().context("signals").map_err(failed)?;
        let shard = self.shard()?;
        let plan = Plan::new(self.config(choice)?, self.seeds, self.eval_starts, SEED);
        let board = self.tensorboard.as_deref();
        if let Some(folder) = board {
            EventWriter::check(folder).map_err(|error| refused_out(error.into()))?;
        }
        let folder = Folder::begin(&self.out, plan).map_err(refused_out)?;
        let mut missing = Vec::new();
        for seed in shard.of(self.seeds) {
            if folder.report(seed).map_err(refused)?.is_none() {
                missing.push(seed);
            }
        }
        let all = shard.of(self.seeds).count();
        if missing.len() < all {
            stderr::print_line(format_args!(
                "{} of {all} seeds are already complete.",
                all - missing.len()
            ));
        }
        if !missing.is_empty() {
            let jobs = NonZeroUsize::new(usize::from(self.jobs)).unwrap_or(NonZeroUsize::MIN);
            train(&folder, missing, jobs, board, &stop)?;
        }
        let (reports, missing) = folder.reports().map_err(refused)?;
        if missing.is_empty() {
            return summarise(&folder, reports);
        }
        print(&format!(
            "Shard {shard} is done: {all} seeds. Of the study's {}, {} are not in {} yet ({}); \
             join the shards by: trainer study merge FOLDER... --out FOLDER",
            self.seeds.count(),
            missing.len(),
            self.out.display(),
            list(&missing)
        ))
    }
}

/// Returns the failure of an error, which determines the exit status.
fn refused(error: StudyError) -> Failure {
    match error {
        StudyError::File { .. } | StudyError::Busy { .. } | StudyError::Events(_) => failed(error),
        _ => input(error),
    }
}

/// Returns the failure of an error before anything is done. A path that cannot be that of a
/// folder is bad input.
fn refused_out(error: StudyError) -> Failure {
    match error {
        StudyError::File { error: ref cause, .. } if remedy::is_wrong_path(cause) => input(error),
        StudyError::Events(ref cause) if cause.is_wrong_path() => {
            input(anyhow!("{error}; name another folder with --tensorboard"))
        }
        _ => refused(error),
    }
}

/// Trains and evaluates seeds, and saves their results.
fn train(
    folder: &Folder,
    seeds: Vec<u64>,
    jobs: NonZeroUsize,
    board: Option<&Path>,
    stop: &Stop,
) -> Result<(), Failure> {
    let (all, began) = (seeds.len(), Instant::now());
    let bar = progress_bar(all);
    let cannot = |e| failed(anyhow!("no job can be started: {e}; {}", remedy::OF_THREAD));
    let work = Jobs::start(folder, seeds, jobs, board).map_err(cannot)?;
    let wanted = jobs.get().min(all);
    if work.threads < wanted {
        let count = work.threads;
        stderr::print_line(format_args!(
            "{count} instead of {wanted} jobs can run; {}",
            remedy::OF_THREAD
        ));
    }
    let mut done = 0;
    while done < all && !stop.is_raised() {
        match work.events.recv_timeout(Duration::from_millis(100)) {
            Ok(SeedEvent::Trained(run, claim)) => {
                // Saved here and not on the job's thread, which a signal may end at any time.
                let report = folder.save(&run, &claim).map_err(refused)?;
                drop(claim);
                done += 1;
                let to_go = began.elapsed().mul_f64((all - done) as f64 / done as f64);
                let line = seed_line(&report);
                bar.suspend(|| {
                    stderr::print_line(format_args!(
                        "{line}  [{done} of {all}, {} to go]",
                        HumanDuration(to_go)
                    ));
                });
            }
            Ok(SeedEvent::Elsewhere(seed)) => {
                done += 1;
                bar.suspend(|| {
                    stderr::print_line(format_args!("seed {seed}: another process trained it"));
                });
            }
            Ok(SeedEvent::Waiting(seed)) => bar.suspend(|| {
                stderr::print_line(format_args!(
                    "waiting for other processes, which train the rest, such as seed {seed}"
                ));
            }),
            Ok(SeedEvent::Failed(error)) => return Err(refused(error)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(failed(anyhow!("a job ended early; the same command continues")));
            }
        }
        bar.set_message(format!("{done} of {all} seeds"));
        bar.set_position((BAR * (done as f64 + work.share_under_way())) as u64);
    }
    bar.finish_and_clear();
    if done < all {
        return Err(failed(anyhow!(
            "stopped by a signal after {done} of {all} seeds; the same command continues"
        )));
    }
    Ok(())
}

/// Formats a seed's result as one line.
fn seed_line(report: &SeedReport) -> String {
    use crate::evaluate::DENSITIES;
    use crate::evaluate::goals::robust;
    use crate::evaluate::metric::Metric;
    let seed = report.seed;
    if let Some(why) = &report.failure {
        return format!("seed {seed}: no policy: {why}");
    }
    let survive = DENSITIES.map(|rho| (report.metric(Metric::Survive30(rho)).unwrap_or(0.0), rho));
    let (lowest, rho) = survive.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    let metric = |metric| report.metric(metric).unwrap_or(0.0);
    let goals = robust();
    let reached = goals.iter().filter(|goal| goal.reached(report.metric(goal.metric))).count();
    format!(
        "seed {seed}: survive30 {lowest:.4} at worst, at rho {rho}; tracks {} of 42; {:.1} m/s on \
         land; {reached} of {} goals",
        metric(Metric::Tracked),
        metric(Metric::MaxSpeed(0.0)),
        goals.len()
    )
}

/// Writes and prints the summary.
fn summarise(folder: &Folder, reports: Vec<SeedReport>) -> Result<(), Failure> {
    let summary = Summary::new(folder.plan().clone(), reports);
    let svg =
        picture::draw(&summary).map_err(|e| failed(anyhow!("cannot draw summary.svg: {e}")))?;
    summary.write(folder, &svg).map_err(refused)?;
    let at = folder.path().display();
    print(&format!("{summary}\n\n{at}: summary.csv, seeds.csv, summary.svg"))
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    match (&arguments.command, &arguments.study) {
        (Some(Command::Merge(Merge { folders, out })), _) => {
            let merged = merge::merge(folders, out).map_err(refused)?;
            if !merged.duplicates.is_empty() {
                let seeds = list(&merged.duplicates);
                stderr::print_line(format_args!(
                    "These seeds are in more than one folder, with the same results: {seeds}."
                ));
            }
            let (reports, _) = merged.folder.reports().map_err(refused)?;
            summarise(&merged.folder, reports)
        }
        (None, Some(study)) => study.run(&arguments.choice),
        (None, None) => Err(input(anyhow!("--preset (or --config), --seeds and --out are needed"))),
    }
}

/// Creates the progress bar. It draws nothing where there is no terminal.
fn progress_bar(seeds: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {msg}  {elapsed}, {eta} to go")
        .expect("a valid template");
    let bar = ProgressBar::new((BAR * seeds as f64) as u64).with_style(style);
    redraw(&bar, Duration::from_millis(500));
    bar
}
