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

use leg_control::estimator::Estimate;
use leg_control::wire::{Command, Sample};
use leg_control::wire_controller::WireController;
use leg_host::recorded::{SetPoints, Swap};

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
/// Most tries for an answer, each of some ticks of a controller.
const MAX_TRIES: usize = 8 * MAX_CANDIDATES;
/// Most ways to place the ticks without a sample that are tried for each set of samples.
const MAX_PLACEMENTS: usize = 256;

/// Why the recorded commands cannot be reproduced.
#[derive(Debug)]
pub(super) enum Divergence {
    /// The commands differ.
    Different(Difference),
    /// No kept state explains the command, but not every possible one was tried: those of this
    /// gap were not.
    Unknown(Gap),
    /// The controller received a policy that the recording does not contain.
    NoPolicy { seq: u64 },
}

/// Samples of which not every set was tried that the controller may have received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gap {
    /// Number of samples without a command; 0 if the ticks without a sample were too many.
    pub(super) unanswered: usize,
    /// Ticks of the first of these samples and of the answer after them.
    pub(super) ticks: [u64; 2],
}

impl Gap {
    fn before(answer: &Answer) -> Self {
        let last = answer.sample.header.seq;
        let first = answer.unanswered.first().map_or(last, |sample| sample.header.seq);
        Self { unanswered: answer.unanswered.len(), ticks: [first, last] }
    }
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
    set_points: SetPoints,
    /// The longest gap at which some states were not tried or discarded.
    cut: Option<Gap>,
}

impl<'a> ReplayController<'a> {
    pub(super) fn new(
        fresh: WireController<'a>,
        swaps: VecDeque<Swap<'a>>,
        set_points: SetPoints,
    ) -> Self {
        Self { candidates: vec![fresh.clone()], fresh, swaps, set_points, cut: None }
    }

    /// Returns the command of a controller that received every sample.
    pub(super) fn command(&mut self, answer: &Answer) -> Command {
        let controller = &mut self.candidates[0];
        let header = &answer.sample.header;
        for sample in &answer.unanswered {
            self.set_points.tick(controller, Some(sample), header);
        }
        self.set_points.tick(controller, Some(&answer.sample), header)
    }

    /// Returns the estimate after the last answer, if all states that explain the recording
    /// have the same.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        let mut all = self.candidates.iter().map(WireController::estimate);
        let first = all.next()??;
        // Estimates are finite, so equal ones have equal bits but for the sign of a zero.
        all.all(|other| other == Some(first)).then_some(first)
    }

    /// Advances to the recorded answer.
    pub(super) fn follow(&mut self, answer: &Answer) -> Result<Continuity, Divergence> {
        self.swap_policies(answer)?;
        let mut first_difference = None;
        let mut next = Vec::new();
        // Not every set of more samples is tried.
        let mut is_cut = answer.unanswered.len() > MAX_ALL_SUBSETS;
        let mut tries = 0;
        'all: for controller in &self.candidates {
            for received in plausible_subsets(&answer.unanswered) {
                let found = explanations(controller, &self.set_points, &received, answer);
                next.extend(found.after);
                tries += found.tries;
                is_cut |= !found.is_complete;
                first_difference = first_difference.or(found.difference);
                if next.len() > MAX_CANDIDATES || tries > MAX_TRIES {
                    next.truncate(MAX_CANDIDATES);
                    is_cut = true;
                    break 'all;
                }
            }
        }
        if is_cut {
            let gap = Gap::before(answer);
            self.cut = self.cut.filter(|cut| cut.unanswered > gap.unanswered).or(Some(gap));
        }
        let mut continuity = Continuity::Continued;
        if let (Some(first_difference), true) = (first_difference, next.is_empty()) {
            let divergence =
                self.cut.map_or(Divergence::Different(first_difference), Divergence::Unknown);
            next.push(self.restarted(answer).ok_or(divergence)?);
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
        let sample = &answer.sample;
        let replayed = self.set_points.tick(&mut controller, Some(sample), &sample.header);
        difference(&answer.command, &replayed).is_none().then_some(controller)
    }
}

/// The controllers after an answer that they explain.
struct Explanations<'a> {
    after: Vec<WireController<'a>>,
    /// Number of possibilities tried, and whether these are all.
    tries: usize,
    is_complete: bool,
    /// The difference without ticks without a sample; `None` if there is none.
    difference: Option<Difference>,
}

