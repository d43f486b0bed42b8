//! A training, from its first step to its best actor.

mod state;
#[cfg(test)]
mod tests;

pub use state::{StateError, TrainingState};

use crate::config::{Config, InitialWeights, Length};
use crate::environment::{Environment, Start};
use crate::evaluate::selection::{Score, Selector};
use crate::explore::Noise;
use crate::failed_starts::FailedStarts;
use crate::policy::PackedActor;
use leg_ddpg::{Agent, Layer, Rates, Replay, Shape, Transition, UnitOutput, Update};
use leg_simd::Isa;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;

/// The log record of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EpisodeRecord {
    /// Number of the episode, from 1, over all stages.
    pub episode: u64,
    /// Number of the stage, from 1.
    pub stage: usize,
    /// Environment steps so far, over all stages.
    pub total_steps: u64,
    /// Density ratio of the episode.
    pub density_ratio: f64,
    /// Sum of the episode's rewards.
    pub reward: f64,
    /// Number of steps in the episode.
    pub steps: u32,
    /// The critic's value of the actor's action at the start of the episode.
    pub q0: f32,
}

/// A training whose numbers are no longer finite.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "training diverged at step {step}: {value}; lower the learning rates, or take another seed"
)]
pub struct DivergenceError {
    /// Environment step at which it was found, over all stages.
    pub step: u64,
    /// The number that is not finite.
    pub value: NotFinite,
}

/// The number that is not finite in a training that diverged.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotFinite {
    /// Norm of the critic's gradient before clipping.
    #[error("the norm of the critic's gradient is {0}")]
    CriticGradient(f32),
    /// Norm of the actor's gradient before clipping.
    #[error("the norm of the actor's gradient is {0}")]
    ActorGradient(f32),
    /// The actor's action in unit space, before exploration noise; a weight is not finite.
    #[error("the actor's action is {0:?}")]
    Action([f32; 2]),
    /// The critic's value of an episode's start; a weight is not finite.
    #[error("the critic's value is {0}")]
    Value(f32),
    /// Reward of a step: the velocity was exactly 0, and `reward.cap` is infinite.
    #[error("a reward is {0} (a finite reward.cap bounds it)")]
    Reward(f64),
}

impl NotFinite {
    /// Returns the gradient norm of an update that is not finite, if any.
    #[must_use]
    pub fn of(update: &Update) -> Option<Self> {
        let (critic, actor) = (update.critic_gradient_norm, update.actor_gradient_norm);
        if !critic.is_finite() {
            return Some(Self::CriticGradient(critic));
        }
        (!actor.is_finite()).then_some(Self::ActorGradient(actor))
    }
}

/// A running training. Its one seed determines everything random in it.
pub struct Training {
    config: Config,
    seed: u64,
    agent: Box<dyn Agent>,
    replay: Replay,
    noise: Noise,
    failed_starts: FailedStarts,
    environment_rng: Pcg64,
    noise_rng: Pcg64,
    batch_rng: Pcg64,
    selector: Option<Selector>,
    stage: usize,
    /// Environment steps in the present stage.
    steps: u64,
    /// Episodes in the present stage.
    episodes: u64,
    total_steps: u64,
    total_episodes: u64,
    total_updates: u64,
    latest_update: Option<Update>,
}

impl Training {
    /// Prepares the first step. The configuration must have passed [`Config::check`]; `isa`
    /// does not affect the result.
    #[must_use]
    pub fn new(config: Config, seed: u64, isa: Isa) -> Self {
        let mut root = Pcg64::seed_from_u64(seed);
        let agent = agent(&config, isa, &mut Pcg64::from_rng(&mut root));
        let selector = (config.selection.evaluations > 0)
            .then(|| Selector::new(&config, &mut Pcg64::from_rng(&mut root)));
        Self {
            agent,
            selector,
            replay: Replay::new(config.learning.replay_capacity),
            noise: Noise::new(&config.exploration),
            failed_starts: FailedStarts::default(),
            environment_rng: Pcg64::from_rng(&mut root),
            noise_rng: Pcg64::from_rng(&mut root),
            batch_rng: Pcg64::from_rng(&mut root),
            config,
            seed,
            stage: 0,
            steps: 0,
            episodes: 0,
            total_steps: 0,
            total_episodes: 0,
            total_updates: 0,
            latest_update: None,
        }
    }

    /// Returns the configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Returns the seed.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Returns the environment steps so far, over all stages.
    #[must_use]
    pub fn total_steps(&self) -> u64 {
        self.total_steps
    }

    /// Returns the updates so far, over all stages.
    #[must_use]
    pub fn total_updates(&self) -> u64 {
        self.total_updates
    }

    /// Returns the gradients of the latest update; `None` before the first of this process.
    #[must_use]
    pub fn latest_update(&self) -> Option<Update> {
        self.latest_update
    }

