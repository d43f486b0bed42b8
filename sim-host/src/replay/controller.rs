//! The controller under replay, when the recording does not show what it received.
//!
//! In real time a recording has samples without a command. The controller may
//! have missed such a sample, or answered it too late; it may also have ticked
//! without a sample, which shows only in its count of rejected ticks. The replay
//! therefore keeps every controller state that explains the commands recorded so
//! far: it tries each plausible set of received samples from each kept state, and
//! keeps the results whose command equals the recorded one bit for bit. The
//! recording is reproducible if at least one state is left at its end.

use std::collections::VecDeque;

use leg_control::policy::Policy;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;

use super::compare::{Difference, difference};
use super::source::Answer;

/// Most controller states kept. In flight an additional sample changes a command
/// only at the next apex, so each unanswered sample doubles the number of states
/// until then; at the apex few states give the recorded bits.
const MAX_CANDIDATES: usize = 1024;
/// Up to this many unanswered samples, every subset is tried; of more, only the
/// subsets that are a prefix or a suffix.
const MAX_ALL_SUBSETS: usize = 4;
/// Most ticks without a sample between two answers.
const MAX_EMPTY_TICKS: u32 = 64;

/// A policy that the controller received before a tick.
#[derive(Clone, Debug)]
pub(super) struct Swap<'a> {
    /// Run id and tick.
    pub(super) at: (u32, u64),
    /// `None` if the recording does not contain the policy.
    pub(super) policy: Option<Policy<'a>>,
}

/// Why the recorded commands cannot be reproduced.
#[derive(Debug)]
pub(super) enum Divergence {
    /// The commands differ.
    Different(Difference),
    /// No kept state explains the command, but states were discarded before.
    TooManyCandidates,
    /// The controller received a policy that the recording does not contain.
    NoPolicy { seq: u64 },
}

/// What the controller did before an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Continuity {
    /// It continued from its earlier state.
    Continued,
    /// It started again without any state.
    Restarted,
}

/// A controller that follows the recorded one.
pub(super) struct ReplayController<'a> {
    /// A controller without any state, under the current policy.
    fresh: WireController<'a>,
    /// The states that explain the recording so far, the most likely first.
    candidates: Vec<WireController<'a>>,
    swaps: VecDeque<Swap<'a>>,
    /// Some states were discarded.
    is_pruned: bool,
}

impl<'a> ReplayController<'a> {
    pub(super) fn new(fresh: WireController<'a>, swaps: VecDeque<Swap<'a>>) -> Self {
        Self { candidates: vec![fresh.clone()], fresh, swaps, is_pruned: false }
    }

    /// Returns the command of a controller that received every sample.
    pub(super) fn command(&mut self, answer: &Answer) -> Command {
        let controller = &mut self.candidates[0];
        for sample in &answer.unanswered {
            controller.tick(Some(sample));
        }
        controller.tick(Some(&answer.sample))
    }