/// Returns the controllers after they received these samples and then the answered one, with as
/// many ticks without a sample as the count of rejected ticks allows, wherever these may have
/// been. In lock-step there are none.
///
/// A sample that is rejected, as the first one after a long gap may be, need not be if there were
/// ticks without a sample before it: it and such a tick count the same.
fn explanations<'a>(
    controller: &WireController<'a>,
    set_points: &SetPoints,
    received: &[&Sample],
    answer: &Answer,
) -> Explanations<'a> {
    let samples = || received.iter().copied().chain([&answer.sample]);
    // `empty[i]` ticks without a sample before sample i, the last ones after all samples: the
    // command of a tick without a sample carries the number of the last sample, so it may have
    // replaced the answer to that sample before the leg received it.
    let play = |empty: &[u32]| {
        let mut controller = controller.clone();
        let mut replayed = Command::default();
        let mut last = received.first().map_or(answer.sample.header, |sample| sample.header);
        for (i, count) in empty.iter().enumerate() {
            for _ in 0..*count {
                replayed = set_points.tick(&mut controller, None, &last);
            }
            if let Some(sample) = samples().nth(i) {
                last = sample.header;
                replayed = set_points.tick(&mut controller, Some(sample), &last);
            }
        }
        (controller, replayed)
    };
    let places = received.len() + 2;
    let (first, replayed) = play(&vec![0; places]);
    let found = difference(&answer.command, &replayed);
    let mut explanations = Explanations {
        after: if found.is_none() { vec![first] } else { Vec::new() },
        tries: 1,
        is_complete: true,
        difference: found,
    };
    let recorded = answer.command.rejected;
    let fewest = recorded.saturating_sub(replayed.rejected);
    // A run that begins counts anew.
    let of_samples = replayed.rejected.saturating_sub(controller.counts().rejected());
    let most = fewest + of_samples.min(recorded.saturating_sub(fewest));
    for ticks in fewest.max(1)..=most {
        let (placements, is_complete) = placements(ticks, places);
        explanations.tries += placements.len();
        explanations.is_complete &= is_complete;
        let played = placements.iter().map(|empty| play(empty));
        let same = played.filter(|(_, replayed)| difference(&answer.command, replayed).is_none());
        explanations.after.extend(same.map(|(after, _)| after));
        if explanations.tries > MAX_TRIES {
            explanations.is_complete = false;
            break;
        }
    }
    explanations
}

