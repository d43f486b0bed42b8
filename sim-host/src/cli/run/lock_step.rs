//! `sim-host run` in lock-step.

use std::cell::Cell;
use std::path::Path;
use std::process::ExitCode;

use leg_control::wire::Sample;
use leg_control::wire_controller::WireController;
use leg_host::{Role, TimeMode};
use leg_process::Stop;
use leg_process::stdout;

use super::super::recording::Recording;
use super::super::{checked_policy, misuse};
use super::args::Args;
use super::play::{
    controller_config, exit_status, operated, print_summary, warn_of_other_leg, with_controller,
};
use crate::scenario::Scenario;
use crate::session::lock_step::{self, Options};
use crate::session::{Outcome, TickRecord, stepped};

pub(super) fn main(
    scenario: &Scenario,
    args: &Args,
    mut recording: Recording,
) -> anyhow::Result<ExitCode> {
    let played = if args.in_process {
        in_process(scenario, args.policy.as_deref(), &mut recording).map(|played| (played, Ok(())))
    } else {
        two_processes(scenario, args, &mut recording)
    };
    let recorded = recording.finish(played.as_ref().map(|(outcome, _)| outcome));
    let (outcome, controller) = played?;
    if args.json {
        stdout::print_line(serde_json::to_string(&outcome.report())?)?;
    } else {
        print_summary(&outcome)?;
        let us = outcome.round_trips.quantiles_us();
        stdout::print_line(format_args!(
            "{:.0} ticks/s; {} round trip p50 {:.2} us, p99 {:.2} us, p99.9 {:.2} us, max {:.1} us",
            outcome.ticks_per_s(),
            Role::Controller,
            us.p50,
            us.p99,
            us.p99_9,
            us.max
        ))?;
        stdout::print_line(format_args!("state hash {:016x}", outcome.state_hash))?;
    }
    let status = exit_status(&outcome);
    controller?;
    recorded?;
    Ok(status)
}

fn in_process(
    scenario: &Scenario,
    policy: Option<&Path>,
    recording: &mut Recording,
) -> anyhow::Result<Outcome> {
    let blob = checked_policy(policy)?;
    let policy = blob.policy().map_err(misuse)?;
    warn_of_other_leg(&policy, scenario);
    recording.policy(blob.as_slice(), &policy);
    recording.law(scenario.estimator.unwrap_or_default(), scenario.stale_limit_ns, true);
    let mut controller = WireController::new(policy, controller_config(scenario)?);
    let estimate = Cell::new(None);
    let law = |sample: Option<&Sample>| {
        let command = controller.tick(sample);
        estimate.set(controller.estimate());
        command
    };
    let observe = |tick: &TickRecord<'_>| recording.push(tick, estimate.take());
    Ok(stepped::run(scenario, law, Options::default(), observe)?)
}

fn two_processes(
    scenario: &Scenario,
    args: &Args,
    recording: &mut Recording,
) -> anyhow::Result<(Outcome, anyhow::Result<()>)> {
    let stop = Stop::on_signals()?;
    let timeout = args.meeting.timeout();
    let params = scenario.session_params();
    let (outcome, controller) = with_controller(
        scenario,
        args,
        params,
        &stop,
        recording,
        |connected, run_id, recording| {
            let options = Options { run_id, timeout };
            let operated =
                operated(&args.domain(), scenario.rate_hz, TimeMode::LockStep, &stop, None);
            let mut hooks = (recording, operated);
            let mut link = connected.in_lock_step();
            Ok(lock_step::run_with(scenario, &mut link, options, &mut hooks)?)
        },
    )?;
    Ok((outcome, controller.map(|_| ())))
}
