//! The episodes of an environment: the trainer's starts, plant and rewards, one hop a step.

use leg_plant::Apex;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;
use trainer::config::{Config, MediumDraw};
use trainer::environment::{Environment, Start};
use trainer::preset::Preset;
use trainer::world::PathPoint;

/// Lowest and highest horizontal velocity, m/s, height, m, and density ratio that are observed; an
/// apex beyond is observed on the bound. The height is that of a free fall of 20 s in a vacuum,
/// after which a flight counts as a fall; no training comes near any bound.
pub(crate) const OBSERVED: [[f32; 3]; 2] = [[-200.0, -10.0, 0.0], [200.0, 2000.0, 2.0]];

/// Presets by number.
pub(crate) fn config(preset: Preset) -> &'static Config {
    static CONFIGS: [OnceLock<Config>; 6] = [const { OnceLock::new() }; 6];
    CONFIGS[preset as usize].get_or_init(|| preset.config())
}

/// What an action between -1 and 1 means, in rad and m/s: `offset + scale * action`.
pub(crate) fn action_scaling(config: &Config) -> ([f32; 2], [f32; 2]) {
    let (low, high) = (config.network.action_low, config.network.action_high);
    let offset = [0, 1].map(|i| low[i].midpoint(high[i]));
    (offset, [0, 1].map(|i| (-low[i]).midpoint(high[i])))
}

/// Returns an action between -1 and 1 in rad and m/s, with the bits of an actor whose tanh it is.
fn physical(config: &Config, action: [f32; 2]) -> [f64; 2] {
    let (offset, scale) = action_scaling(config);
    [0, 1].map(|i| f64::from(offset[i] + scale[i] * action[i]))
}

/// The network's input for an observed apex.
pub(crate) fn scaled(config: &Config, shown: [f32; 3]) -> [f32; 3] {
    let network = &config.network;
    [0, 1, 2].map(|i| {
        let bounded = shown[i].clamp(OBSERVED[0][i], OBSERVED[1][i]);
        (bounded - network.observation_offset[i]) * network.observation_scale[i]
    })
}

/// Draws episodes one after the other, and plays them.
#[derive(Clone)]
pub(crate) struct Episodes {
    preset: Preset,
    config: &'static Config,
    seed: u64,
    rng: Pcg64,
    /// Number of the next episode.
    next: u64,
    /// The episode that was begun last.
    begun: Option<Begun>,
}

#[derive(Clone)]
struct Begun {
    environment: Environment<'static>,
    /// The generator before its draws.
    rng: Pcg64,
    actions: Vec<[f32; 2]>,
    is_over: bool,
}

/// The answer to an action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    pub(crate) observation: [f32; 3],
    pub(crate) reward: f64,
    pub(crate) terminated: bool,
    pub(crate) truncated: bool,
}

/// What episodes are made of again: they are played from the start of the last one.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Memory {
    preset: String,
    seed: u64,
    /// The generator before the last episode, or now if there is none.
    rng: Pcg64,
    next: u64,
    actions: Option<Vec<[f32; 2]>>,
}

impl Episodes {
    pub(crate) fn new(preset: Preset, seed: u64) -> Self {
        let rng = Pcg64::seed_from_u64(seed);
        Self { preset, config: config(preset), seed, rng, next: 0, begun: None }
    }

    /// Begins anew, as made with this seed.
    pub(crate) fn reseed(&mut self, seed: u64) {
        *self = Self::new(self.preset, seed);
    }

    fn medium(&self) -> &'static MediumDraw {
        self.config.stages.last().map(|stage| &stage.medium).expect("a preset has stages")
    }

    /// Begins an episode and returns its first observation.
    pub(crate) fn begin(&mut self) -> [f32; 3] {
        let rng = self.rng.clone();
        let start = Start::draw(self.config, self.medium(), self.next, &mut self.rng);
        let environment =
            Environment::new(self.config, start).with_random_world(self.seed, self.next);
        self.next += 1;
        let mut actions = self.begun.take().map(|begun| begun.actions).unwrap_or_default();
        actions.clear();
        self.begun = Some(Begun { environment, rng, actions, is_over: false });
        self.observation()
    }

    /// Whether an episode goes on.
    pub(crate) fn is_running(&self) -> bool {
        self.begun.as_ref().is_some_and(|begun| !begun.is_over)
    }

    /// The environment of the episode that goes on.
    pub(crate) fn running(&self) -> Option<&Environment<'static>> {
        self.begun.as_ref().map(|begun| &begun.environment)
    }

    /// Returns what is observed of the last apex; zeros of a leg that fell to the ground.
    pub(crate) fn observation(&self) -> [f32; 3] {
        let Some(begun) = &self.begun else { return [0.0; 3] };
        let environment = &begun.environment;
        let shown = match environment.apex() {
            // After a fall there is nothing to observe.
            Apex { vx_m_s, y_m: 0.0 } => [vx_m_s, 0.0, environment.density_ratio()],
            _ => environment.shown(),
        };
        scaled(self.config, shown.map(|x| x as f32))
    }

    /// Returns the way of the hop that an action between -1 and 1 would give.
    pub(crate) fn path(&self, action: [f32; 2]) -> Vec<PathPoint> {
        let physical = physical(self.config, action);
        self.begun.as_ref().map(|begun| begun.environment.path(physical)).unwrap_or_default()
    }

    /// Takes a step with an action between -1 and 1; `None` outside an episode.
    pub(crate) fn step(&mut self, action: [f32; 2]) -> Option<Step> {
        let config = self.config;
        let begun = self.begun.as_mut().filter(|begun| !begun.is_over)?;
        let outcome = begun.environment.act(physical(config, action));
        begun.actions.push(action);
        let terminated = outcome.ended;
        let truncated = !terminated && begun.actions.len() >= config.episode.max_steps as usize;
        begun.is_over = terminated || truncated;
        let observation = self.observation();
        Some(Step { observation, reward: outcome.reward, terminated, truncated })
    }

    /// Returns text from which [`Self::recalled`] makes the same episodes.
    pub(crate) fn remembered(&self) -> String {
        let begun = self.begun.as_ref();
        let memory = Memory {
            preset: self.config.preset.clone(),
            seed: self.seed,
            rng: begun.map_or_else(|| self.rng.clone(), |begun| begun.rng.clone()),
            next: self.next - u64::from(begun.is_some()),
            actions: begun.map(|begun| begun.actions.clone()),
        };
        serde_json::to_string(&memory).expect("numbers and text")
    }

    /// Returns the episodes of a text that [`Self::remembered`] made.
    ///
    /// # Errors
    /// A sentence about what is wrong with the text.
    pub(crate) fn recalled(text: &str) -> Result<Self, String> {
        let memory: Memory = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let preset = preset(&memory.preset)?;
        let mut episodes = Self::new(preset, memory.seed);
        (episodes.rng, episodes.next) = (memory.rng, memory.next);
        if let Some(actions) = memory.actions {
            episodes.begin();
            for action in actions {
                episodes.step(action).ok_or("it has steps after the end of its episode")?;
            }
        }
        Ok(episodes)
    }
}

/// Returns the preset of a name.
///
/// # Errors
/// A sentence with the names that there are.
pub(crate) fn preset(name: &str) -> Result<Preset, String> {
    use clap::ValueEnum;
    Preset::from_str(name, false).map_err(|_| {
        let all = Preset::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        let names: Vec<String> = all.map(|value| value.get_name().to_owned()).collect();
        format!("there is no preset '{name}'; choose one of {}", names.join(", "))
    })
}