/// Returns the ways to distribute `ticks`, above 0, over `places`, and whether these are all:
/// of very many, only those at the first and the last two places.
fn placements(ticks: u32, places: usize) -> (Vec<Vec<u32>>, bool) {
    if ticks == 0 {
        return (Vec::new(), true);
    }
    if ticks > MAX_EMPTY_TICKS {
        return (Vec::new(), false);
    }
    let mut all: Vec<Vec<u32>> = vec![Vec::new()];
    for place in 0..places {
        let extend = |part: &Vec<u32>| {
            let left = ticks - part.iter().sum::<u32>();
            // The last place gets the rest.
            let from = if place + 1 == places { left } else { 0 };
            (from..=left).map(|count| [&part[..], &[count]].concat()).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(extend).collect();
        if all.len() > MAX_PLACEMENTS {
            let at = |first: u32, before: u32, after: u32| {
                let mut one = vec![0; places];
                one[0] = first;
                one[places - 2] += before;
                one[places - 1] = after;
                one
            };
            let ends = (0..=ticks).flat_map(|n| [at(n, 0, ticks - n), at(0, n, ticks - n)]);
            let mut some: Vec<_> = ends.collect();
            some.sort_unstable();
            some.dedup();
            return (some, false);
        }
    }
    (all, true)
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
    use leg_control::config::Config;
    use leg_control::policy::{Policy, SHIPPED};
    use leg_control::wire::{Header, WIRE_VERSION, flags};

    use super::*;

    #[test]
    fn places_ticks_without_a_sample_everywhere_or_reports_that_it_does_not() {
        assert_eq!(placements(0, 3), (vec![], true));
        let (all, is_complete) = placements(2, 3);
        assert!(is_complete);
        assert_eq!(all.len(), 6, "{all:?}");
        assert!(all.iter().all(|one| one.len() == 3 && one.iter().sum::<u32>() == 2), "{all:?}");
        let (some, is_complete) = placements(40, 6);
        assert!(!is_complete && some.len() == 81, "{}", some.len());
        assert!(some.iter().all(|one| one.len() == 6 && one.iter().sum::<u32>() == 40));
        assert_eq!(placements(MAX_EMPTY_TICKS + 1, 3), (vec![], false));
    }

    /// A sample of a leg that falls from an apex.
    fn falling(seq: u64) -> Sample {
        let t_s = seq as f32 * 1e-3;
        let header = Header {
            version: WIRE_VERSION,
            flags: flags::STATE_SENSED | flags::CONTACT_SENSED,
            run_id: 1,
            seq,
            t_ns: seq * 1_000_000,
        };
        Sample { header, y_m: 2.0 - 4.905 * t_s * t_s, vy_m_s: -9.81 * t_s, ..Sample::default() }
    }

    /// The first commands are the safe one and do not show where the tick without a sample was;
    /// the tick at which the controller leaves the safe state does.
    #[test]
    fn follows_a_tick_without_a_sample_wherever_it_was() {
        let config = Config::at_rate(1000).unwrap();
        let fresh = || WireController::new(Policy::parse(SHIPPED).unwrap(), config);
        for ticks in [
            [None, Some(0), Some(1), Some(2)],
            [Some(0), None, Some(1), Some(2)],
            [Some(0), Some(1), None, Some(2)],
            [Some(0), Some(1), Some(2), None],
            [Some(0), Some(2), None, None],
            [None, Some(0), None, Some(2)],
        ] {
            let mut recorded = fresh();
            let mut replayed =
                ReplayController::new(fresh(), VecDeque::new(), SetPoints::default());
            // The answers to the first samples were lost.
            let mut command = Command::default();
            for tick in ticks {
                command = recorded.tick(tick.map(falling).as_ref());
            }
            let unanswered = vec![falling(0), falling(1)];
            let first = Answer { sample: falling(2), unanswered, command, gap: None };
            replayed.follow(&first).unwrap();
            for seq in 3..50 {
                let (sample, unanswered) = (falling(seq), Vec::new());
                let command = recorded.tick(Some(&sample));
                let answer = Answer { sample, unanswered, command, gap: None };
                let followed = replayed.follow(&answer);
                assert!(matches!(followed, Ok(Continuity::Continued)), "{ticks:?}, tick {seq}");
            }
            assert!(!recorded.tick(Some(&falling(50))).is_safe(), "it has left the safe state");
        }
    }

    /// A sample after a long gap is rejected, or not, by what the controller ticked in the gap, so
    /// the count of rejected ticks does not tell how many of them had no sample.
    #[test]
    fn follows_any_number_of_ticks_without_a_sample_in_a_gap_of_any_length() {
        let config = Config::at_rate(1000).unwrap();
        let fresh = || WireController::new(Policy::parse(SHIPPED).unwrap(), config);
        let answer = |recorded: &mut WireController<'_>, seq, unanswered| {
            let sample = falling(seq);
            Answer { sample, unanswered, command: recorded.tick(Some(&sample)), gap: None }
        };
        for gap in [0, 1, 4, 9, 10, 19, 20, 21, 40] {
            for empty in 0..=gap.min(25) {
                let mut recorded = fresh();
                let mut replayed =
                    ReplayController::new(fresh(), VecDeque::new(), SetPoints::default());
                for seq in 0..20 {
                    replayed.follow(&answer(&mut recorded, seq, Vec::new())).unwrap();
                }
                (0..empty).for_each(|_| _ = recorded.tick(None));
                let after = 20 + gap;
                let first = answer(&mut recorded, after, (20..after).map(falling).collect());
                replayed.follow(&first).unwrap();
                for seq in after + 1..after + 30 {
                    let followed = replayed.follow(&answer(&mut recorded, seq, Vec::new()));
                    let is_followed = matches!(followed, Ok(Continuity::Continued));
                    assert!(is_followed, "{empty} of {gap}, tick {seq}: {followed:?}");
                }
            }
        }
    }

    /// Of ten samples only prefixes and suffixes are tried, and the controller received others.
    #[test]
    fn names_the_gap_of_which_it_has_not_tried_every_set_of_samples() {
        let config = Config::at_rate(1000).unwrap();
        let fresh = || WireController::new(Policy::parse(SHIPPED).unwrap(), config);
        let mut recorded = fresh();
        let mut replayed = ReplayController::new(fresh(), VecDeque::new(), SetPoints::default());
        let mut answer = |seq, unanswered: Vec<Sample>, received: &[u64]| {
            for seq in received {
                recorded.tick(Some(&falling(*seq)));
            }
            let sample = falling(seq);
            Answer { sample, unanswered, command: recorded.tick(Some(&sample)), gap: None }
        };
        for seq in 0..100 {
            replayed.follow(&answer(seq, Vec::new(), &[])).unwrap();
        }
        // A command that no set explains, as one after samples in the middle may be.
        let mut different = answer(110, (100..110).map(falling).collect(), &[103, 105]);
        different.command.leg_angle_rad += 0.1;
        let unknown = replayed.follow(&different);
        let gap = Gap { unanswered: 10, ticks: [100, 110] };
        assert!(matches!(unknown, Err(Divergence::Unknown(found)) if found == gap), "{unknown:?}");
        // Where every set was tried, it is certain.
        let mut replayed = ReplayController::new(fresh(), VecDeque::new(), SetPoints::default());
        let mut first = Answer { unanswered: Vec::new(), ..different };
        first.sample = falling(0);
        first.command.header = first.sample.header;
        let different = replayed.follow(&first);
        assert!(matches!(different, Err(Divergence::Different(_))), "{different:?}");
    }

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
