//! `sim-host` without a subcommand: the demonstration.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::ValueEnum as _;
use indicatif::{ProgressBar, ProgressStyle};
use leg_control::serial::message::Estimator;
use leg_host::TimeMode;
use leg_process::stdout;
use leg_process::{Stop, rounded, stderr};

use super::recording::{RecordArgs, Recording};
use super::{checked_policy, misuse, unwritable};
use crate::scenario::{Scenario, Settings};
use crate::sensors::SensorProfile;
use crate::session::child::ControllerArgs;
use crate::session::replica::ControllerReplica;
use crate::session::two_processes::{self, ConnectOptions, new_run_id};
use crate::session::{Hooks, TickRecord};
use crate::shore::track::ApexMark;
use crate::shore::{TrackRecorder, picture};
use leg_process::atomic_file::AtomicFile;

/// Distance between two lines of progress, m.
const PROGRESS_M: f64 = 5.0;
/// Longest wait of either process for the other.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Runs the shipped policy from water over the shore onto land.
///
/// With the sensors `imu` neither velocity nor height nor density is sensed: the controller
/// estimates them from accelerometer, encoders of the leg and contact, and the picture shows the
/// estimates beside the truth.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Policy file [default: the shipped policy].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Sensors of the leg by name of their profile; the controller takes the estimator for them.
    #[arg(long, value_name = "PROFILE", default_value = "imu")]
    sensors: SensorProfile,
    /// Directory for the picture, shore.svg [default: out].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    recording: RecordArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let blob = checked_policy(args.policy.as_deref())?;
    let policy = blob.policy()?;
    let name = policy.manifest().name.to_owned();
    // Opened before the run, so that an unwritable directory is reported at once if the caller
    // has named it. Without, the run and its table come first.
    let path = args.out.as_deref().unwrap_or(Path::new("out")).join("shore.svg");
    let picture = match (begin_picture(&path), &args.out) {
        (Err(error), Some(_)) => return Err(error),
        // A folder that the caller has not named is none of the caller's mistakes.
        (Err(error), None) => Err(anyhow::anyhow!("{error:#}")),
        (picture, _) => picture,
    };
    let settings = Settings { sensors: Some(args.sensors), ..Settings::shore() };
    let scenario = Scenario::from_settings(&settings).map_err(misuse)?;
    let estimator = scenario.estimator.unwrap_or_default();
    let other = args.policy.iter().chain([&path]).map(PathBuf::as_path);
    let mut recording =
        Recording::begin(&args.recording, other, &settings, &scenario, TimeMode::LockStep)?;
    recording.law(estimator, scenario.stale_limit_ns, true);
    let mut progress = (!args.json).then(|| Progress::begin(&name, args, &scenario)).transpose()?;
    let mut recorder = TrackRecorder::default();
    let replica = |config| ControllerReplica::new(policy.clone(), config);
    let mut replica = (estimator != Estimator::Readings)
        .then(|| scenario.controller_config().map(replica))
        .transpose()
        .map_err(misuse)?;
    let stop = Stop::on_signals()?;
    let connect = connect_options(args, &scenario);
    recording.poll_changes(&connect.domain, connect.run_id);
    let outcome = two_processes::run_lock_step(
        &scenario,
        &connect,
        &stop,
        |_| (),
        &mut Observers {
            recording: &mut recording,
            replica: replica.as_mut(),
            recorder: &mut recorder,
            progress: progress.as_mut(),
        },
    );
    let outcome = outcome.map_err(anyhow::Error::from);
    let recorded = recording.finish(outcome.as_ref());
    let outcome = outcome?;
    if let Some(progress) = &progress {
        progress.end();
    }

    let end_rho = scenario.density.at(outcome.body.x_m);
    let report = recorder.report(&outcome, args.sensors, end_rho);
    let drawn = picture.and_then(|picture| {
        draw(picture, &recorder, args.sensors, &scenario).with_context(|| cannot_write(&path))
    });
    if let Some(tick) = replica.and_then(|replica| replica.differs_at()) {
        stderr::print_line(format_args!(
            "sim-host: warning: from tick {tick} on the controller had another policy or \
             set-point than this run began with; its estimates from there on are not known"
        ));
    }
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

