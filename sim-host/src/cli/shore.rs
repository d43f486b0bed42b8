//! `sim-host` without a subcommand: the demonstration.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use leg_host::TimeMode;
use leg_process::stdout;
use leg_process::{Stop, rounded, stderr};

use super::recording::Recording;
use super::{checked_policy, misuse, unwritable};
use crate::scenario::{Scenario, Settings};
use crate::session::TickRecord;
use crate::session::child::ControllerArgs;
use crate::session::hooks::Observe;
use crate::session::two_processes::{self, ConnectOptions, new_run_id};
use crate::shore::track::ApexMark;
use crate::shore::{TrackRecorder, picture};
use leg_process::atomic_file::AtomicFile;

/// Distance between two lines of progress, m.
const PROGRESS_M: f64 = 5.0;
/// Longest wait of either process for the other.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Runs the shipped policy from water over the shore onto land.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Policy file [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Directory for the picture, shore.svg [default: out].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Record every tick to an MCAP file, for `replay`, `plot` and other programs.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let policy = checked_policy(args.policy.as_deref())?;
    let name = policy.policy()?.manifest().name.to_owned();
    // Opened before the run, so that an unwritable directory is reported at once if the caller
    // has named it. Without, the run and its table come first.
    let path = args.out.as_deref().unwrap_or(Path::new("out")).join("shore.svg");
    let picture = match (begin_picture(&path), &args.out) {
        (Err(error), Some(_)) => return Err(error),
        // A folder that the caller has not named is none of the caller's mistakes.
        (Err(error), None) => Err(anyhow::anyhow!("{error:#}")),
        (picture, _) => picture,
    };
    let scenario = Scenario::shore();
    let record = args.record.as_deref();
    let mut recording =
        Recording::begin(record, &Settings::shore(), &scenario, TimeMode::LockStep)?;
    let mut progress = (!args.json).then(|| Progress::begin(&name, &scenario)).transpose()?;
    let mut recorder = TrackRecorder::default();
    let stop = Stop::on_signals()?;
    let connect = connect_options(args, &scenario);
    recording.poll_changes(&connect.domain, connect.run_id);
    let outcome = two_processes::run_lock_step(
        &scenario,
        &connect,
        &stop,
        |_| (),
        &mut (
            &mut recording,
            Observe(|tick: &TickRecord| {
                let apex = recorder.observe(tick);
                if let Some(progress) = &mut progress {
                    progress.tick(tick, apex);
                }
            }),
        ),
    );
    let outcome = outcome.map_err(anyhow::Error::from);
    let recorded = recording.finish(outcome.as_ref());
    let outcome = outcome?;
    if let Some(progress) = &progress {
        progress.end();
    }

    let report = recorder.report(&outcome, scenario.density.at(outcome.body.x_m));
    let drawn = picture.and_then(|picture| {
        draw(picture, &recorder, &scenario).with_context(|| cannot_write(&path))
    });
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(format_args!("\n{report}"))?;
        if drawn.is_ok() {
            stdout::print_line(format_args!("  picture: {}", path.display()))?;
        }
    }
    if report.falls > 0 {
        let x_m = rounded(outcome.body.x_m, 2);
        stderr::print_line(format_args!("sim-host: the leg fell at x = {x_m:.2} m"));
    }
    recorded?;
    drawn?;
    Ok(if report.falls > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn connect_options(args: &Args, scenario: &Scenario) -> ConnectOptions {
    // A domain per process, so that runs at the same time do not connect to each other.
    let domain = format!("shore-{}", std::process::id());
    let controller = ControllerArgs {
        policy: args.policy.clone(),
        rate_hz: scenario.rate_hz,
        gravity_m_s2: scenario.controller_gravity_m_s2(),
        domain: domain.clone(),
        law: scenario.law_arguments(),
        real_time: Vec::new(),
    };
    ConnectOptions { domain, timeout: TIMEOUT, start: Some(controller), run_id: new_run_id() }
}

/// Opens the picture's file and, if necessary, creates its folder.
fn begin_picture(path: &Path) -> anyhow::Result<AtomicFile> {
    if path.exists() && !path.is_file() {
        return Err(misuse(format!("{}: it exists and is not a file", cannot_write(path))));
    }
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| AtomicFile::create(path))
        .map_err(|error| unwritable(error, cannot_write(path)))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}; --out chooses another folder", path.display())
}

fn draw(mut file: AtomicFile, recorder: &TrackRecorder, scenario: &Scenario) -> anyhow::Result<()> {
    let svg = picture::draw(recorder.track(), |x_m| scenario.density.at(x_m))
        .map_err(|cause| anyhow::anyhow!("cannot draw the picture: {cause}"))?;
    file.write_all(svg.as_bytes())?;
    file.finish()?;
    Ok(())
}

/// Prints the progress of the run: a bar on a terminal, and a line every few metres.
struct Progress {
    bar: ProgressBar,
    next_m: f64,
}

impl Progress {
    fn begin(policy: &str, scenario: &Scenario) -> io::Result<Self> {
        stdout::print_line(format_args!(
            "Out of the sea: policy `{policy}`, {} Hz, lock-step, two processes",
            scenario.rate_hz
        ))?;
        stdout::print_line(format_args!(
            "\n  {:>7}  {:>8}  {:>12}  {:>9}  {:>7}  {:>9}",
            "time", "distance", "apex velocity", "set-point", "density", "estimated"
        ))?;
        let bar = if std::io::stderr().is_terminal() {
            let length_m = scenario.distance_m.unwrap_or(scenario.duration_s);
            ProgressBar::new((1e3 * length_m) as u64)
        } else {
            ProgressBar::hidden()
        };
        let style = ProgressStyle::with_template("  {wide_bar} {msg} ETA {eta}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Ok(Self { bar, next_m: 0.0 })
    }

    fn tick(&mut self, tick: &TickRecord<'_>, apex: Option<ApexMark>) {
        let Some(apex) = apex else { return };
        self.bar.set_position((1e3 * tick.body.x_m.max(0.0)) as u64);
        self.bar.set_message(format!("{:.1} m, {:.2} m/s", apex.x_m, apex.vx_m_s));
        if apex.x_m >= self.next_m {
            self.next_m = (apex.x_m / PROGRESS_M).floor() * PROGRESS_M + PROGRESS_M;
            let ApexMark {
                t_s, x_m, vx_m_s, set_point_m_s, density_ratio, density_estimate, ..
            } = apex;
            let (x_m, vx_m_s) = (rounded(x_m, 2), rounded(vx_m_s, 3));
            let line = format!(
                "  {t_s:>5.1} s  {x_m:>6.2} m  {vx_m_s:>8.3} m/s  {set_point_m_s:>5.1} m/s  {density_ratio:>7.3}  {density_estimate:>9.3}"
            );
            // A failure to print does not stop the run; the final report will fail with the reason.
            let _ = self.bar.suspend(|| stdout::print_line(line));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}
