//! Runs the law over a log.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use leg_control::config::ConfigError;
use leg_control::estimator::Estimate;
use leg_control::serial::message::Estimator;
use leg_control::serial::node::SessionParams;
use leg_control::wire::{Command, Header};
use leg_control::wire_controller::WireController;
use leg_process::policy_file::{PolicyFile, PolicyFileError};
use leg_recording::contents::Contents;
use leg_recording::read::ReadError;
use leg_recording::schema::REAL_TIME;

use super::Truth;
use super::assemble::{Assembler, Tick};
use super::log::{self, Kind, Log, LogError};
use super::report::Report;
use super::source::{RecordedTicks, Source, contents};
use crate::law::{LawError, LawSettings};
use crate::recorded::{self, RecordedError, SetPoints, Swap};

/// What the user chose; the rest is that of the log.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// The topic of an MCAP file.
    pub channel: Option<String>,
    /// Ticks a second.
    pub rate_hz: Option<u32>,
    /// Gravity, m/s2.
    pub gravity_m_s2: Option<f32>,
    /// Set-point until the log has one, m/s.
    pub set_point_m_s: f32,
    /// Estimator, its noise, and the stale limit.
    pub law: LawSettings,
    /// The policy.
    pub policy: Option<PathBuf>,
}

/// Why a log cannot be estimated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EstimateError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The law of the recording cannot run.
    #[error(transparent)]
    Recorded(#[from] RecordedError),
    /// The policy cannot run.
    #[error(transparent)]
    Policy(#[from] PolicyFileError),
    /// A setting of the law is out of range.
    #[error(transparent)]
    Law(#[from] LawError),
    /// Rate or gravity are out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The rate of the log is none at which the law runs.
    #[error("{}: its rows are {rate_hz:.3} a second by the median of their times, if these are in seconds; {cause}", path.display())]
    Rate {
        /// The log.
        path: PathBuf,
        /// Rows a second.
        rate_hz: f64,
        /// The limits.
        cause: ConfigError,
    },
    /// The set-point is none that the law accepts.
    #[error("set-point {m_s} m/s: choose one from -{limit_m_s} to {limit_m_s} m/s")]
    SetPoint {
        /// The set-point, m/s.
        m_s: f32,
        /// Largest magnitude, m/s.
        limit_m_s: f32,
    },
    /// The law takes its readings for the state.
    #[error(
        "the law by its readings estimates nothing; choose the estimator `state` or `inertial`"
    )]
    Readings,
    /// No estimator can do with the columns.
    #[error(
        "{}: its columns are enough for no estimator: one needs vx_m_s, y_m and vy_m_s, the other \
         an accelerometer (specific_force_x_m_s2, specific_force_y_m_s2) or the leg's joints \
         (leg_length_m, leg_angle_rad)",
        .0.display()
    )]
    TooFew(PathBuf),
    /// At a tick the recorded controller received a policy that is not in the recording.
    #[error("{}: at tick {tick} the controller received a policy that it does not contain", path.display())]
    UnknownPolicy {
        /// The recording.
        path: PathBuf,
        /// The tick.
        tick: u64,
    },
}

impl From<ReadError> for EstimateError {
    fn from(cause: ReadError) -> Self {
        Self::Log(cause.into())
    }
}

/// What is held after a tick.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Time of the tick since the first, s.
    pub t_s: f64,
    /// Time of the measurement that the estimate is for, s; that of the tick without one.
    pub measured_s: f64,
    /// The estimate; none before it begins, or while it is lost.
    pub estimate: Option<Estimate>,
    /// Apexes that the law has found.
    pub apexes: u32,
    /// The true state at the tick.
    pub truth: Option<Truth>,
}

/// Estimates the state over a log, and shows what is held after each tick that it has to
/// `observe`.
///
/// # Errors
/// [`EstimateError`], or the error of `observe`.
pub fn estimate<E: From<EstimateError>>(
    path: &Path,
    choices: &Choices,
    observe: impl FnMut(&Held) -> Result<(), E>,
) -> Result<Report, E> {
    match log::open(path, choices.channel.as_deref()).map_err(EstimateError::from)? {
        Kind::Rows(log) => of_rows(path, log, choices, observe),
        Kind::Recording => of_recording(path, choices, observe),
    }
}

/// Returns what the law runs with: what was chosen, over what the log says.
fn params(of_log: SessionParams, choices: &Choices) -> Result<SessionParams, EstimateError> {
    let base = LawSettings::of(Some(of_log.estimator), of_log.stale_limit_ns.into());
    let law = choices.law.clone().over(base);
    let estimator = law.estimator()?.unwrap_or_default();
    if estimator == Estimator::Readings {
        return Err(EstimateError::Readings);
    }
    Ok(SessionParams {
        rate_hz: choices.rate_hz.unwrap_or(of_log.rate_hz),
        gravity_m_s2: choices.gravity_m_s2.unwrap_or(of_log.gravity_m_s2),
        stale_limit_ns: u32::try_from(law.stale_limit_ns()?).unwrap_or(u32::MAX),
        estimator,
    })
}

