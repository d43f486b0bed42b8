//! A session that steps leg and controller in turn in one thread.

use crate::faults::stage::SteppedLink;
use leg_control::wire::{Command, Sample};

use super::hooks::Observe;
use super::leg::TickRecord;
use super::lock_step::{self, Options, SessionError};
use super::outcome::Outcome;
use crate::faults::add_counts;
use crate::scenario::Scenario;

/// Plays `scenario` with `law`, which is called once per tick with the sample, or
/// with `None` if a fault dropped it. Without faults on the link the run is bit
/// for bit that of any lock-step session.
///
/// # Errors
/// None in practice: there is no link that could fail.
pub fn run(
    scenario: &Scenario,
    law: impl FnMut(Option<&Sample>) -> Command,
    options: Options,
    observe: impl FnMut(&TickRecord),
) -> Result<Outcome, SessionError> {
    let mut link = SteppedLink::new(law, scenario.faults.plan());
    let mut outcome = lock_step::run_on(scenario, &mut link, options, &mut Observe(observe))?;
    add_counts(&mut outcome.faults, link.plan());
    Ok(outcome)
}
