//! Detection of a collapsed training, one that no longer learns.
//!
//! The detector looks in the later half of each stage, every 100 episodes. Early on every
//! training falls; one that learns has stopped falling long before the half. A training has
//! collapsed
//!
//! - if it falls at once: at least 495 of the latest 500 episodes, all in the later half,
//!   ended at their first step. For the presets and seeds 0 to 9 (`robust`: 0 and 1) the
//!   share never exceeds 0.62 in a training that learns (the preset `universal`, in which half
//!   the seeds learn one medium only), and is 1.00 throughout in the one that does not learn
//!   (`water` with seed 0, and so `water-to-air`);
//! - if its actor is saturated: the touchdown angle is within a thousandth of the same end of
//!   its tanh for every observation of a grid, after 500 episodes of the later half. The slope
//!   there is below 0.2 %, so no update leads back. (The elongation speed may be at its lower
//!   end everywhere, which is right on land.)

use super::recent::RecentEpisodes;
use crate::config::Config;
use crate::train::Training;

/// Number of latest episodes that are examined.
const WINDOW: usize = 500;
/// Number of these that ended at their first step in a collapsed training.
const OVER_AT_ONCE: usize = 495;
/// Number of episodes between two checks.
const EVERY: u64 = 100;
/// Share of its range from which an output counts as saturated.
const SATURATED: f32 = 0.999;

/// A training that no longer learns.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "training collapsed by step {step}: {symptom}; take another seed or lower the \
     learning rates"
)]
pub struct CollapseError {
    /// Environment step at which it was found, over all stages.
    pub step: u64,
    /// The symptom.
    pub symptom: Symptom,
}

/// The symptom of a collapse.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Symptom {
    /// Nearly every episode ends at its first step.
    #[error(
        "{over} of the latest {WINDOW} episodes were over at their first step, with a mean reward of {reward:.3}"
    )]
    Falls {
        /// Number of episodes that ended at their first step.
        over: usize,
        /// Their mean reward.
        reward: f64,
    },
    /// The touchdown angle is at one end of its range; true for the upper end.
    #[error(
        "the actor's touchdown angle is at its {} end whatever the observation",
        if *.0 { "upper" } else { "lower" }
    )]
    Saturated(bool),
}

/// Detects a collapse.
#[derive(Clone, Debug)]
pub struct CollapseDetector {
    /// Largest touchdown angle of the actor, in unit space.
    end: f32,
    /// Whether episodes can be longer than one step; else every episode ends at its first.
    long: bool,
}

impl CollapseDetector {
    /// Creates the detector for a training with this configuration.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let n = &config.network;
        Self { end: n.output_gain[0].min(n.output_bound), long: config.episode.max_steps > 1 }
    }

    /// Checks a training after an episode.
    ///
    /// # Errors
    /// [`CollapseError`] when the training has collapsed.
    pub fn check(
        &self,
        training: &mut Training,
        recent: &RecentEpisodes,
    ) -> Result<(), CollapseError> {
        let late = recent.late();
        if late < WINDOW as u64 || !late.is_multiple_of(EVERY) {
            return Ok(());
        }
        let step = training.total_steps();
        let (over, reward) = recent.over_at_once(WINDOW);
        if self.long && over >= OVER_AT_ONCE {
            return Err(CollapseError { step, symptom: Symptom::Falls { over, reward } });
        }
        match self.saturated(training) {
            Some(upper) => Err(CollapseError { step, symptom: Symptom::Saturated(upper) }),
            None => Ok(()),
        }
    }

    /// Returns the end at which the touchdown angle always is, true for the upper; `None` when
    /// it varies.
    fn saturated(&self, training: &mut Training) -> Option<bool> {
        let mut ends = Vec::new();
        for vx in [-6.0, -2.0, -0.5, 0.0, 0.5, 2.0, 6.0] {
            for y in [1.1, 1.5, 3.0, 6.0] {
                for density in [0.0, 0.1, 0.5, 1.0] {
                    let share = training.act([vx, y, density])[0] / self.end;
                    if share.abs() < SATURATED {
                        return None;
                    }
                    ends.push(share > 0.0);
                }
            }
        }
        let first = *ends.first()?;
        ends.iter().all(|&end| end == first).then_some(first)
    }
}
