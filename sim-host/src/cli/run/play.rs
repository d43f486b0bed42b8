//! What runs in lock-step and in real time have in common.

use std::io;
use std::process::ExitCode;

use leg_control::config::Config;
use leg_control::policy::Policy;
use leg_host::cli::{REPORT_AFTER, hint, other_leg};
use leg_host::discovery::DomainError;
use leg_host::law::Channels;
use leg_host::realtime::{LatestReport, LoopReport};
use leg_host::reconnect::LinkEvent;
use leg_host::shm::ConnectError;
use leg_host::{SessionParams, TimeMode};
use leg_process::stdout;
use leg_process::{Stop, rounded, stderr};

use super::super::recording::Recording;
use super::super::{checked_policy, misuse};
use super::args::Args;
use crate::operate::Operated;
use crate::scenario::Scenario;
use crate::session::child::ControllerArgs;
use crate::session::two_processes::{
    ConnectOptions, Connected, PlayError, SessionEvent, connect_and_run, new_run_id,
};
use crate::session::{Ending, Outcome};

/// Returns the configuration of a scenario's controller.
pub(super) fn controller_config(scenario: &Scenario) -> anyhow::Result<Config> {
    let (senses, needs) =
        (scenario.channels(), Channels::needed_by(scenario.estimator.unwrap_or_default()));
    if !senses.include(needs) {
        return Err(misuse(format!(
            "the estimator of the controller needs {needs}, but the leg senses {senses}; choose \
             an --estimator that needs no more, or --sensors that have them"
        )));
    }
    scenario.controller_config().map_err(misuse)
}

/// Warns if the policy of a controller in this process was trained for another leg.
pub(super) fn warn_of_other_leg(policy: &Policy<'_>, scenario: &Scenario) {
    let leg = scenario.leg_model().fingerprint();
    if let Some(warning) = other_leg(policy.manifest(), Some(leg)) {
        stderr::print_line(format_args!("sim-host: {warning}"));
    }
}

/// Opens the control socket of a run. If that fails, warns and the run continues
/// without it.
pub(super) fn operated(
    domain: &str,
    rate_hz: u32,
    time_mode: TimeMode,
    stop: &Stop,
    timing: Option<LatestReport>,
) -> Option<Operated> {
    Operated::open(domain, rate_hz, time_mode, stop, timing)
        .inspect_err(|error| {
            stderr::print_line(format_args!(
                "sim-host: warning: this run cannot be operated from `watch`: {error}"
            ));
        })
        .ok()
}

/// Connects to a controller process, which `--spawn` starts, and calls `run` with
/// the run's id. Returns its result and how a started controller ended: in real time with
/// the report of its loop.
pub(super) fn with_controller<R>(
    scenario: &Scenario,
    args: &Args,
    params: SessionParams,
    stop: &Stop,
    recording: &mut Recording,
    run: impl FnOnce(Connected<'_>, u32, &mut Recording) -> Result<R, PlayError>,
) -> anyhow::Result<(R, anyhow::Result<Option<LoopReport>>)> {
    let domain = args.domain();
    if args.spawn {
        checked_policy(args.policy.as_deref())?;
    }
    let timeout = args.meeting.timeout();
    let start = args.spawn.then(|| ControllerArgs {
        policy: args.policy.clone(),
        rate_hz: scenario.rate_hz,
        gravity_m_s2: scenario.controller_gravity_m_s2(),
        domain: domain.clone(),
        law: scenario.law_arguments(),
        real_time: args.real_time.controller_arguments(),
    });
    let run_id = new_run_id();
    recording.poll_changes(&domain, run_id);
    let connect = ConnectOptions { domain, timeout, start, run_id };
    let on_event = printer(args.spawn);
    let run = |connected: Connected<'_>| {
        // A controller that does not say what it takes for the state gets no such message.
        if let Some(estimator) = connected.link.peer().and_then(|peer| peer.estimator) {
            recording.law(estimator, scenario.stale_limit_ns, false);
        }
        run(connected, run_id, recording)
    };
    let (result, controller) =
        connect_and_run(params, &connect, stop, on_event, run).map_err(mark_misuse)?;
    Ok((result, controller.map_err(mark_misuse)))
}

/// Returns a callback that prints the events of a connection. The loss of a
/// controller started here ends the run, so that error reports it.
fn printer(spawned: bool) -> impl FnMut(SessionEvent<'_>) {
    let mut printed = false;
    let mut failure = None;
    move |event| match event {
        SessionEvent::Missing(missing) => {
            if missing.failure != failure {
                failure.clone_from(&missing.failure);
                stderr::print_line(format_args!("sim-host: {missing}; still waiting"));
            }
            if !(printed || spawned) && missing.waited >= REPORT_AFTER {
                printed = true;
                stderr::print_line(format_args!(
                    "sim-host: {missing}; {}; still waiting",
                    hint::missing_peer(missing)
                ));
            }
        }
        SessionEvent::Peer(LinkEvent::Lost { .. }) if spawned => (),
        SessionEvent::Peer(event) => {
            stderr::print_line(format_args!("sim-host: {}", hint::link_event(event)));
        }
    }
}

/// Marks errors that the caller can correct.
fn mark_misuse(error: PlayError) -> anyhow::Error {
    match &error {
        PlayError::Connect(ConnectError::Domain(DomainError::Name(_))) => misuse(error),
        PlayError::Controller(status) if status.code() == Some(2) => misuse(error),
        _ => error.into(),
    }
}

/// Prints the first lines of the result, as text.
pub(super) fn print_summary(outcome: &Outcome) -> io::Result<()> {
    let report = outcome.report();
    let ending = match outcome.ending {
        Ending::Duration => "time over",
        Ending::Distance => "distance reached",
        Ending::Fall => "fell",
        Ending::Stopped => "stopped",
    };
    stdout::print_line(format_args!(
        "{ending} after {:.3} s ({} ticks), {:.3} m",
        report.sim_time_s,
        report.ticks,
        rounded(report.distance_m, 3)
    ))?;
    stdout::print_line(format_args!(
        "hops {}, apexes {}, falls {}, ticks in the safe state {}, samples rejected {}",
        report.hops, report.apexes, report.falls, report.safe_ticks, report.rejected
    ))?;
    report.faults.iter().try_for_each(stdout::print_line)
}

/// Prints warnings about the outcome and returns the exit status.
pub(super) fn exit_status(outcome: &Outcome) -> ExitCode {
    if outcome.all_safe() {
        stderr::print_line(format_args!(
            "sim-host: warning: the controller never left its safe state: all {} ticks were under \
             its safe command and {} samples were rejected; the actor acts only after samples \
             within the guard's limits and an apex from which the leg falls",
            outcome.ticks, outcome.rejected
        ));
    }
    if outcome.ending == Ending::Fall {
        let x_m = rounded(outcome.body.x_m, 2);
        stderr::print_line(format_args!("sim-host: the leg fell at x = {x_m:.2} m"));
        return ExitCode::from(1);
    }
    ExitCode::SUCCESS
}