    /// Returns the selector of the best actor, where the configuration has a selection.
    #[must_use]
    pub fn selector(&self) -> Option<&Selector> {
        self.selector.as_ref()
    }

    /// Returns the actor's action in unit space, without exploration, for an observation in
    /// m/s, m and density ratio.
    pub fn act(&mut self, observation: [f32; 3]) -> [f32; 2] {
        let n = &self.config.network;
        let scaled = |i: usize| (observation[i] - n.observation_offset[i]) * n.observation_scale[i];
        self.agent.act([0, 1, 2].map(scaled))
    }

    /// Returns the completed share of the present stage, from 0 to 1; 1 after the last stage.
    #[must_use]
    pub fn share_of_stage(&self) -> f64 {
        match self.config.stages.get(self.stage).map(|stage| stage.length) {
            Some(Length::Steps(n)) => self.steps as f64 / n as f64,
            Some(Length::Episodes(n)) => self.episodes as f64 / n as f64,
            None => 1.0,
        }
    }

    /// Returns the number of completed stages.
    #[must_use]
    pub fn stages_done(&self) -> usize {
        self.stage
    }

    /// Returns the completed share of all stages, from 0 to 1; each stage has the same weight.
    #[must_use]
    pub fn share_done(&self) -> f64 {
        let stages = self.config.stages.len();
        if self.stage == stages {
            return 1.0;
        }
        (self.stage as f64 + self.share_of_stage().min(1.0)) / stages as f64
    }

    /// Runs the next episode with its updates; returns `None` when all stages are complete.
    ///
    /// # Errors
    /// [`DivergenceError`] when a gradient, a reward, an action or a value is not finite.
    pub fn episode(&mut self) -> Result<Option<EpisodeRecord>, DivergenceError> {
        if self.stage == self.config.stages.len() {
            return Ok(None);
        }
        let record = self.play()?;
        self.episodes += 1;
        if self.stage + 1 == self.config.stages.len()
            && let Some(selector) = &mut self.selector
        {
            let Length::Steps(all) = self.config.stages[self.stage].length else {
                unreachable!("Config::check requires a last stage counted in steps");
            };
            if selector.is_due(self.steps, all) {
                let averaged = self.config.learning.actor_averaging > 0.0;
                let packed = PackedActor::trained(&self.config, &self.agent.actor(averaged));
                selector.evaluate(packed, self.total_steps);
            }
        }
        if self.share_of_stage() >= 1.0 {
            self.stage += 1;
            self.steps = 0;
            self.episodes = 0;
            self.replay = Replay::new(self.config.learning.replay_capacity);
            self.noise = Noise::new(&self.config.exploration);
            self.failed_starts = FailedStarts::default();
        }
        Ok(Some(record))
    }

    /// Runs one update on the present replay buffer, for benchmarks.
    pub fn update(&mut self) -> Update {
        let rates = rates(&self.config, 0, Length::Episodes(1));
        self.agent.update(&self.replay, &rates, &mut self.batch_rng)
    }

    fn play(&mut self) -> Result<EpisodeRecord, DivergenceError> {
        let config = &self.config;
        let stage = &config.stages[self.stage];
        let rng = &mut self.environment_rng;
        let mut start = Start::draw(config, &stage.medium, self.episodes, rng);
        self.failed_starts.replay(config.episode.retry_share, &mut start, rng);
        let mut environment = Environment::new(config, start)
            .with_random_bias(rng)
            .with_random_world(self.seed, self.total_episodes);
        self.noise.begin_episode(&mut self.noise_rng);
        self.total_episodes += 1;
        let start = environment.observation();
        let first = self.agent.act(start);
        let mut record = EpisodeRecord {
            episode: self.total_episodes,
            stage: self.stage + 1,
            total_steps: 0,
            density_ratio: environment.density_ratio(),
            reward: 0.0,
            steps: 0,
            q0: self.agent.value(start, first),
        };
        let diverged = |step, value| Err(DivergenceError { step, value });
        if !first.iter().all(|u| u.is_finite()) {
            return diverged(self.total_steps, NotFinite::Action(first));
        }
        if !record.q0.is_finite() {
            return diverged(self.total_steps, NotFinite::Value(record.q0));
        }
        let last = match stage.length {
            Length::Steps(n) => n,
            Length::Episodes(_) => u64::MAX,
        };
        while record.steps < config.episode.max_steps && self.steps < last {
            let observation = environment.observation();
            let action = explore(
                config,
                &mut *self.agent,
                &mut self.noise,
                &mut self.noise_rng,
                observation,
                self.steps < config.learning.random_steps,
            );
            let outcome = environment.step(action);
            self.steps += 1;
            self.total_steps += 1;
            record.steps += 1;
            record.reward += outcome.reward;
            if !outcome.reward.is_finite() {
                return diverged(self.total_steps, NotFinite::Reward(outcome.reward));
            }
            self.replay.push(Transition {
                observation,
                action,
                reward: outcome.reward as f32,
                next: environment.observation(),
                continues: if outcome.ended { 0.0 } else { 1.0 },
            });
            let learning = &config.learning;
            if self.replay.len() >= self.agent.batch()
                && self.steps > learning.random_steps
                && self.steps.is_multiple_of(learning.steps_per_update)
            {
                let rates = rates(config, self.steps, stage.length);
                let update = self.agent.update(&self.replay, &rates, &mut self.batch_rng);
                self.total_updates += 1;
                self.latest_update = Some(update);
                if let Some(value) = NotFinite::of(&update) {
                    return diverged(self.total_steps, value);
                }
            }
            if outcome.ended {
                // A fall says nothing about the actor after random actions, nor in a
                // velocity-bias episode, and little about the start in a randomised world,
                // from which no action may be able to save it.
                if self.steps > learning.random_steps
                    && !environment.is_biased()
                    && !environment.is_randomised()
                {
                    self.failed_starts.push(environment.start());
                }
                break;
            }
        }
        record.total_steps = self.total_steps;
        Ok(record)
    }