fn draw(
    mut file: AtomicFile,
    recorder: &TrackRecorder,
    sensors: SensorProfile,
    scenario: &Scenario,
) -> anyhow::Result<()> {
    let note = match sensors {
        SensorProfile::Ideal => {
            "The leg senses its velocity and height; the controller \
                                 estimates the density from its falls."
        }
        SensorProfile::TrainedWith => {
            "The readings of velocity and height are noisy and late; \
                                       the controller estimates them and the density."
        }
        SensorProfile::Imu => {
            "The leg has an accelerometer, encoders and a contact switch; the \
                               controller estimates velocity, height and density from them."
        }
        SensorProfile::Underwater => {
            "The leg has an accelerometer, encoders, a contact switch, \
                                      and in water a Doppler log and a pressure gauge; the \
                                      controller estimates velocity, height and density from \
                                      them."
        }
    };
    let svg = picture::draw(recorder, note, |x_m| scenario.density.at(x_m))
        .map_err(|cause| anyhow::anyhow!("cannot draw the picture: {cause}"))?;
    file.write_all(svg.as_bytes())?;
    file.finish()?;
    Ok(())
}

/// What observes each tick.
struct Observers<'a, 'p> {
    recording: &'a mut Recording,
    /// None where the controller takes its readings for the state.
    replica: Option<&'a mut ControllerReplica<'p>>,
    recorder: &'a mut TrackRecorder,
    progress: Option<&'a mut Progress>,
}

impl Hooks for Observers<'_, '_> {
    fn observe(&mut self, tick: &TickRecord<'_>) {
        let estimate = self.replica.as_mut().and_then(|replica| replica.tick(tick));
        self.recording.push(tick, estimate);
        let apex = self.recorder.observe(tick, estimate);
        if let Some(progress) = &mut self.progress {
            progress.tick(tick, apex);
        }
    }

    fn before_end(&mut self) {
        self.recording.before_end();
    }
}

/// Prints the progress of the run: a bar on a terminal, and a line every few metres.
struct Progress {
    bar: ProgressBar,
    next_m: f64,
}

impl Progress {
    fn begin(policy: &str, args: &Args, scenario: &Scenario) -> io::Result<Self> {
        let sensors = args.sensors.to_possible_value();
        stdout::print_line(format_args!(
            "Out of the sea: policy `{policy}`, sensors `{}`, {} Hz, lock-step, two processes",
            sensors.as_ref().map_or("", |value| value.get_name()),
            scenario.rate_hz
        ))?;
        stdout::print_line(format_args!(
            "What the controller knew of an apex when it decided, beside the truth:\n\n  \
             {:>7}  {:>8}   {:>25}   {:>16}   {:>17}\n  \
             {:>7}  {:>8}   {:>7}{:>9}{:>9}   {:>7}{:>9}   {:>8}{:>9}",
            "time",
            "distance",
            "velocity, m/s",
            "height, m",
            "density ratio",
            "s",
            "m",
            "wanted",
            "true",
            "known",
            "true",
            "known",
            "true",
            "known"
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
            let ApexMark { t_s, x_m, y_m, vx_m_s, set_point_m_s, density_ratio, decision } = apex;
            let Some(decision) = decision else { return };
            let line = format!(
                "  {t_s:>7.1}  {:>8.2}   {set_point_m_s:>7.1}{:>9.3}{:>9.3}   {y_m:>7.3}{:>9.3}   \
                 {density_ratio:>8.3}{:>9.3}",
                rounded(x_m, 2),
                rounded(vx_m_s, 3),
                rounded(decision.vx_m_s, 3),
                decision.y_m,
                rounded(decision.density_ratio, 3),
            );
            // A failure to print does not stop the run; the final report will fail with the reason.
            let _ = self.bar.suspend(|| stdout::print_line(line));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}
