//! `sim-host run`.

mod args;
mod lock_step;
mod play;
mod real_time;

use std::process::ExitCode;

use leg_host::TimeMode;

use super::misuse;
use super::recording::Recording;
use crate::scenario;

pub(super) use args::Args;

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let (scenario, settings) =
        scenario::load_with_settings(args.scenario.as_deref(), args.settings.clone())
            .map_err(misuse)?;
    if args.policy.is_some() && !args.spawn && !args.in_process {
        return Err(misuse(
            "--policy needs --spawn or --in-process; a controller that you start yourself takes \
             its own --policy",
        ));
    }
    let time_mode = if args.real_time.is_on() { TimeMode::RealTime } else { TimeMode::LockStep };
    let recording = Recording::begin(args.record.as_deref(), &settings, &scenario, time_mode)?;
    match time_mode {
        TimeMode::LockStep => lock_step::main(&scenario, args, recording),
        TimeMode::RealTime => real_time::main(&scenario, args, recording),
    }
}