    /// Returns the best actor with its score; without a selection, the latest actor.
    #[must_use]
    pub fn best_actor(&self) -> (PackedActor, Option<Score>) {
        if let Some((packed, score)) = self.selector.as_ref().and_then(Selector::best) {
            return (packed.clone(), Some(score));
        }
        let averaged = self.config.learning.actor_averaging > 0.0;
        (PackedActor::trained(&self.config, &self.agent.actor(averaged)), None)
    }
}

/// Returns an action in unit space: uniformly random, or the actor's with noise.
fn explore(
    config: &Config,
    agent: &mut dyn Agent,
    noise: &mut Noise,
    rng: &mut Pcg64,
    observation: [f32; 3],
    at_random: bool,
) -> [f32; 2] {
    let n = &config.network;
    let unit = |i: usize, x: f32| (x - n.action_offset[i]) / n.action_scale[i];
    let action = if at_random {
        [0, 1].map(|i| unit(i, rng.random_range(n.action_low[i]..=n.action_high[i])))
    } else {
        let (action, noise) = (agent.act(observation), noise.next(rng));
        [0, 1].map(|i| action[i] + noise[i])
    };
    if !noise.stores_clipped() {
        return action;
    }
    [0, 1].map(|i| {
        let low = unit(i, n.action_low[i]).max(-n.output_bound);
        let high = unit(i, n.action_high[i]).min(n.output_bound);
        action[i].clamp(low, high)
    })
}

/// Returns the parameters of the update after step `steps` of a stage.
fn rates(config: &Config, steps: u64, length: Length) -> Rates {
    let l = &config.learning;
    let decay = match length {
        Length::Steps(n) => 1.0 - (1.0 - l.final_learning_rate) * (steps as f32 / n as f32),
        Length::Episodes(_) => 1.0,
    };
    Rates {
        actor_learning_rate: decay * l.actor_learning_rate,
        critic_learning_rate: decay * l.critic_learning_rate,
        discount: l.discount,
        target_smoothing: l.target_smoothing,
        actor_averaging: l.actor_averaging,
        max_gradient_norm: l.max_gradient_norm,
        mirror: l.mirror,
    }
}

/// Creates an agent with random initial weights.
#[must_use]
pub fn agent(config: &Config, isa: Isa, rng: &mut impl Rng) -> Box<dyn Agent> {
    let n = &config.network;
    let mut layer =
        |[inputs, outputs]: [usize; 2]| initial(n.initial_weights, inputs, outputs, rng);
    let mut actor = Shape::ACTOR_LAYERS.map(&mut layer);
    for x in actor[2].weights.iter_mut().chain(&mut actor[2].bias) {
        *x *= n.actor_last_layer;
    }
    let critic = n.critic.layers().map(layer);
    let shape = Shape {
        critic: n.critic,
        batch: config.learning.batch,
        output: UnitOutput { gain: n.output_gain, bound: n.output_bound },
        symmetric_actor: n.symmetric_actor,
    };
    leg_ddpg::agent(isa, &shape, &actor, &critic)
}

fn initial(kind: InitialWeights, inputs: usize, outputs: usize, rng: &mut impl Rng) -> Layer {
    let bound = match kind {
        InitialWeights::Glorot => (6.0 / (inputs + outputs) as f32).sqrt(),
        InitialWeights::FanIn => 1.0 / (inputs as f32).sqrt(),
    };
    let mut draw =
        |n: usize| -> Vec<f32> { (0..n).map(|_| rng.random_range(-bound..=bound)).collect() };
    let weights = draw(inputs * outputs);
    let bias = match kind {
        InitialWeights::Glorot => vec![0.0; outputs],
        InitialWeights::FanIn => draw(outputs),
    };
    Layer { inputs, weights, bias }
}
