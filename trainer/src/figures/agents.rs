//! The paper's agents, trained by our trainer under the paper's presets.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Extent, FiguresError, Workshop};
use crate::net::mlp::Layer;
use crate::policy::Frozen;
use crate::preset::Preset;
use crate::simd::Isa;
use crate::train::Training;

/// Seconds that an episode takes, roughly.
const EPISODE_S: f64 = 1.2e-4;

/// An agent of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Paper {
    /// Trained in air alone.
    Air,
    /// Trained in water, then in air: both stages, and the agent after each.
    WaterToAir,
    /// Trained in water and air in turn.
    Universal,
}

impl Paper {
    fn preset(self) -> Preset {
        match self {
            Self::Air => Preset::Air,
            Self::WaterToAir => Preset::WaterToAir,
            Self::Universal => Preset::Universal,
        }
    }

    /// Its name in file names and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Air => "air",
            Self::WaterToAir => "water-to-air",
            Self::Universal => "universal",
        }
    }
}

/// An episode of a training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Sum of its rewards.
    pub reward: f64,
    /// Its steps.
    pub steps: u32,
}

/// A stage of a training, and the agent that it left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Its episodes, in their order.
    pub episodes: Vec<Episode>,
    /// The actor's layers: inputs, weights row by output, biases.
    layers: Vec<(usize, Vec<f32>, Vec<f32>)>,
}

/// A whole training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Learnt {
    /// Which agent.
    pub agent: Paper,
    /// Its seed.
    pub seed: u64,
    /// Its stages.
    pub stages: Vec<Stage>,
}

impl Learnt {
    /// The actor after a stage, from 0.
    ///
    /// # Panics
    /// When there is no such stage.
    #[must_use]
    pub fn actor_after(&self, stage: usize) -> Frozen {
        let layers = self.stages[stage].layers.iter().map(|(inputs, weights, bias)| Layer {
            inputs: *inputs,
            weights: weights.clone(),
            bias: bias.clone(),
        });
        let layers: [Layer; 3] =
            layers.collect::<Vec<_>>().try_into().expect("an actor has three layers");
        Frozen::trained(&self.agent.preset().config(), &layers)
    }

    /// The actor at the end.
    #[must_use]
    pub fn actor(&self) -> Frozen {
        self.actor_after(self.stages.len() - 1)
    }
}

/// Seeds that the learning curves are drawn from.
#[must_use]
pub(crate) fn seeds(extent: Extent) -> std::ops::Range<u64> {
    0..extent.of(24, 4)
}

/// Seconds that training an agent over all [`seeds`] takes on two cores.
#[must_use]
pub(crate) fn cost_s(agent: Paper, extent: Extent) -> f64 {
    seeds(extent).count() as f64 * one_cost_s(agent) / 2.0
}

fn one_cost_s(agent: Paper) -> f64 {
    let episodes: u64 = agent.preset().config().stages.iter().map(|s| s.length.count()).sum();
    episodes as f64 * EPISODE_S
}

impl Workshop {
    /// An agent over all [`seeds`], in their order.
    ///
    /// # Errors
    /// [`FiguresError`].
    pub fn trainings(&self, agent: Paper) -> Result<Vec<Learnt>, FiguresError> {
        seeds(self.extent)
            .collect::<Vec<_>>()
            .into_par_iter()
            .with_max_len(1)
            .map(|seed| self.training(agent, seed))
            .collect()
    }

    /// An agent of one seed.
    ///
    /// # Errors
    /// [`FiguresError`].
    pub fn training(&self, agent: Paper, seed: u64) -> Result<Learnt, FiguresError> {
        let config = agent.preset().config().to_toml();
        let name = format!("{}-{seed}", agent.name());
        self.part(&name, &config, one_cost_s(agent) / 2.0, || train(agent, seed))
    }

    /// The transferred agent that stands for all: that of the median seed, by
    /// the mean reward of its last 1,000 episodes.
    ///
    /// # Errors
    /// [`FiguresError`].
    pub fn transferred(&self) -> Result<Learnt, FiguresError> {
        let mut all = self.trainings(Paper::WaterToAir)?;
        all.sort_by(|a, b| last_reward(a).total_cmp(&last_reward(b)));
        let median = all.swap_remove(all.len() / 2);
        let chosen =
            format!("the median by mean reward of the last 1,000 episodes: {}", median.seed);
        self.used("water, transferred", from(Paper::WaterToAir, &seeds(self.extent), &chosen));
        Ok(median)
    }
}

/// Where an agent comes from, in words.
pub(crate) fn from(agent: Paper, seeds: &std::ops::Range<u64>, chosen: &str) -> String {
    let config = agent.preset().config();
    let episodes: Vec<String> =
        config.stages.iter().map(|s| s.length.count().to_string()).collect();
    format!(
        "preset `{}`, {} episodes, seeds {} to {}; {chosen}",
        agent.name(),
        episodes.join(" + "),
        seeds.start,
        seeds.end - 1
    )
}

/// Mean reward of the last 1,000 episodes.
#[must_use]
pub(crate) fn last_reward(learnt: &Learnt) -> f64 {
    let episodes = learnt.stages.last().map_or(&[][..], |stage| &stage.episodes);
    let last = &episodes[episodes.len().saturating_sub(1_000)..];
    last.iter().map(|e| e.reward).sum::<f64>() / last.len().max(1) as f64
}

fn train(agent: Paper, seed: u64) -> Result<Learnt, FiguresError> {
    let diverged = |cause: &dyn ToString| FiguresError::Training {
        agent: agent.name(),
        seed,
        cause: cause.to_string(),
    };
    let mut training = Training::new(agent.preset().config(), seed, Isa::best());
    let mut stages: Vec<Stage> = Vec::new();
    let mut episodes = Vec::new();
    while let Some(record) = training.episode().map_err(|e| diverged(&e))? {
        episodes.push(Episode { reward: record.reward, steps: record.steps });
        if training.stages_done() > stages.len() {
            let (frozen, _) = training.kept();
            let layers = frozen.layers().into_iter().map(|l| (l.inputs, l.weights, l.bias));
            stages
                .push(Stage { episodes: std::mem::take(&mut episodes), layers: layers.collect() });
        }
    }
    Ok(Learnt { agent, seed, stages })
}
