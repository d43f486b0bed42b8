//! The lock-step session: a sample out, its command back, one step of the
//! plant, as fast as the machine.
//!
//! Sim time is tick number over rate. A command is taken only for its tick and
//! run id, however long it takes to come, so a run is the same, bit for bit,
//! over any transport and at any speed. Where the scenario has faults on the
//! link, they happen here, at the leg's end; in a tick that they leave without a
//! command the leg goes on under the one before.

use std::time::{Duration, Instant};

use crate::faults::stage::Faulty;
use leg_control::wire::Command;
use leg_host::{LegLink, LinkError, Role};

use super::hooks::{Hooks, Observe};
use super::leg::{Leg, TickRecord};
use super::outcome::{Ending, Outcome};
use super::timing::RoundTrips;
use crate::faults::add_counts;
use crate::scenario::Scenario;

/// How a session is played.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of the run, carried by every message.
    pub run_id: u32,
    /// How long to wait for a command.
    pub timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self { run_id: 1, timeout: Duration::from_secs(10) }
    }
}

/// Why a run broke off.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The link is broken, or the controller gone.
    #[error("at tick {tick}: {cause}")]
    Link {
        /// The tick.
        tick: u64,
        /// What happened.
        cause: LinkError,
    },
    /// The controller is there, but sends nothing that fits.
    #[error(
        "at tick {tick}: the {role} lives but has not answered for {waited_s} s; is it stopped? --timeout sets the patience",
        role = Role::Controller
    )]
    NoAnswer {
        /// The tick.
        tick: u64,
        /// How long, s.
        waited_s: f64,
    },
}

/// Plays `scenario` to the controller at the other end of `link`. `observe`
/// sees every tick; it may be slow, the run waits for it.
///
/// # Errors
/// [`SessionError`] when the controller goes or does not answer in time.
pub fn run(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    observe: impl FnMut(&TickRecord),
) -> Result<Outcome, SessionError> {
    run_with(scenario, link, options, &mut Observe(observe))
}

/// As [`run`], with all that may be hooked into a run.
///
/// # Errors
/// As [`run`].
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
    let mut faulty = Faulty::at_leg(link, plan).in_lock_step();
    let mut outcome = run_on(scenario, &mut faulty, options, hooks)?;
    add_counts(&mut outcome.faults, &faulty.into_parts().1);
    Ok(outcome)
}

/// Plays over a link as it is: the scenario's faults on it have their place there.
pub(super) fn run_on(
    scenario: &Scenario,
    link: &mut impl LegLink,
    options: Options,
    hooks: &mut impl Hooks,
) -> Result<Outcome, SessionError> {
    let mut leg = Leg::new(scenario, options.run_id);
    let mut round_trips = RoundTrips::default();
    let begun = Instant::now();
    let ending = loop {
        if let Some(ending) = leg.ending() {
            break ending;
        }
        hooks.wait();
        if hooks.ends() {
            break Ending::Stopped;
        }
        hooks.steer(&mut leg);
        let asked = Instant::now();
        let command = ask(&mut leg, link, options.timeout)?;
        let round_trip = asked.elapsed();
        round_trips.record(round_trip);
        leg.step(command, round_trip, &mut |tick: &TickRecord| hooks.observe(tick));
    };
    let wall_time_s = begun.elapsed().as_secs_f64();
    let tick = leg.seq();
    link.send(&leg.farewell()).map_err(|cause| SessionError::Link { tick, cause })?;
    Ok(leg.outcome(ending, wall_time_s, round_trips))
}

/// The command for this very sample; of a link with faults, what it gives.
fn ask(
    leg: &mut Leg<'_>,
    link: &mut impl LegLink,
    timeout: Duration,
) -> Result<Option<Command>, SessionError> {
    let tick = leg.seq();
    let broken = |cause| SessionError::Link { tick, cause };
    link.send(leg.sample()).map_err(broken)?;
    let mut left = timeout;
    let mut since = None;
    loop {
        let Some(command) = link.receive(left).map_err(broken)? else {
            if link.expects_no_reply() {
                return Ok(None);
            }
            return Err(SessionError::NoAnswer { tick, waited_s: timeout.as_secs_f64() });
        };
        if leg.is_answered_by(&command) || link.expects_no_reply() {
            return Ok(Some(command));
        }
        leg.refuse(&command);
        let since = *since.get_or_insert_with(Instant::now);
        left = timeout.saturating_sub(since.elapsed());
    }
}

#[cfg(test)]
mod tests;
