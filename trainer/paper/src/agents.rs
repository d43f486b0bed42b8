//! The paper's agents, trained by our trainer under the paper's presets.

use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Extent, FigureContext, FiguresError};
use crate::analysis::apex_run::run_policy;
use trainer::Isa;
use trainer::Layer;
use trainer::evaluate::hopper;
use trainer::evaluate::survival::draw_starts;
use trainer::policy::PackedActor;
use trainer::preset::Preset;
use trainer::train::Training;

/// Number of starts by which transferred agents are ranked, and of hops from each.
const STARTS: usize = 500;
const HOPS: usize = 60;
/// Approximate time that an episode takes, s.
const EPISODE_S: f64 = 1.2e-4;

/// An agent of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PaperAgent {
    /// Trained in air only.
    Air,
    /// Trained in water, then in air: two stages, with an agent after each.
    WaterToAir,
    /// Trained in water and air alternately.
    Universal,
}

impl PaperAgent {
    fn preset(self) -> Preset {
        match self {
            Self::Air => Preset::Air,
            Self::WaterToAir => Preset::WaterToAir,
            Self::Universal => Preset::Universal,
        }
    }

    /// Returns its whole training configuration, as an input of a cached step.
    #[must_use]
    pub fn config_toml(self) -> String {
        self.preset().config().to_toml()
    }

    /// Returns its name in file names and messages.
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
    /// Number of its steps, at most 5.
    pub steps: u32,
}

/// A stage of a training, and the agent at its end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Its episodes, in order.
    pub episodes: Vec<Episode>,
    /// The actor's layers: number of inputs, weights with a row for each output, biases.
    layers: Vec<(usize, Vec<f32>, Vec<f32>)>,
}

/// An agent with its whole training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedAgent {
    /// The agent of the paper.
    pub agent: PaperAgent,
    /// The seed of the training.
    pub seed: u64,
    /// The stages of the training, in order.
    pub stages: Vec<Stage>,
}

impl TrainedAgent {
    /// Returns the actor at the end of a stage, counted from 0.
    ///
    /// # Panics
    /// Panics if there is no such stage.
    #[must_use]
    pub fn actor_after(&self, stage: usize) -> PackedActor {
        let layers = self.stages[stage].layers.iter().map(|(inputs, weights, bias)| Layer {
            inputs: *inputs,
            weights: weights.clone(),
            bias: bias.clone(),
        });
        let layers: [Layer; 3] =
            layers.collect::<Vec<_>>().try_into().expect("an actor has three layers");
        PackedActor::trained(&self.agent.preset().config(), &layers)
    }

    /// Returns the actor at the end of the training.
    #[must_use]
    pub fn actor(&self) -> PackedActor {
        self.actor_after(self.stages.len() - 1)
    }
}

/// Returns the seeds that the learning curves are drawn from.
#[must_use]
pub(crate) fn seeds(extent: Extent) -> std::ops::Range<u64> {
    0..extent.of(100, 4)
}

/// Returns the approximate time to train an agent with all [`seeds`] on two cores, s.
#[must_use]
pub(crate) fn cost_s(agent: PaperAgent, extent: Extent) -> f64 {
    seeds(extent).count() as f64 * one_cost_s(agent) / 2.0
}

fn one_cost_s(agent: PaperAgent) -> f64 {
    let episodes: u64 = agent.preset().config().stages.iter().map(|s| s.length.count()).sum();
    episodes as f64 * EPISODE_S
}

impl FigureContext {
    /// Trains an agent with every seed, and returns them by ascending seed.
    ///
    /// # Errors
    /// [`FiguresError::Training`] or [`FiguresError::Write`].
    pub fn trainings(&self, agent: PaperAgent) -> Result<Vec<TrainedAgent>, FiguresError> {
        seeds(self.extent)
            .collect::<Vec<_>>()
            .into_par_iter()
            .with_max_len(1)
            .map(|seed| self.training(agent, seed))
            .collect()
    }

    /// Trains an agent with one seed.
    ///
    /// # Errors
    /// [`FiguresError::Training`] or [`FiguresError::Write`].
    pub fn training(&self, agent: PaperAgent, seed: u64) -> Result<TrainedAgent, FiguresError> {
        let config = agent.config_toml();
        let name = format!("{}-{seed}", agent.name());
        self.cached(&name, &config, one_cost_s(agent) / 2.0, || train(agent, seed))
    }

    /// Trains the transferred agent with every seed, and chooses the one to draw.
    ///
    /// # Errors
    /// [`FiguresError::Training`] or [`FiguresError::Write`].
    pub fn transferred(&self) -> Result<Transferred, FiguresError> {
        let all = self.trainings(PaperAgent::WaterToAir)?;
        let inputs = (PaperAgent::WaterToAir.config_toml(), all.len(), STARTS);
        let shares: Vec<[f64; 2]> = self.cached("survival-by-seed", &inputs, 0.0, || {
            // Not the starts that the figures use.
            let starts = draw_starts(STARTS, &mut Pcg64::seed_from_u64(12));
            Ok(all.iter().map(|agent| survival_shares(agent, &starts)).collect())
        })?;
        let worse = |i: usize| shares[i][0].min(shares[i][1]);
        let best = (0..all.len())
            .max_by(|a, b| worse(*a).total_cmp(&worse(*b)).then(b.cmp(a)))
            .expect("at least one seed");
        let seed = all[best].seed;
        let chosen = format!("drawn: seed {seed}, {CHOICE}");
        self.note_policy(
            "water, transferred",
            origin(PaperAgent::WaterToAir, &seeds(self.extent), &chosen),
        );
        let on_land = shares.iter().map(|shares| shares[1]).collect();
        Ok(Transferred { all, on_land, best })
    }
}

/// Returns the shares of the starts from which an agent takes [`HOPS`] hops: in water
/// after its first stage, and on land after its last.
fn survival_shares(agent: &TrainedAgent, starts: &[Apex]) -> [f64; 2] {
    [(agent.actor_after(0), 1.0), (agent.actor(), 0.0)].map(|(frozen, rho)| {
        let (actor, hopper) = (frozen.actor(), hopper(rho));
        let survives =
            |start: &&Apex| !run_policy(&actor, &hopper, rho, **start, HOPS, |_| 0.0).fell;
        starts.par_iter().filter(survives).count() as f64 / starts.len() as f64
    })
}

/// Why the drawn seed is drawn.
pub(crate) const CHOICE: &str = "which survives from the most starts in water and on land";

/// The transferred agents.
#[derive(Debug)]
pub struct Transferred {
    /// One for each seed, by ascending seed.
    pub all: Vec<TrainedAgent>,
    /// Share of the starts from which each survives on land.
    pub on_land: Vec<f64>,
    best: usize,
}

impl Transferred {
    /// Returns the agent that is drawn: the seed that survives from the most starts, in
    /// water after its first stage or on land after its last, whichever are fewer.
    /// Verdicts are over all seeds.
    #[must_use]
    pub fn shown(&self) -> &TrainedAgent {
        &self.all[self.best]
    }
}

/// Returns an agent's origin in words.
pub(crate) fn origin(agent: PaperAgent, seeds: &std::ops::Range<u64>, chosen: &str) -> String {
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

fn train(agent: PaperAgent, seed: u64) -> Result<TrainedAgent, FiguresError> {
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
            let (frozen, _) = training.best_actor();
            let layers = frozen.layers().into_iter().map(|l| (l.inputs, l.weights, l.bias));
            stages
                .push(Stage { episodes: std::mem::take(&mut episodes), layers: layers.collect() });
        }
    }
    Ok(TrainedAgent { agent, seed, stages })
}
