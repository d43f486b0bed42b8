//! `sim-host run --real-time`.

use std::ffi::OsString;
use std::process::ExitCode;

use leg_control::wire_controller::WireController;
use leg_host::cli::hint::peer_event;
use leg_host::realtime::LoopOptions;
use leg_host::realtime::args::{RealTimeArgs, parse_cpu};
use leg_host::realtime::{self, Direct, ExitOn, LatestReport, LoopReport};
use leg_host::{Role, TimeMode, memory};
use leg_process::Stop;
use leg_process::stdout;

use super::recording::Recording;
use super::{checked_policy, misuse, run};
use crate::scenario::Scenario;
use crate::session::real_time::{self, OnFall, Options, Played};

/// How to play in real time.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub(super) struct Args {
    #[command(flatten)]
    clock: RealTimeArgs,
    /// The processor for the loop of a controller that this program runs.
    #[arg(
        long, value_name = "N", requires = "real_time", allow_negative_numbers = true,
        value_parser = parse_cpu
    )]
    controller_cpu: Option<usize>,
    /// What becomes of a leg that falls: the run ends, or it is put back to its
    /// start and the fall is counted.
    #[arg(long, value_enum, default_value_t, requires = "real_time")]
    on_fall: OnFall,
}

impl Args {
    pub(super) fn is_on(&self) -> bool {
        self.clock.real_time
    }

    /// What a controller is to be started with.
    pub(super) fn of_controller(&self) -> Vec<OsString> {
        self.clock.arguments(self.controller_cpu)
    }

    /// How the leg is played.
    fn options(&self, run_id: u32) -> Options {
        Options { run_id, on_fall: self.on_fall }
    }

    /// How its loop is run.
    fn of_loop(&self, rate_hz: u32, latest: LatestReport, recording: &Recording) -> LoopOptions {
        let observer = recording.tick_observer();
        LoopOptions { observer, ..self.clock.options(Role::Leg, rate_hz, latest) }
    }
}

pub(super) fn main(
    scenario: &Scenario,
    args: &run::Args,
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
        json["pace"] = serde_json::to_value(TimeMode::RealTime)?;
        json["loop"] = serde_json::to_value(report)?;
        json["controller_loop"] = serde_json::to_value(controller)?;
        stdout::print_line(json)?;
    } else {
        run::print_summary(&outcome)?;
        stdout::print_line(format_args!("state hash {:016x}\n\n{report}", outcome.state_hash))?;
        if let Some(report) = controller {
            stdout::print_line(format_args!("\n{report}"))?;
        }
    }
    let status = run::verdict(&outcome);
    ended?;
    recorded?;
    Ok(status)
}

fn two_processes(
    scenario: &Scenario,
    args: &run::Args,
    stop: &Stop,
    recording: &mut Recording,
) -> anyhow::Result<(Played, Option<LoopReport>)> {
    let params = scenario.session_params().with_time_mode(TimeMode::RealTime);
    run::meet(scenario, args, params, stop, recording, |met, run_id, recording| {
        let mut link = met.link;
        let (_, supervise) = realtime::supervise_peer(&link, stop, None, |event| {
            if let Some(message) = peer_event(event) {
                eprintln!("sim-host: {message}");
            }
        });
        let shared = LatestReport::default();
        let timing = Some(shared.clone());
        let operated =
            run::operated(&args.domain(), scenario.rate_hz, TimeMode::RealTime, stop, timing);
        let options = args.real_time.options(run_id);
        let of_loop = args.real_time.of_loop(scenario.rate_hz, shared, recording);
        let mut hooks = (recording, operated);
        Ok(real_time::run(scenario, &mut link, options, &of_loop, stop, supervise, &mut hooks))
    })
}

/// Both loops as threads of this process.
fn in_process(
    scenario: &Scenario,
    args: &run::Args,
    stop: &Stop,
    recording: &mut Recording,
) -> anyhow::Result<(Played, Option<LoopReport>)> {
    let blob = checked_policy(args.policy.as_deref())?;
    let policy = blob.policy().map_err(misuse)?;
    run::warn_of_other_leg(&policy, scenario);
    recording.policy(blob.as_slice(), &policy);
    let config = run::controller_config(scenario)?;
    let Args { clock, controller_cpu, .. } = &args.real_time;
    let beside = RealTimeArgs { cpu: *controller_cpu, live: false, ..clock.clone() };
    let options = beside.options(Role::Controller, scenario.rate_hz, LatestReport::default());
    let run_id = Options::default().run_id;
    let (mut link, controllers_end) = memory::pair();
    let (played, served) = std::thread::scope(|scope| {
        let serving = scope.spawn(|| {
            let mut control = Direct { controller: WireController::new(policy, config), config };
            realtime::serve(controllers_end, &mut control, ExitOn::EndOfRun, &options, stop, || ())
        });
        let (leg, of_loop) = (
            args.real_time.options(run_id),
            args.real_time.of_loop(scenario.rate_hz, LatestReport::default(), recording),
        );
        let played = real_time::run(scenario, &mut link, leg, &of_loop, stop, || (), recording);
        // Also when the run broke off: the controller sees that its leg has left.
        drop(link);
        (played, serving.join().expect("a controller that does not panic"))
    });
    Ok((played, Some(served.report)))
}
