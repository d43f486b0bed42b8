//! The lock-step session: sends a sample, waits for its command, steps the
//! plant, and repeats as fast as the machine allows.
//!
//! Simulated time is tick number over rate. A command is accepted only for its
//! own tick and run id, so a run is bit for bit the same over any transport and
//! at any speed. Faults of the scenario that affect the link are applied here, at
//! the leg's end; in a tick for which they drop the command, the command before
//! stays in force.

use std::time::{Duration, Instant};

use crate::faults::stage::FaultyLink;
use leg_control::wire::{Command, Header, WIRE_VERSION};
use leg_host::{LegLink, LinkError, Role};

use super::hooks::{Hooks, Observe};
use super::leg::{Leg, TickRecord};
use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::add_counts;
use crate::scenario::Scenario;

/// Options of a lock-step session.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Identifies the run; every message carries it.
    pub run_id: u32,
    /// Longest wait for a command.
    pub timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self { run_id: 1, timeout: Duration::from_secs(10) }
    }
}

/// Why a run ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The link failed, or the controller left.
    #[error("at tick {tick}: {cause}")]
    Link {
        /// The tick.
        tick: u64,
        /// The cause.
        cause: LinkError,
    },
    /// The controller is connected but sent no matching command in time.
    #[error(
        "at tick {tick}: the {role} is running but has not answered for {waited_s} s; {}",
        why_not(last.as_ref(), *tick, *run_id),
        role = Role::Controller
    )]
    NoAnswer {
        /// The tick.
        tick: u64,
        /// The run.
        run_id: u32,
        /// Time waited, s.
        waited_s: f64,
        /// The header of the last command that answered another sample.
        last: Option<Header>,
    },
}

/// Returns why no command answers the sample of this tick.
fn why_not(last: Option<&Header>, tick: u64, run_id: u32) -> String {
    let Some(Header { version, run_id: their_run, seq, .. }) = last else {
        return "it may be stopped".to_owned();
    };
    format!(
        "its last command has wire version {version}, run id {their_run} and sequence number {seq}, \
         the sample that waits {WIRE_VERSION}, {run_id} and {tick}"
    )
}

/// Plays `scenario` with the controller at the other end of `link`. The run
/// waits for `observe`, which is called at every tick.
///
/// # Errors
/// [`SessionError`] if the controller leaves or does not answer in time.
pub fn run(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    observe: impl FnMut(&TickRecord),
) -> Result<Outcome, SessionError> {
    run_with(scenario, link, options, &mut Observe(observe))
}

/// Like [`run`], with [`Hooks`].
///
/// # Errors
/// Like [`run`].
pub fn run_with(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    hooks: &mut impl Hooks,
) -> Result<Outcome, SessionError> {
    let plan = scenario.faults.plan();
    if plan.is_empty() {
        return run_on(scenario, link, options, hooks);
    }
    let mut faulty = FaultyLink::at_leg(link, plan).in_lock_step();
    let mut outcome = run_on(scenario, &mut faulty, options, hooks)?;
    add_counts(&mut outcome.faults, &faulty.into_parts().1);
    Ok(outcome)
}

/// Plays over a link that applies the scenario's faults itself.
pub(super) fn run_on(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    hooks: &mut impl Hooks,
) -> Result<Outcome, SessionError> {
    let mut leg = Leg::new(scenario, options.run_id);
    let mut round_trips = RoundTrips::default();
    let start = Instant::now();
    let ending = loop {
        if let Some(ending) = leg.ending() {
            break ending;
        }
        hooks.wait();
        if hooks.ends() {
            break Ending::Stopped;
        }
        hooks.steer(&mut leg);
        let sent = Instant::now();
        let command = exchange(&mut leg, link, options.timeout)?;
        let round_trip = sent.elapsed();
        round_trips.record(round_trip);
        leg.step(command, round_trip, &mut |tick: &TickRecord| hooks.observe(tick));
    };
    let wall_time_s = start.elapsed().as_secs_f64();
    hooks.before_end();
    let tick = leg.seq();
    link.send(&leg.end_sample()).map_err(|cause| SessionError::Link { tick, cause })?;
    Ok(leg.outcome(ending, wall_time_s, round_trips))
}

/// Sends the current sample and waits for its command. A link with faults may
/// return an older command or none.
fn exchange(
    leg: &mut Leg<'_>,
    link: &mut impl LegLink,
    timeout: Duration,
) -> Result<Option<Command>, SessionError> {
    let tick = leg.seq();
    let broken = |cause| SessionError::Link { tick, cause };
    link.send(leg.sample()).map_err(broken)?;
    let mut left = timeout;
    let mut since = None;
    let mut last = None;
    loop {
        let Some(command) = link.receive(left).map_err(broken)? else {
            if link.expects_no_reply() {
                return Ok(None);
            }
            let (run_id, waited_s) = (leg.sample().header.run_id, timeout.as_secs_f64());
            return Err(SessionError::NoAnswer { tick, run_id, waited_s, last });
        };
        if leg.is_answered_by(&command) || link.expects_no_reply() {
            return Ok(Some(command));
        }
        leg.count_refused(&command);
        last = Some(command.header);
        let since = *since.get_or_insert_with(Instant::now);
        left = timeout.saturating_sub(since.elapsed());
    }
}

#[cfg(test)]
mod tests;
