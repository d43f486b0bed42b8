//! The latest episodes.

use crate::train::EpisodeRecord;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Episodes that count as the latest.
const LATEST: usize = 1000;

/// What is remembered of an episode.
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
    /// Episodes so far in the later half of the present stage.
    late: u64,
}

impl RecentEpisodes {
    /// One more episode, that left its stage done by `share`. `full`: as long as
    /// an episode can be.
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

    /// Mean of the rewards.
    #[must_use]
    pub fn reward(&self) -> f64 {
        self.mean(|e| e.reward)
    }

    /// Share of episodes as long as they can be.
    #[must_use]
    pub fn full(&self) -> f64 {
        self.mean(|e| f64::from(u8::from(e.full)))
    }

    /// Episodes so far in the later half of the present stage.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Of the latest `count` episodes: how many were over at their first step, and
    /// the mean reward.
    #[must_use]
    pub fn over_at_once(&self, count: usize) -> (usize, f64) {
        let latest = || self.episodes.iter().rev().take(count);
        let reward = latest().map(|e| e.reward).sum::<f64>() / count as f64;
        (latest().filter(|e| e.steps == 1).count(), reward)
    }
}
