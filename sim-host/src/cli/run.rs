//! `sim-host run`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use controller::control::{Config, Controller};
use controller::host::cli::{Meeting as MeetingArgs, SAY_AFTER, other_leg};
use controller::host::domain::DomainError;
use controller::host::shm::ConnectError;
use controller::host::{Pace, Role, Stop};
use controller::wire::Sample;

use super::recording::Recording;
use super::{checked_policy, misuse};
use crate::scenario::{self, Scenario, Settings};
use crate::session::child::ControllerCall;
use crate::session::lock_step::Options;
use crate::session::stepped;
use crate::session::two_processes::{self, Meeting, PlayError};
use crate::session::{Ending, Outcome, TickRecord};

/// Plays a scenario to a controller, in lock-step.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// What to play, as TOML; flags win over it.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    meeting: MeetingArgs,
    /// Start the controller too, in a process and a domain of its own.
    #[arg(long, conflicts_with = "in_process")]
    spawn: bool,
    /// Run the controller in this process, without shared memory.
    #[arg(long)]
    in_process: bool,
    /// The policy that --spawn or --in-process runs [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// Record every tick to an MCAP file, for `replay`, `plot` and other programs.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let (scenario, settings) =
        scenario::load_with_settings(args.scenario.as_deref(), args.settings.clone())
            .map_err(misuse)?;
    if args.policy.is_some() && !args.spawn && !args.in_process {
        return Err(misuse(
            "--policy is for a controller that this program runs: add --spawn or --in-process, \
             or give the policy to the controller that you start",
        ));
    }
    let record = args.record.as_deref();
    let mut recording = Recording::begin(record, &settings, &scenario, Pace::LockStep)?;
    let outcome = if args.in_process {
        in_process(&scenario, args.policy.as_deref(), &mut recording)
    } else {
        over_shared_memory(&scenario, args, &mut recording)
    };
    let recorded = recording.finish(&outcome);
    let outcome = outcome?;
    if args.json {
        println!("{}", serde_json::to_string(&outcome.report())?);
    } else {
        print_summary(&outcome);
    }
    if outcome.all_safe() {
        eprintln!(
            "sim-host: warning: the controller never left its safe state: of {} ticks all were \
             under its safe command, {} samples were rejected; an action needs samples within \
             the guard's limits and an apex from which the leg falls",
            outcome.ticks, outcome.rejected
        );
    }
    if outcome.ending == Ending::Fall {
        eprintln!("sim-host: the leg fell at x = {:.2} m", outcome.body.x_m);
        return Ok(ExitCode::from(1));
    }
    recorded?;
    Ok(ExitCode::SUCCESS)
}

fn in_process(
    scenario: &Scenario,
    policy: Option<&Path>,
    recording: &mut Recording,
) -> anyhow::Result<Outcome> {
    let blob = checked_policy(policy)?;
    let policy = blob.policy().map_err(misuse)?;
    let leg = scenario.leg_model().fingerprint();
    if let Some(warning) = other_leg(policy.manifest(), Some(leg)) {
        eprintln!("sim-host: {warning}");
    }
    recording.policy(blob.as_slice(), &policy);
    let config = Config::at_rate(scenario.rate_hz)
        .and_then(|config| config.with_gravity(scenario.controller_gravity_m_s2()))
        .map_err(misuse)?;
    let mut controller = Controller::new(policy, config);
    let law = |sample: Option<&Sample>| controller.tick(sample);
    Ok(stepped::run(scenario, law, Options::default(), |tick| recording.push(tick))?)
}

fn over_shared_memory(
    scenario: &Scenario,
    args: &Args,
    recording: &mut Recording,
) -> anyhow::Result<Outcome> {
    let domain = if args.spawn && args.meeting.domain.is_none() {
        // Of its own: so that runs that start their controller never meet.
        format!("run-{}", std::process::id())
    } else {
        args.meeting.domain().to_owned()
    };
    if args.spawn {
        checked_policy(args.policy.as_deref())?;
    }
    let timeout = args.meeting.timeout;
    let start = args.spawn.then(|| ControllerCall {
        policy: args.policy.clone(),
        rate_hz: scenario.rate_hz,
        gravity_m_s2: scenario.controller_gravity_m_s2(),
        domain: domain.clone(),
        timeout,
    });
    let quiet = start.is_some();
    let stop = Stop::on_signals()?;
    let mut said = false;
    let tell = |missing: &controller::host::shm::Missing| {
        if !(said || quiet) && missing.waited >= SAY_AFTER {
            said = true;
            eprintln!("sim-host: {missing}; still waiting");
        }
    };
    recording.ask_for_policies(&domain);
    let meeting = Meeting { domain, timeout, start };
    let observe = |tick: &TickRecord| recording.push(tick);
    two_processes::play(scenario, &meeting, &stop, tell, observe).map_err(|error| match &error {
        PlayError::Connect(ConnectError::Domain(DomainError::Name(_))) => misuse(error),
        PlayError::Controller(status) if status.code() == Some(2) => misuse(error),
        _ => error.into(),
    })
}

fn print_summary(outcome: &Outcome) {
    let report = outcome.report();
    let ending = match outcome.ending {
        Ending::Duration => "time over",
        Ending::Distance => "distance reached",
        Ending::Fall => "fell",
    };
    println!(
        "{ending} after {:.3} s ({} ticks), {:.3} m",
        report.sim_time_s, report.ticks, report.distance_m
    );
    println!(
        "hops {}, apexes {}, falls {}, ticks in the safe state {}, samples rejected {}",
        report.hops, report.apexes, report.falls, report.safe_ticks, report.rejected
    );
    let us = report.round_trip_us;
    println!(
        "{:.0} ticks/s; {} round trip p50 {:.2} us, p99 {:.2} us, p99.9 {:.2} us, max {:.1} us",
        report.ticks_per_s,
        Role::Controller,
        us.p50,
        us.p99,
        us.p99_9,
        us.max
    );
    report.faults.iter().for_each(|fault| println!("{fault}"));
    println!("state hash {}", report.state_hash);
}
