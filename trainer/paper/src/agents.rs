//! The paper's agents, trained by our trainer under the paper's presets.

use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Extent, FiguresError, Workshop};
use crate::study::flown::fly;
use trainer::evaluate::hopper;
use trainer::evaluate::survival::draw_starts;
use trainer::net::mlp::Layer;
use trainer::policy::PackedActor;
use trainer::preset::Preset;
use trainer::simd::Isa;
use trainer::train::Training;

/// Starts by which transferred agents are ranked, and hops that each must take.
const STARTS: usize = 500;
const HOPS: usize = 60;
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

    /// All of its training, as an input of a part.
    #[must_use]
    pub fn config_toml(self) -> String {
        self.preset().config().to_toml()
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

    /// The actor at the end.
    #[must_use]
    pub fn actor(&self) -> PackedActor {
        self.actor_after(self.stages.len() - 1)
    }
}

/// Seeds that the learning curves are drawn from.
#[must_use]
pub(crate) fn seeds(extent: Extent) -> std::ops::Range<u64> {
    0..extent.of(100, 4)
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
    /// An agent over all seeds, in their order.
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
        let config = agent.config_toml();
        let name = format!("{}-{seed}", agent.name());
        self.part(&name, &config, one_cost_s(agent) / 2.0, || train(agent, seed))
    }

    /// The transferred agents of all seeds, and which of them is drawn.
    ///
    /// # Errors
    /// [`FiguresError`].
    pub fn transferred(&self) -> Result<Transferred, FiguresError> {
        let all = self.trainings(Paper::WaterToAir)?;
        let inputs = (Paper::WaterToAir.config_toml(), all.len(), STARTS);
        let hops_on: Vec<[f64; 2]> = self.part("hops-on-by-seed", &inputs, 0.0, || {
            // Other starts than those that the figures count.
            let starts = draw_starts(STARTS, &mut Pcg64::seed_from_u64(12));
            Ok(all.iter().map(|learnt| hops_on(learnt, &starts)).collect())
        })?;
        let worse = |i: usize| hops_on[i][0].min(hops_on[i][1]);
        let best = (0..all.len())
            .max_by(|a, b| worse(*a).total_cmp(&worse(*b)).then(b.cmp(a)))
            .expect("at least one seed");
        let seed = all[best].seed;
        let chosen = format!("drawn: {seed}, which hops on from most starts in water and on land");
        self.used("water, transferred", from(Paper::WaterToAir, &seeds(self.extent), &chosen));
        let on_land = hops_on.iter().map(|shares| shares[1]).collect();
        Ok(Transferred { all, on_land, best })
    }
}

/// Share of the starts from which it takes [`HOPS`] hops, after its first stage in
/// water, and after its last on land.
fn hops_on(learnt: &Learnt, starts: &[Apex]) -> [f64; 2] {
    [(learnt.actor_after(0), 1.0), (learnt.actor(), 0.0)].map(|(frozen, rho)| {
        let (actor, hopper) = (frozen.actor(), hopper(rho));
        let lasts = |start: &&Apex| !fly(&actor, &hopper, rho, **start, HOPS, |_| 0.0).fell;
        starts.par_iter().filter(lasts).count() as f64 / starts.len() as f64
    })
}

/// The transferred agents.
#[derive(Debug)]
pub struct Transferred {
    /// Of every seed, in their order.
    pub all: Vec<Learnt>,
    /// Share of the starts from which each hops on, on land.
    pub on_land: Vec<f64>,
    best: usize,
}

impl Transferred {
    /// The one that is drawn: of all seeds that which hops on from most starts, in
    /// water after its first stage and on land after its last, whichever are fewer.
    /// What is said of a claim is said of all.
    #[must_use]
    pub fn shown(&self) -> &Learnt {
        &self.all[self.best]
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
            let (frozen, _) = training.best_actor();
            let layers = frozen.layers().into_iter().map(|l| (l.inputs, l.weights, l.bias));
            stages
                .push(Stage { episodes: std::mem::take(&mut episodes), layers: layers.collect() });
        }
    }
    Ok(Learnt { agent, seed, stages })
}
