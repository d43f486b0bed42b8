//! Compares the estimates of a recording with those of the controller under replay.
//!
//! Only runs in which leg and controller stepped in turn in one thread record estimates. There
//! the controller ticked once for each tick of the leg, with what the faults made of its sample,
//! so the same samples give the same estimates bit for bit.

use std::cell::Cell;

use leg_control::wire::Sample;
use leg_control::wire_controller::WireController;
use leg_host::link::Link;

use super::compare::{Difference, Value, estimate_difference};
use super::faulted;
use super::report::ReplayReport;
use crate::faults::stage::SteppedLink;
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::{AnyMessage, Estimate};

/// Plays the recorded samples to `controller`, which has no state yet, and compares its estimates
/// with the recorded ones up to the first that differs. A recording without estimates is left
/// as it is.
///
/// All commands of the recording must be known to be equal: so no tick of it is missing.
pub(super) fn compare(
    contents: &Contents,
    mut controller: WireController<'_>,
    report: &mut ReplayReport,
) -> Result<(), ReadError> {
    if !contents.has_estimates || !contents.laws.first().is_some_and(|law| law.stepped) {
        return Ok(());
    }
    let estimate = Cell::new(None);
    let law = |sample: Option<&Sample>| {
        let command = controller.tick(sample);
        estimate.set(controller.estimate());
        command
    };
    let mut link = SteppedLink::new(law, faulted::plan(contents)?.unwrap_or_default());
    let mut seq = 0;
    let mut messages = contents.messages()?;
    while let Some(message) = messages.next_message()? {
        match message {
            AnyMessage::Sample(sample) => {
                seq = sample.seq;
                // Within a thread it does not fail.
                let _ = link.send(&(&sample).into());
            }
            AnyMessage::Estimate(recorded) if recorded.seq == seq => {
                let replayed = estimate.get().map(|estimate| Estimate::at_tick(seq, &estimate));
                let difference = match replayed {
                    Some(replayed) => estimate_difference(&recorded, &replayed),
                    None => Some(absent(seq)),
                };
                report.estimates_compared += 1;
                if let Some(difference) = difference {
                    report.equal = false;
                    report.first_estimate_difference = Some(difference);
                    break;
                }
            }
            _ => (),
        }
    }
    Ok(())
}

/// Returns the difference of an estimate from none.
fn absent(tick: u64) -> Difference {
    Difference { tick, field: "is_there", recorded: Value::from(1_u32), replayed: 0_u32.into() }
}
