//! `sim-host run`.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use leg_control::config::Config;
use leg_control::policy::Policy;
use leg_control::wire::Sample;
use leg_control::wire_controller::WireController;
use leg_host::cli::{Meeting as MeetingArgs, SAY_AFTER, hint, other_leg};
use leg_host::discovery::DomainError;
use leg_host::realtime::{LatestReport, LoopReport};
use leg_host::reconnect::LinkEvent;
use leg_host::shm::ConnectError;
use leg_host::{Role, SessionParams, TimeMode};
use leg_process::Stop;
use leg_process::stdout;

use super::recording::Recording;
use super::{checked_policy, misuse, real_time};
use crate::operate::Operated;
use crate::scenario::{self, Scenario, Settings};
use crate::session::child::ControllerCall;
use crate::session::lock_step::{self, Options};
use crate::session::stepped;
use crate::session::two_processes::{self, Meeting, Met, News, PlayError, new_run_id};
use crate::session::{Ending, Outcome};

/// Plays a scenario to a controller, in lock-step or in real time.
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
    pub(super) in_process: bool,
    /// The policy that --spawn or --in-process runs [default: the shipped one].
    #[arg(long, value_name = "FILE")]
    pub(super) policy: Option<PathBuf>,
    /// Record every tick to an MCAP file, for `replay`, `plot` and other programs.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) real_time: real_time::Args,
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
    let pace = if args.real_time.is_on() { TimeMode::RealTime } else { TimeMode::LockStep };
    let mut recording = Recording::begin(args.record.as_deref(), &settings, &scenario, pace)?;
    if args.real_time.is_on() {
        return real_time::main(&scenario, args, recording);
    }
    let outcome = if args.in_process {
        in_process(&scenario, args.policy.as_deref(), &mut recording)
    } else {
        over_shared_memory(&scenario, args, &mut recording)
    };
    let recorded = recording.finish(outcome.as_ref());
    let outcome = outcome?;
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
    let status = verdict(&outcome);
    recorded?;
    Ok(status)
}

impl Args {
    /// Where to meet the controller.
    pub(super) fn domain(&self) -> String {
        if self.spawn && self.meeting.domain.is_none() {
            // Of its own: so that runs that start their controller never meet.
            format!("run-{}", std::process::id())
        } else {
            self.meeting.domain().to_owned()
        }
    }
}

/// What is to be said of a run beside its figures, and the exit status.
pub(super) fn verdict(outcome: &Outcome) -> ExitCode {
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
        return ExitCode::from(1);
    }
    ExitCode::SUCCESS
}

/// Says that a policy of this process's own controller is for another leg.
pub(super) fn warn_of_other_leg(policy: &Policy<'_>, scenario: &Scenario) {
    let leg = scenario.leg_model().fingerprint();
    if let Some(warning) = other_leg(policy.manifest(), Some(leg)) {
        eprintln!("sim-host: {warning}");
    }
}

/// How the controller of a scenario is run.
pub(super) fn controller_config(scenario: &Scenario) -> anyhow::Result<Config> {
    Config::at_rate(scenario.rate_hz)
        .and_then(|config| config.with_gravity(scenario.controller_gravity_m_s2()))
        .map_err(misuse)
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
    let mut controller = WireController::new(policy, controller_config(scenario)?);
    let law = |sample: Option<&Sample>| controller.tick(sample);
    Ok(stepped::run(scenario, law, Options::default(), |tick| recording.push(tick))?)
}

fn over_shared_memory(
    scenario: &Scenario,
    args: &Args,
    recording: &mut Recording,
) -> anyhow::Result<Outcome> {
    let stop = Stop::on_signals()?;
    let timeout = args.meeting.timeout();
    let params = scenario.session_params();
    let (outcome, _) = meet(scenario, args, params, &stop, recording, |met, run_id, recording| {
        let options = Options { run_id, timeout };
        let operated = operated(&args.domain(), scenario.rate_hz, TimeMode::LockStep, &stop, None);
        let mut hooks = (recording, operated);
        Ok(lock_step::run_with(scenario, &mut met.in_lock_step(), options, &mut hooks)?)
    })?;
    Ok(outcome)
}

/// The desk of a run that has begun. A run goes on without, too.
pub(super) fn operated(
    domain: &str,
    rate_hz: u32,
    pace: TimeMode,
    stop: &Stop,
    timing: Option<LatestReport>,
) -> Option<Operated> {
    Operated::open(domain, rate_hz, pace, stop, timing)
        .inspect_err(|error| eprintln!("sim-host: warning: nobody can operate this run: {error}"))
        .ok()
}

/// Plays by `run` once a controller is there, by the options that say where;
/// `run` is told the number of the run. Beside what came of that: the figures of a
/// controller's loop in real time, if it was started here.
pub(super) fn meet<R>(
    scenario: &Scenario,
    args: &Args,
    params: SessionParams,
    stop: &Stop,
    recording: &mut Recording,
    run: impl FnOnce(Met<'_>, u32, &mut Recording) -> Result<R, PlayError>,
) -> anyhow::Result<(R, Option<LoopReport>)> {
    let domain = args.domain();
    if args.spawn {
        checked_policy(args.policy.as_deref())?;
    }
    let timeout = args.meeting.timeout();
    let start = args.spawn.then(|| ControllerCall {
        policy: args.policy.clone(),
        rate_hz: scenario.rate_hz,
        gravity_m_s2: scenario.controller_gravity_m_s2(),
        domain: domain.clone(),
        timeout,
        real_time: args.real_time.of_controller(),
    });
    let quiet = start.is_some();
    let mut said = false;
    let tell = |news: News<'_>| match news {
        News::Missing(missing) if !(said || quiet) && missing.waited >= SAY_AFTER => {
            said = true;
            eprintln!("sim-host: {missing}; {}; still waiting", hint::missing_peer(missing));
        }
        // One that was started here is not waited for: its loss is the end, and said there.
        News::Missing(_) | News::Notice(LinkEvent::Lost { .. }) if quiet => (),
        News::Missing(_) => (),
        News::Notice(event) => eprintln!("sim-host: {}", hint::link_event(event)),
    };
    let run_id = new_run_id();
    recording.poll_policies(&domain, run_id);
    let meeting = Meeting { domain, timeout, start, run_id };
    let run = |met: Met<'_>| run(met, run_id, recording);
    two_processes::play_by(params, &meeting, stop, tell, run).map_err(|error| match &error {
        PlayError::Connect(ConnectError::Domain(DomainError::Name(_))) => misuse(error),
        PlayError::Controller(status) if status.code() == Some(2) => misuse(error),
        _ => error.into(),
    })
}

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
        report.sim_time_s, report.ticks, report.distance_m
    ))?;
    stdout::print_line(format_args!(
        "hops {}, apexes {}, falls {}, ticks in the safe state {}, samples rejected {}",
        report.hops, report.apexes, report.falls, report.safe_ticks, report.rejected
    ))?;
    report.faults.iter().try_for_each(stdout::print_line)
}
