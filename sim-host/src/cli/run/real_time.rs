//! `sim-host run --real-time`.

use std::process::ExitCode;

use leg_control::wire_controller::WireController;
use leg_host::cli::hint::peer_event;
use leg_host::realtime::LoopOptions;
use leg_host::realtime::args::RealTimeArgs;
use leg_host::realtime::{self, Direct, ExitOn, LatestReport, LoopReport};
use leg_host::{Role, TimeMode, memory};
use leg_process::stdout;
use leg_process::{Stop, stderr};

use super::super::recording::Recording;
use super::super::{checked_policy, misuse};
use super::args::{Args, RealTime};
use super::play::{
    controller_config, exit_status, operated, print_summary, warn_of_other_leg, with_controller,
};
use crate::scenario::Scenario;
use crate::session::real_time::{self, Options, Played};

pub(super) fn main(
    scenario: &Scenario,
    args: &Args,
    mut recording: Recording,
) -> anyhow::Result<ExitCode> {
    let stop = Stop::on_signals()?;
    let played = if args.in_process {
        in_process(scenario, args, &stop, &mut recording)
    } else {
        two_processes(scenario, args, &stop, &mut recording)
    };
    let recorded = recording.finish(played.as_ref().map(|(played, _)| &played.outcome));
    let (Played { ended, outcome, report }, controller) = played?;
    if args.json {
        let mut json = serde_json::to_value(outcome.report())?;
        json["time_mode"] = serde_json::to_value(TimeMode::RealTime)?;
        json["loop"] = serde_json::to_value(report)?;
        json["controller_loop"] = serde_json::to_value(controller.as_ref().ok())?;
        stdout::print_line(json)?;
    } else {
        print_summary(&outcome)?;
        stdout::print_line(format_args!("state hash {:016x}\n\n{report}", outcome.state_hash))?;
        if let Ok(Some(report)) = &controller {
            stdout::print_line(format_args!("\n{report}"))?;
        }
    }
    let status = exit_status(&outcome);
    ended?;
    controller?;
    recorded?;
    Ok(status)
}

/// Returns the options of the leg's loop.
fn loop_options(
    args: &RealTime,
    scenario: &Scenario,
    latest: LatestReport,
    recording: &Recording,
) -> LoopOptions {
    let &Scenario { rate_hz, stale_limit_ns, .. } = scenario;
    let observer = recording.tick_observer();
    LoopOptions { observer, stale_limit_ns, ..args.clock.options(Role::Leg, rate_hz, latest) }
}

fn two_processes(
    scenario: &Scenario,
    args: &Args,
    stop: &Stop,
    recording: &mut Recording,
) -> anyhow::Result<(Played, anyhow::Result<Option<LoopReport>>)> {
    let params = scenario.session_params().with_time_mode(TimeMode::RealTime);
    with_controller(scenario, args, params, stop, recording, |connected, run_id, recording| {
        let mut link = connected.link;
        let (_, supervise) = realtime::supervise_peer(&link, stop, None, |event| {
            if let Some(message) = peer_event(event) {
                stderr::print_line(format_args!("sim-host: {message}"));
            }
        });
        let shared = LatestReport::default();
        let timing = Some(shared.clone());
        let operated = operated(&args.domain(), scenario.rate_hz, TimeMode::RealTime, stop, timing);
        let options = args.real_time.session_options(run_id);
        let of_loop = loop_options(&args.real_time, scenario, shared, recording);
        let mut hooks = (recording, operated);
        Ok(real_time::run(scenario, &mut link, options, &of_loop, stop, supervise, &mut hooks))
    })
}

/// Plays both loops as threads of this process.
fn in_process(
    scenario: &Scenario,
    args: &Args,
    stop: &Stop,
    recording: &mut Recording,
) -> anyhow::Result<(Played, anyhow::Result<Option<LoopReport>>)> {
    let blob = checked_policy(args.policy.as_deref())?;
    let policy = blob.policy().map_err(misuse)?;
    warn_of_other_leg(&policy, scenario);
    recording.policy(blob.as_slice(), &policy);
    recording.law(scenario.estimator.unwrap_or_default(), scenario.stale_limit_ns, false);
    let config = controller_config(scenario)?;
    let RealTime { clock, controller_cpu, .. } = &args.real_time;
    let controller_clock = RealTimeArgs { cpu: *controller_cpu, live: false, ..clock.clone() };
    let controller_options =
        controller_clock.options(Role::Controller, scenario.rate_hz, LatestReport::default());
    let stale_limit_ns = scenario.stale_limit_ns;
    let controller_options = LoopOptions { stale_limit_ns, ..controller_options };
    let run_id = Options::default().run_id;
    let (mut link, controllers_end) = memory::pair();
    let (played, served) = std::thread::scope(|scope| {
        let serving = scope.spawn(|| {
            let mut control = Direct { controller: WireController::new(policy, config), config };
            let options = &controller_options;
            realtime::serve(controllers_end, &mut control, ExitOn::EndOfRun, options, stop, || ())
        });
        let options = args.real_time.session_options(run_id);
        let of_loop = loop_options(&args.real_time, scenario, LatestReport::default(), recording);
        let played = real_time::run(scenario, &mut link, options, &of_loop, stop, || (), recording);
        // If the run ended early, the controller sees by this that its leg has left.
        drop(link);
        (played, serving.join().expect("the controller's loop does not panic"))
    });
    Ok((played, Ok(Some(served.report))))
}
