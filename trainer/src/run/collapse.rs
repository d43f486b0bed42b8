//! Whether a training has collapsed: it goes on, but learns nothing any more.
//!
//! Looked for in the later half of each stage, every 100 episodes; early on every
//! training falls, and one that learns has stopped falling long before the half.
//! Collapsed is
//!
//! - a training that falls at once: of the latest 500 episodes, all in the later
//!   half, at least 495 were over at their first step. In the presets, seeds 0 to 9
//!   (`robust`: 0 and 1), the share never passes 0.62 in a training that learns (the
//!   preset `universal`, of which half the seeds learn one medium only), and is 1.00
//!   throughout in the one that does not (`water` with seed 0, and so `water-to-air`);
//! - an actor that is saturated: its touchdown angle is at the same end of its
//!   tanh, within a thousandth, for every observation of a grid, after 500 episodes
//!   of the later half. Its slope there is below 0.2 %, so no update leads back.
//!   (The elongation speed may be at its lower end everywhere: on land that is right.)

use super::recent::RecentEpisodes;
use crate::config::Config;
use crate::train::Training;

/// Episodes of the later half that are looked at.
const WINDOW: usize = 500;
/// Of these, over at their first step.
const OVER_AT_ONCE: usize = 495;
/// Episodes from one look to the next.
const EVERY: u64 = 100;
/// Share of its range at which an output counts as saturated.
const SATURATED: f32 = 0.999;

/// A training that collapsed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "training collapsed by step {step}: {seen}; take another seed, lower the learning rates, or \
     let it go on with --allow-collapse"
)]
pub struct CollapseError {
    /// The environment step.
    pub step: u64,
    /// What was seen.
    pub seen: Symptom,
}

/// What a collapse was seen by.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Symptom {
    /// It falls at once.
    #[error(
        "{over} of the latest {WINDOW} episodes were over at their first step, with a mean reward of {reward:.3}"
    )]
    Falls {
        /// Episodes.
        over: usize,
        /// Mean reward.
        reward: f64,
    },
    /// The actor is saturated.
    #[error(
        "the actor's touchdown angle is at its {} end whatever the observation",
        if *.0 { "upper" } else { "lower" }
    )]
    Saturated(bool),
}

/// Looks for a collapse.
#[derive(Clone, Debug)]
pub struct Watch {
    /// Of the touchdown angle, in unit space: where the actor's output ends.
    end: f32,
    /// Where episodes are one step long, all of them are over at once.
    long: bool,
}

impl Watch {
    /// For a training with this configuration.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let n = &config.network;
        Self { end: n.output_gain[0].min(n.output_bound), long: config.episode.max_steps > 1 }
    }

    /// After an episode.
    ///
    /// # Errors
    /// [`CollapseError`] when it is one.
    pub fn look(
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
            return Err(CollapseError { step, seen: Symptom::Falls { over, reward } });
        }
        match self.saturated(training) {
            Some(upper) => Err(CollapseError { step, seen: Symptom::Saturated(upper) }),
            None => Ok(()),
        }
    }

    /// At which end the touchdown angle always is, if it is: true for the upper.
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
