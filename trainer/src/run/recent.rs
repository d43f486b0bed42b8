//! Statistics of the latest episodes.

use crate::train::EpisodeRecord;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Number of episodes in the statistics.
const LATEST: usize = 1000;

/// The record of one episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Episode {
    steps: u32,
    reward: f64,
    full: bool,
}

/// The latest 1,000 episodes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecentEpisodes {
    episodes: VecDeque<Episode>,
    stage: usize,
    /// Number of episodes so far in the later half of the present stage.
    late: u64,
}

impl RecentEpisodes {
    /// Adds an episode. `full` is whether it reached the largest number of steps, `share` the
    /// completed share of its stage after it.
    pub fn push(&mut self, record: &EpisodeRecord, full: bool, share: f64) {
        if self.episodes.len() == LATEST {
            self.episodes.pop_front();
        }
        self.episodes.push_back(Episode { steps: record.steps, reward: record.reward, full });
        if record.stage != self.stage {
            self.stage = record.stage;
            self.late = 0;
        }
        self.late += u64::from(share >= 0.5);
    }

    fn mean(&self, of: impl Fn(&Episode) -> f64) -> f64 {
        self.episodes.iter().map(of).sum::<f64>() / self.episodes.len().max(1) as f64
    }

    /// Returns the mean reward.
    #[must_use]
    pub fn reward(&self) -> f64 {
        self.mean(|e| e.reward)
    }

    /// Returns the share of episodes that reached the largest number of steps.
    #[must_use]
    pub fn full(&self) -> f64 {
        self.mean(|e| f64::from(u8::from(e.full)))
    }

    /// Returns the number of episodes so far in the later half of the present stage.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Returns how many of the latest `count` episodes ended at their first step, and their
    /// mean reward.
    #[must_use]
    pub fn over_at_once(&self, count: usize) -> (usize, f64) {
        let latest = || self.episodes.iter().rev().take(count);
        let reward = latest().map(|e| e.reward).sum::<f64>() / count as f64;
        (latest().filter(|e| e.steps == 1).count(), reward)
    }
}
