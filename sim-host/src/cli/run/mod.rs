//! `sim-host run`.

mod args;
mod lock_step;
mod play;
mod real_time;

use std::path::PathBuf;
use std::process::ExitCode;

use leg_host::TimeMode;

use super::misuse;
use super::recording::Recording;
use crate::scenario::{self, ScenarioError};

pub(super) use args::Args;

/// Returns the message of an error of the scenario, with the option of a value that was given so.
fn in_options(error: &ScenarioError) -> String {
    let option = match error {
        ScenarioError::Value { origin: None, cause } => match cause.key {
            "rate_hz" => Some("--rate"),
            "gravity_m_s2" => Some("--gravity"),
            "set_point_m_s" => Some("--set-point"),
            "density_ratio" => Some("--density-ratio"),
            "duration_s" => Some("--duration"),
            "distance_m" => Some("--distance"),
            "start.x_m" => Some("--start-x"),
            "start.y_m" => Some("--start-y"),
            "start.vx_m_s" => Some("--start-vx"),
            "start.vy_m_s" => Some("--start-vy"),
            "start.y_spread_m" => Some("--start-y-spread"),
            "start.vx_spread_m_s" => Some("--start-vx-spread"),
            "fault" => Some("--fault"),
            "sensor" => Some("--sensor"),
            scenario::NOISE => Some("--estimator-noise"),
            scenario::STALE_LIMIT_MS => Some("--stale-limit"),
            _ => None,
        },
        _ => None,
    };
    option.map_or_else(|| error.to_string(), |option| format!("{option}: {error}"))
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let (scenario, settings) =
        scenario::load_with_settings(args.scenario.as_deref(), args.settings.clone())
            .map_err(|error| misuse(in_options(&error)))?;
    if args.in_process && args.meeting.domain.domain.is_some() {
        return Err(misuse(
            "--domain has no effect with --in-process, which uses no shared memory",
        ));
    }
    if args.policy.is_some() && !args.spawn && !args.in_process {
        return Err(misuse(
            "--policy needs --spawn or --in-process; a controller that you start yourself takes \
             its own --policy",
        ));
    }
    let time_mode = if args.real_time.is_on() { TimeMode::RealTime } else { TimeMode::LockStep };
    let inputs = args.scenario.iter().chain(&args.policy).map(PathBuf::as_path);
    let recording = Recording::begin(&args.recording, inputs, &settings, &scenario, time_mode)?;
    match time_mode {
        TimeMode::LockStep => lock_step::main(&scenario, args, recording),
        TimeMode::RealTime => real_time::main(&scenario, args, recording),
    }
}
