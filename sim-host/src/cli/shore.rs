//! `sim-host` alone: the main job.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use leg_host::TimeMode;
use leg_process::Stop;
use leg_process::stdout;

use super::checked_policy;
use super::recording::Recording;
use crate::scenario::{Scenario, Settings};
use crate::session::TickRecord;
use crate::session::child::ControllerCall;
use crate::session::two_processes::{self, Meeting, new_run_id};
use crate::shore::track::ApexMark;
use crate::shore::{Recorder, picture};
use leg_process::atomic_file::AtomicFile;

/// A line of the journal every so many metres.
const JOURNAL_M: f64 = 5.0;
/// How long either process waits for the other.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Walks the shipped policy out of the sea, over the shore, onto land.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The policy to run [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Where the picture goes.
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
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
    // Now, so that a folder that cannot be written to does not cost a run.
    let (picture, path) = begin_picture(&args.out)?;
    let scenario = Scenario::shore();
    let record = args.record.as_deref();
    let mut recording =
        Recording::begin(record, &Settings::shore(), &scenario, TimeMode::LockStep)?;
    let mut journal = (!args.json).then(|| Journal::begin(&name, &scenario)).transpose()?;
    let mut recorder = Recorder::default();
    let stop = Stop::on_signals()?;
    let meeting = meeting(args, &scenario);
    recording.poll_policies(&meeting.domain, meeting.run_id);
    let outcome = two_processes::play(
        &scenario,
        &meeting,
        &stop,
        |_| (),
        |tick| {
            recording.push(tick);
            let apex = recorder.observe(tick);
            if let Some(journal) = &mut journal {
                journal.tick(tick, apex);
            }
        },
    );
    let outcome = outcome.map_err(anyhow::Error::from);
    let recorded = recording.finish(outcome.as_ref());
    let outcome = outcome?;
    if let Some(journal) = &journal {
        journal.end();
    }

    let report = recorder.report(&outcome, scenario.density.at(outcome.body.x_m));
    draw(picture, &recorder, &scenario).with_context(|| cannot_write(&path))?;
    if args.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(format_args!("\n{report}\n  picture: {}", path.display()))?;
    }
    if report.falls > 0 {
        eprintln!("sim-host: the leg fell at x = {:.2} m", outcome.body.x_m);
        return Ok(ExitCode::FAILURE);
    }
    recorded?;
    Ok(ExitCode::SUCCESS)
}

fn meeting(args: &Args, scenario: &Scenario) -> Meeting {
    // A domain of its own: two runs at once never meet.
    let domain = format!("shore-{}", std::process::id());
    let call = ControllerCall {
        policy: args.policy.clone(),
        rate_hz: scenario.rate_hz,
        gravity_m_s2: scenario.controller_gravity_m_s2(),
        domain: domain.clone(),
        timeout: TIMEOUT,
        real_time: Vec::new(),
    };
    Meeting { domain, timeout: TIMEOUT, start: Some(call), run_id: new_run_id() }
}

/// The picture's file, begun, and its path.
fn begin_picture(folder: &Path) -> anyhow::Result<(AtomicFile, PathBuf)> {
    let path = folder.join("shore.svg");
    if path.exists() && !path.is_file() {
        anyhow::bail!("{}: it is there and is not a file", cannot_write(&path));
    }
    let pending = std::fs::create_dir_all(folder)
        .and_then(|()| AtomicFile::create(&path))
        .with_context(|| cannot_write(&path))?;
    Ok((pending, path))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}; --out chooses another folder", path.display())
}

fn draw(mut file: AtomicFile, recorder: &Recorder, scenario: &Scenario) -> anyhow::Result<()> {
    let svg = picture::draw(recorder.track(), |x_m| scenario.density.at(x_m))
        .map_err(|cause| anyhow::anyhow!("cannot draw the picture: {cause}"))?;
    file.write_all(svg.as_bytes())?;
    file.finish()?;
    Ok(())
}

/// The run as it goes: a bar on a terminal, a line every few metres anywhere.
struct Journal {
    bar: ProgressBar,
    next_m: f64,
}

impl Journal {
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
            self.next_m = (apex.x_m / JOURNAL_M).floor() * JOURNAL_M + JOURNAL_M;
            let ApexMark {
                t_s, x_m, vx_m_s, set_point_m_s, density_ratio, density_estimate, ..
            } = apex;
            let line = format!(
                "  {t_s:>5.1} s  {x_m:>6.2} m  {vx_m_s:>8.3} m/s  {set_point_m_s:>5.1} m/s  {density_ratio:>7.3}  {density_estimate:>9.3}"
            );
            // What cannot be said on the way need not stop the run: the report will say why.
            let _ = self.bar.suspend(|| stdout::print_line(line));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}
