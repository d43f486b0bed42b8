//! Compares the estimates of a recording with those of the controller under replay.

use std::collections::VecDeque;

use leg_control::estimator;

use super::compare::{Difference, Value, estimate_difference};
use super::report::ReplayReport;
use crate::record::contents::Contents;
use crate::record::read::ReadError;
use crate::record::schema::{AnyMessage, Estimate};

/// Compares the recorded estimates with those that the replay `held` after each sample, by run id
/// and number, up to the first that differs. A recording without estimates is left as it is.
///
/// All commands of the recording must be known to be equal: so no tick of it is missing.
pub(super) fn compare(
    contents: &Contents,
    mut held: VecDeque<((u32, u64), estimator::Estimate)>,
    report: &mut ReplayReport,
) -> Result<(), ReadError> {
    if !contents.has_estimates {
        return Ok(());
    }
    let mut now = (0, 0);
    let mut messages = contents.messages()?;
    while let Some(message) = messages.next_message()? {
        match message {
            AnyMessage::Sample(sample) => now = (sample.run_id, sample.seq),
            AnyMessage::Estimate(recorded) if recorded.seq == now.1 => {
                while held.pop_front_if(|(at, _)| *at < now).is_some() {}
                let replayed = held.pop_front_if(|(at, _)| *at == now);
                let replayed = replayed.map(|(_, held)| Estimate::at_tick(now.1, &held));
                let difference = match replayed {
                    Some(replayed) => estimate_difference(&recorded, &replayed),
                    None => Some(absent(now.1)),
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
