//! The controller played again.
//!
//! Where commands are missing from a recording, as happens in real time, it
//! does not say what the controller saw: it may have slept through a sample, or
//! have answered it too late to be heard; and it may have ticked without a
//! sample, which only its count of rejected ticks tells. So all that may have
//! been is tried, and what gives the recorded command is kept, more than one if
//! need be: the recording is that of *a* controller under this policy which
//! missed some samples, or it is not.

use std::collections::VecDeque;

use leg_control::policy::Policy;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;

use super::compare::{Difference, difference};
use super::recorded;
use super::source::Answer;

/// Controllers that all explain the recording so far, at most: in flight a
/// sample more or less tells only at the next apex, so each doubles their number
/// until then. There the last bits leave few of them.
const MOST: usize = 1024;
/// Of so many unanswered samples any part may have been seen; of more, all up
/// to one, or all from one on.
const ANY_OF: usize = 4;
/// Ticks without a sample between two answers, at most.
const MOST_MISSING: u32 = 64;

/// A policy that the controller is given before a tick.
#[derive(Clone, Debug)]
pub(super) struct Swap<'a> {
    /// The run and the tick.
    pub(super) at: (u32, u64),
    /// `None` when the recording does not have it.
    pub(super) policy: Option<Policy<'a>>,
}

/// Why the replay cannot go on as recorded.
#[derive(Debug)]
pub(super) enum Parted {
    /// The commands differ.
    Different(Difference),
    /// There were more ways than can be followed, and none of those that were.
    TooManyWays,
    /// From here on it ran a policy that is not in the recording.
    NoPolicy { seq: u64 },
}

/// A controller that sees what the recorded one saw.
pub(super) struct Twin<'a> {
    fresh: WireController<'a>,
    /// What it may be by now, the likeliest first.
    now: Vec<WireController<'a>>,
    swaps: VecDeque<Swap<'a>>,
    /// Whether some of what it may be was left out.
    is_pruned: bool,
}

impl<'a> Twin<'a> {
    pub(super) fn new(fresh: WireController<'a>, swaps: VecDeque<Swap<'a>>) -> Self {
        Self { now: vec![fresh.clone()], fresh, swaps, is_pruned: false }
    }

    /// Its answer, of a controller that saw every sample.
    pub(super) fn answer(&mut self, answer: &Answer) -> Command {
        let controller = &mut self.now[0];
        for sample in &answer.unanswered {
            controller.tick(Some(sample));
        }
        controller.tick(Some(&answer.sample))
    }

    /// Answers as the recorded one did; says whether it had begun anew before.
    pub(super) fn follow(&mut self, answer: &Answer) -> Result<bool, Parted> {
        let at = (answer.command.run_id, answer.command.seq);
        while let Some(swap) = self.swaps.pop_front_if(|swap| swap.at <= at) {
            let Some(policy) = swap.policy else {
                return Err(Parted::NoPolicy { seq: swap.at.1 });
            };
            self.fresh.swap(policy.clone());
            self.now.iter_mut().for_each(|controller| controller.swap(policy.clone()));
        }
        let recorded = recorded(answer);
        let mut first = None;
        let mut explains = Vec::new();
        'all: for controller in &self.now {
            for seen in seen(&answer.unanswered) {
                match attempt(controller, &seen, answer, &recorded) {
                    Ok(after) => explains.push(after),
                    Err(difference) => {
                        first.get_or_insert(difference);
                    }
                }
                if explains.len() == MOST {
                    self.is_pruned = true;
                    break 'all;
                }
            }
        }
        let mut begun_anew = false;
        if let (Some(first), true) = (first, explains.is_empty()) {
            // A controller process that died and came back knows nothing.
            let mut controller = self.fresh.clone();
            let replayed = controller.tick(Some(&answer.sample));
            if difference(&recorded, &replayed).is_some() {
                return Err(if self.is_pruned {
                    Parted::TooManyWays
                } else {
                    Parted::Different(first)
                });
            }
            begun_anew = true;
            explains.push(controller);
        }
        self.now = explains;
        Ok(begun_anew)
    }
}

/// The controller after it has seen these samples and then the answered
/// one, with as many ticks without any, before it or after, as its count wants.
fn attempt<'a>(
    controller: &WireController<'a>,
    seen: &[&Sample],
    answer: &Answer,
    recorded: &Command,
) -> Result<WireController<'a>, Difference> {
    let play = |before: u32, after: u32| {
        let mut controller = controller.clone();
        for sample in seen {
            controller.tick(Some(sample));
        }
        for _ in 0..before {
            controller.tick(None);
        }
        let mut replayed = controller.tick(Some(&answer.sample));
        for _ in 0..after {
            replayed = controller.tick(None);
        }
        (controller, replayed)
    };
    let (after, replayed) = play(0, 0);
    let Some(found) = difference(recorded, &replayed) else { return Ok(after) };
    // In lock-step the controller has no tick without a sample, and counts none.
    let missing = recorded.rejected.saturating_sub(replayed.rejected);
    if missing <= MOST_MISSING {
        // The command of such a tick carries the number of the last sample: it
        // may have overtaken the answer to that.
        for after in 0..=missing {
            let (after, replayed) = play(missing - after, after);
            if difference(recorded, &replayed).is_none() {
                return Ok(after);
            }
        }
    }
    Err(found)
}

/// What may have been seen of samples that were not answered.
fn seen(unanswered: &[Sample]) -> Vec<Vec<&Sample>> {
    let n = unanswered.len();
    if n <= ANY_OF {
        // All of them first: commands are lost more easily than samples.
        let bits = |mask: u32| {
            let chosen = unanswered.iter().enumerate().filter(move |(i, _)| mask >> i & 1 == 1);
            chosen.map(|(_, sample)| sample).collect()
        };
        (0..1_u32 << n).rev().map(bits).collect()
    } else {
        let up_to = (0..=n).rev().map(|k| unanswered[..k].iter().collect());
        let from = (1..n).map(|k| unanswered[k..].iter().collect());
        up_to.chain(from).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_a_few_samples_may_have_been_seen() {
        let samples = |n: usize| vec![Sample::default(); n];
        assert_eq!(seen(&samples(0)).len(), 1);
        assert_eq!(seen(&samples(3)).len(), 8);
        assert_eq!(seen(&samples(3))[0].len(), 3, "all of them first");
        let ten = samples(10);
        let lengths: Vec<_> = seen(&ten).iter().map(Vec::len).collect();
        assert_eq!(lengths.len(), 20);
        assert_eq!((lengths[0], lengths[10], lengths[11]), (10, 0, 9));
    }
}
