//! The session in real time: a tick of the plant at every tick of the clock,
//! whether or not a command has come for it.
//!
//! At a tick of the clock the leg takes the newest command, plays the time
//! since the tick before under it, and sends what it senses now. A command that
//! is in time answers the sample of the tick before; so a run in which every
//! command is in time is, bit for bit, the one in lock-step.
//!
//! Before the first command the leg is held at its start, for at most
//! [`HOLD`]: a run does not begin with a fall because a process is slow to start.

mod task;

use std::time::{Duration, Instant};

use crate::faults::stage::Faulty;
use leg_host::realtime::{LoopOptions, LoopReport, run as run_loop};
use leg_host::{LegLink, LinkError};
use leg_process::Stop;

use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::add_counts;
use crate::scenario::Scenario;

pub use super::hooks::Hooks;
pub use task::LegTask;

/// Longest time for which a leg is held at its start until it is commanded.
pub const HOLD: Duration = Duration::from_secs(1);

/// What becomes of a leg that falls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum OnFall {
    /// The run ends.
    #[default]
    End,
    /// It is put back to its start, as another run, and the fall is counted.
    Restart,
}

/// How a session is played.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of the run, carried by every message; raised by a restart.
    pub run_id: u32,
    /// What becomes of a leg that falls.
    pub on_fall: OnFall,
}

impl Default for Options {
    fn default() -> Self {
        Self { run_id: 1, on_fall: OnFall::End }
    }
}

/// What a session came to.
#[derive(Clone, Debug)]
pub struct Played {
    /// What broke it off, if anything did.
    pub ended: Result<(), LinkError>,
    /// What came of the leg.
    pub outcome: Outcome,
    /// The figures of the loop.
    pub report: LoopReport,
}

/// Plays `scenario` in real time, on this thread, to the controller at the other
/// end of `link`. `supervise` is called every 10 ms, beside the loop: the place
/// for what may take its time. Faults of the scenario that are on the link happen
/// here, at the leg's end.
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
    let mut faulty = Faulty::at_leg(link, plan);
    let mut played = run_on(scenario, &mut faulty, options, loop_options, stop, supervise, hooks);
    add_counts(&mut played.outcome.faults, &faulty.into_parts().1);
    played
}

/// Plays over a link as it is.
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
    let begun = Instant::now();
    let (ended, tally) = run_loop(loop_options, &mut task, stop, supervise);
    let wall_time_s = begun.elapsed().as_secs_f64();
    let told_to_stop = task.ending().is_none() && stop.is_raised();
    let (leg, ending) = task.finish();
    let ended = ended.and_then(|()| {
        if !told_to_stop {
            return Ok(());
        }
        // The controller should not be left waiting.
        link.send(&leg.farewell()).and(Err(LinkError::Stopped))
    });
    let round_trips = RoundTrips::of(tally.round_trips_ns());
    let outcome = leg.outcome(ending.unwrap_or(Ending::Stopped), wall_time_s, round_trips);
    Played { ended, outcome, report: tally.report() }
}

#[cfg(test)]
mod tests;