    /// Advances to the recorded answer.
    pub(super) fn follow(&mut self, answer: &Answer) -> Result<Continuity, Divergence> {
        self.swap_policies(answer)?;
        let mut first_difference = None;
        let mut next = Vec::new();
        'all: for controller in &self.candidates {
            for received in plausible_subsets(&answer.unanswered) {
                match attempt(controller, &received, answer) {
                    Ok(after) => next.push(after),
                    Err(difference) => {
                        first_difference.get_or_insert(difference);
                    }
                }
                if next.len() == MAX_CANDIDATES {
                    self.is_pruned = true;
                    break 'all;
                }
            }
        }
        let mut continuity = Continuity::Continued;
        if let (Some(first_difference), true) = (first_difference, next.is_empty()) {
            next.push(self.restarted(answer).ok_or(if self.is_pruned {
                Divergence::TooManyCandidates
            } else {
                Divergence::Different(first_difference)
            })?);
            continuity = Continuity::Restarted;
        }
        self.candidates = next;
        Ok(continuity)
    }

    /// Gives all controllers the policies that the recorded one received by now.
    fn swap_policies(&mut self, answer: &Answer) -> Result<(), Divergence> {
        let now = (answer.command.header.run_id, answer.command.header.seq);
        while let Some(swap) = self.swaps.pop_front_if(|swap| swap.at <= now) {
            let Some(policy) = swap.policy else {
                return Err(Divergence::NoPolicy { seq: swap.at.1 });
            };
            self.fresh.swap(policy.clone());
            self.candidates.iter_mut().for_each(|controller| controller.swap(policy.clone()));
        }
        Ok(())
    }

    /// Returns a controller process that was started again before this sample, if
    /// that explains the command.
    fn restarted(&self, answer: &Answer) -> Option<WireController<'a>> {
        let mut controller = self.fresh.clone();
        let replayed = controller.tick(Some(&answer.sample));
        difference(&answer.command, &replayed).is_none().then_some(controller)
    }
}

/// Returns the controller after it received these samples and then the answered
/// one, with as many ticks without a sample before or after as its count of
/// rejected ticks requires.
fn attempt<'a>(
    controller: &WireController<'a>,
    received: &[&Sample],
    answer: &Answer,
) -> Result<WireController<'a>, Difference> {
    let play = |empty_before: u32, empty_after: u32| {
        let mut controller = controller.clone();
        for sample in received {
            controller.tick(Some(sample));
        }
        for _ in 0..empty_before {
            controller.tick(None);
        }
        let mut replayed = controller.tick(Some(&answer.sample));
        for _ in 0..empty_after {
            replayed = controller.tick(None);
        }
        (controller, replayed)
    };
    let (after, replayed) = play(0, 0);
    let Some(found) = difference(&answer.command, &replayed) else { return Ok(after) };
    // In lock-step this is 0: the controller has no ticks without a sample.
    let empty_ticks = answer.command.rejected.saturating_sub(replayed.rejected);
    if empty_ticks <= MAX_EMPTY_TICKS {
        // The command of a tick without a sample carries the number of the last sample, so it
        // may have replaced the answer to that sample before the leg received it.
        for empty_after in 0..=empty_ticks {
            let (after, replayed) = play(empty_ticks - empty_after, empty_after);
            if difference(&answer.command, &replayed).is_none() {
                return Ok(after);
            }
        }
    }
    Err(found)
}

/// Returns the sets of unanswered samples that the controller may have received,
/// the most likely first: commands are lost more often than samples.
fn plausible_subsets(unanswered: &[Sample]) -> Vec<Vec<&Sample>> {
    let n = unanswered.len();
    if n <= MAX_ALL_SUBSETS {
        let subset = |mask: u32| {
            let chosen = unanswered.iter().enumerate().filter(move |(i, _)| mask >> i & 1 == 1);
            chosen.map(|(_, sample)| sample).collect()
        };
        (0..1_u32 << n).rev().map(subset).collect()
    } else {
        let prefixes = (0..=n).rev().map(|k| unanswered[..k].iter().collect());
        let suffixes = (1..n).map(|k| unanswered[k..].iter().collect());
        prefixes.chain(suffixes).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tries_every_subset_of_few_samples_and_prefixes_and_suffixes_of_many() {
        let samples = |n: usize| vec![Sample::default(); n];
        assert_eq!(plausible_subsets(&samples(0)).len(), 1);
        assert_eq!(plausible_subsets(&samples(3)).len(), 8);
        assert_eq!(plausible_subsets(&samples(3))[0].len(), 3, "all of them first");
        let ten = samples(10);
        let lengths: Vec<_> = plausible_subsets(&ten).iter().map(Vec::len).collect();
        assert_eq!(lengths.len(), 20);
        assert_eq!((lengths[0], lengths[10], lengths[11]), (10, 0, 9));
    }
}
