//! The session in real time: a tick of the plant at every tick of the clock,
//! whether or not a command has arrived for it.
//!
//! At a tick of the clock the leg takes the newest command, plays the time since
//! the tick before under it, and sends a sample. A command that arrives in time
//! answers the sample of the tick before, so a run in which every command arrives
//! in time is bit for bit the run in lock-step.
//!
//! Until the first command arrives the leg is held at its start, for at most
//! [`START_HOLD`], so that a slow start of the controller does not cause a fall.

mod task;

use std::time::{Duration, Instant};

use crate::faults::stage::FaultyLink;
use leg_host::realtime::{LoopOptions, LoopReport, run as run_loop};
use leg_host::{LegLink, LinkError};
use leg_process::Stop;

use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::add_counts;
use crate::scenario::Scenario;

pub use super::hooks::Hooks;
pub use task::LegTask;

/// Longest time for which a leg is held at its start until a command arrives.
pub const START_HOLD: Duration = Duration::from_secs(1);

/// Behaviour after a fall.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum OnFall {
    /// The run ends.
    #[default]
    End,
    /// The leg is put back to its start as another run, and the fall is counted.
    Restart,
}

/// Options of a session in real time.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Identifies the run; every message carries it and a restart increments it.
    pub run_id: u32,
    /// Behaviour after a fall.
    pub on_fall: OnFall,
}

impl Default for Options {
    fn default() -> Self {
        Self { run_id: 1, on_fall: OnFall::End }
    }
}

/// Result of a session in real time.
#[derive(Clone, Debug)]
pub struct Played {
    /// The error that ended the session early, if any.
    pub ended: Result<(), LinkError>,
    /// The result of the run.
    pub outcome: Outcome,
    /// The report of the loop.
    pub report: LoopReport,
}

/// Plays `scenario` in real time on this thread with the controller at the other
/// end of `link`. `supervise` is called every 10 ms on another thread and may
/// block. Faults of the scenario that affect the link are applied here, at the
/// leg's end.
pub fn run(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    loop_options: &LoopOptions,
    stop: &Stop,
    supervise: impl FnMut() + Send,
    hooks: &mut impl Hooks,
) -> Played {
    let plan = scenario.faults.plan();
    if plan.is_empty() {
        return run_on(scenario, link, options, loop_options, stop, supervise, hooks);
    }
    let mut faulty = FaultyLink::at_leg(link, plan);
    let mut played = run_on(scenario, &mut faulty, options, loop_options, stop, supervise, hooks);
    add_counts(&mut played.outcome.faults, &faulty.into_parts().1);
    played
}

/// Plays over a link without faults.
fn run_on(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    loop_options: &LoopOptions,
    stop: &Stop,
    supervise: impl FnMut() + Send,
    hooks: &mut impl Hooks,
) -> Played {
    let mut task = LegTask::new(scenario, link, options, hooks);
    let start = Instant::now();
    let (ended, tally) = run_loop(loop_options, &mut task, stop, supervise);
    let wall_time_s = start.elapsed().as_secs_f64();
    let stopped = task.ending().is_none() && stop.is_raised();
    let (leg, ending) = task.finish();
    let ended = ended.and_then(|()| {
        if !stopped {
            return Ok(());
        }
        // Tells the controller not to wait.
        link.send(&leg.end_sample()).and(Err(LinkError::Stopped))
    });
    let round_trips = RoundTrips::of(tally.round_trips_ns());
    let outcome = leg.outcome(ending.unwrap_or(Ending::Stopped), wall_time_s, round_trips);
    Played { ended, outcome, report: tally.report() }
}

#[cfg(test)]
mod tests;