fn of_rows<E: From<EstimateError>>(
    path: &Path,
    log: Log,
    choices: &Choices,
    observe: impl FnMut(&Held) -> Result<(), E>,
) -> Result<Report, E> {
    let prepare = || -> Result<_, EstimateError> {
        let usual = SessionParams::default();
        log.check_time()?;
        let rate_hz = log.rate_hz().unwrap_or(f64::from(usual.rate_hz));
        // The noise may be stated without the estimator's name.
        let kind = choices.law.estimator.or(log.estimator());
        let kind = kind.ok_or_else(|| EstimateError::TooFew(path.to_owned()))?;
        log.check_estimator(kind)?;
        let law = LawSettings { estimator: Some(kind), ..choices.law.clone() };
        let of_log = SessionParams { rate_hz: rate_hz.round() as u32, ..usual };
        let params = params(of_log, &Choices { law, ..choices.clone() })?;
        let config = params.config().map_err(|cause| match cause {
            ConfigError::Rate(_) if choices.rate_hz.is_none() => {
                EstimateError::Rate { path: path.to_owned(), rate_hz, cause }
            }
            cause => cause.into(),
        })?;
        let (m_s, limit_m_s) = (choices.set_point_m_s, config.limits().max_speed_m_s);
        let is_usable = m_s.abs() <= limit_m_s;
        if !is_usable {
            return Err(EstimateError::SetPoint { m_s, limit_m_s });
        }
        let policy = PolicyFile::load(choices.policy.as_deref())?;
        Ok((params, config, policy))
    };
    let (params, config, policy) = prepare()?;
    let policy = policy.policy().map_err(EstimateError::from)?;
    let name = policy.manifest().name.to_owned();
    let assembler = Assembler::new(config.tick_ns(), choices.set_point_m_s);
    let player = Player {
        path,
        source: Source::Log { log, assembler },
        controller: WireController::new(policy, config),
        swaps: VecDeque::new(),
        set_points: SetPoints::default(),
        last: Header::default(),
    };
    player.play(Report::new(path, &params, name), observe)
}

fn of_recording<E: From<EstimateError>>(
    path: &Path,
    choices: &Choices,
    observe: impl FnMut(&Held) -> Result<(), E>,
) -> Result<Report, E> {
    let contents = contents(path).map_err(EstimateError::from)?;
    let blobs = recorded::blobs(&contents);
    let chosen = choices.policy.as_deref().map(PolicyFile::read).transpose();
    let chosen = chosen.map_err(EstimateError::from)?;
    let (player, report) = recorded_player(path, &contents, &blobs, chosen.as_ref(), choices)?;
    player.play(report, observe)
}

fn recorded_player<'a>(
    path: &'a Path,
    contents: &Contents,
    blobs: &'a [leg_process::policy_file::AlignedBytes],
    chosen: Option<&'a PolicyFile>,
    choices: &Choices,
) -> Result<(Player<'a>, Report), EstimateError> {
    let params = params(recorded::session(path, contents)?, choices)?;
    let config = params.config()?;
    let mut swaps = match chosen {
        Some(chosen) => {
            let policy = Some(chosen.policy()?);
            VecDeque::from([Swap { at: contents.first().map_err(LogError::from)?, policy }])
        }
        None => recorded::policies(path, contents, blobs)?,
    };
    let Some(Swap { policy: Some(first), .. }) = swaps.pop_front() else {
        return Err(RecordedError::NoPolicy(path.to_owned()).into());
    };
    let mut report = Report::new(path, &params, first.manifest().name.to_owned());
    report.is_real_time = contents.config()?.time_mode == REAL_TIME;
    let ticks = RecordedTicks::open(contents, config.tick_ns())?;
    let player = Player {
        path,
        source: Source::Recording(Box::new(ticks)),
        controller: WireController::new(first, config),
        swaps,
        set_points: SetPoints::of(&contents.set_points),
        last: Header::default(),
    };
    Ok((player, report))
}

/// The law, and what comes to it.
struct Player<'a> {
    path: &'a Path,
    source: Source,
    controller: WireController<'a>,
    swaps: VecDeque<Swap<'a>>,
    set_points: SetPoints,
    /// Header of the last sample.
    last: Header,
}

impl Player<'_> {
    fn play<E: From<EstimateError>>(
        mut self,
        mut report: Report,
        mut observe: impl FnMut(&Held) -> Result<(), E>,
    ) -> Result<Report, E> {
        while let Some(tick) = self.source.next_tick().map_err(EstimateError::from)? {
            let command = self.tick(&tick)?;
            let estimate = self.controller.estimate();
            let of_run = |ns: u64| 1e-9 * tick.run_begins_ns.saturating_add(ns) as f64;
            let t_s = 1e-9 * tick.t_ns as f64;
            let held = Held {
                t_s,
                measured_s: estimate.map_or(t_s, |estimate| of_run(estimate.t_ns)),
                estimate,
                apexes: command.apexes,
                truth: tick.truth,
            };
            report.add(&held, tick.empty_before, tick.recorded.as_ref(), command.header.seq);
            observe(&held)?;
        }
        report.finish(self.controller.counts(), self.source.warnings());
        Ok(report)
    }

    /// Runs the law for a tick, and for those without a sample before it.
    fn tick(&mut self, tick: &Tick) -> Result<Command, EstimateError> {
        let Self { path, controller, swaps, set_points, last, .. } = self;
        if let Some(sample) = &tick.sample {
            let now = (sample.header.run_id, sample.header.seq);
            while let Some(swap) = swaps.pop_front_if(|swap| swap.at <= now) {
                let unknown =
                    EstimateError::UnknownPolicy { path: path.to_path_buf(), tick: swap.at.1 };
                controller.swap(swap.policy.ok_or(unknown)?);
            }
        }
        for _ in 0..tick.empty_before {
            set_points.tick(controller, None, last);
        }
        if let (Some(acted), Some(sample)) = (&tick.acted, &tick.sample) {
            controller.follow_acted(sample.header.t_ns, acted);
        }
        let command = set_points.tick(controller, tick.sample.as_ref(), last);
        *last = tick.sample.map_or(*last, |sample| sample.header);
        Ok(command)
    }
}
