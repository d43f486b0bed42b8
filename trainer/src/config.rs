//! Every figure of a training, as it is stored in the policy it makes.
//!
//! A new figure is a field here, a row in the table of `config/keys.rs` (its
//! comment and its range), and a value in each preset.

mod check;
mod keys;
mod text;

pub use check::ConfigError;
pub use text::{ReadError, SetError};

use leg_control::policy::GainPoint;
use serde::{Deserialize, Serialize};

/// A training: the agent, and the stages it goes through one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// What the preset is called.
    pub preset: String,
    /// The networks.
    pub network: Network,
    /// The update.
    pub learning: Learning,
    /// What is added to the actor's action while training.
    pub exploration: Exploration,
    /// What is learnt.
    pub reward: Reward,
    /// Episodes.
    pub episode: Episode,
    /// Trained one after the other: networks, targets and their optimisers are
    /// carried over; the replay buffer and the exploration begin anew.
    pub stages: Vec<Stage>,
    /// Which actor is kept.
    pub selection: Selection,
    /// Recommended gains of the velocity cascade, by ascending density; where there
    /// are none, they are searched for after the training.
    pub gains: Vec<GainPoint>,
}

/// The networks and their scalings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Where the critic takes its action, and its width.
    pub critic: Critic,
    /// How weights are drawn.
    pub initial_weights: InitialWeights,
    /// Multiplies the initial weights of the actor's last layer.
    pub actor_last_layer: f32,
    /// Whether the actor is held mirror-symmetric: vx reversed, touchdown angle
    /// reversed. It then hops on the spot at exactly no speed.
    pub symmetric_actor: bool,
    /// Network input = (observation - offset) * scale.
    pub observation_offset: [f32; 3],
    /// See [`Self::observation_offset`].
    pub observation_scale: [f32; 3],
    /// Action = offset + scale * u for the action u in unit space,
    /// which is what the critic sees.
    pub action_offset: [f32; 2],
    /// See [`Self::action_offset`].
    pub action_scale: [f32; 2],
    /// The actor's u = clip(gain * tanh z, -bound, bound).
    pub output_gain: [f32; 2],
    /// See [`Self::output_gain`]; infinite where only the environment clips.
    pub output_bound: f32,
    /// Lowest action that the environment takes: rad, m/s.
    pub action_low: [f32; 2],
    /// Highest action that the environment takes: rad, m/s.
    pub action_high: [f32; 2],
}

/// The critic's architecture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Critic {
    /// State 3-50 ReLU-50, plus action 2-50, added, ReLU, 1: as in the paper.
    /// (The two layers that are added share one bias.)
    ActionAtSecondLayer,
    /// 5-50-50-1 on state and action.
    #[serde(rename = "joint-50")]
    Joint50,
    /// 5-100-100-1 on state and action.
    #[serde(rename = "joint-100")]
    Joint100,
}

/// How initial weights are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialWeights {
    /// Uniform within sqrt(6 / (inputs + outputs)), biases 0 (Glorot and Bengio 2010).
    Glorot,
    /// Weights and biases uniform within 1 / sqrt(inputs).
    FanIn,
}

/// The update, and how often.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learning {
    /// Samples in a batch: 32 or 64.
    pub batch: usize,
    /// Weight of the next step's value.
    pub discount: f32,
    /// Rate of the soft update of the target networks.
    pub target_smoothing: f32,
    /// Adam's learning rate for the actor.
    pub actor_learning_rate: f32,
    /// Adam's learning rate for the critic.
    pub critic_learning_rate: f32,
    /// Both rates decay linearly to this share at the end of a stage counted in steps.
    pub final_learning_rate: f32,
    /// Longest gradient of either network.
    pub max_gradient_norm: f32,
    /// Transitions kept.
    pub replay_capacity: usize,
    /// Steps of uniformly random actions before the first update of a stage.
    pub random_steps: u64,
    /// Environment steps for each update.
    pub steps_per_update: u64,
    /// Whether sampled transitions are mirrored with probability 1/2.
    pub mirror: bool,
    /// Rate at which the averaged actor follows; 0 for no averaging.
    pub actor_averaging: f32,
}

/// Exploration noise, in unit space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Exploration {
    /// x += -attraction x + deviation N(0, 1), x = 0 at an episode's start.
    OrnsteinUhlenbeck {
        /// Share of the noise that is lost each step.
        attraction: f32,
        /// Standard deviation of the steps at first.
        deviation: f32,
        /// Share of the deviation that is lost each step.
        decay: f32,
        /// Whether the replay buffer keeps the action before the environment clips it.
        keep_unclipped: bool,
    },
    /// White, with a standard deviation drawn for each episode.
    Gaussian {
        /// Lowest and highest deviation; log-uniform between.
        deviation: [f32; 2],
    },
}

/// Reward of a step to an apex (vx', y') with action (alpha, rs) at density rho:
///
/// ```text
/// min(log10(1 + 1 / |vx'|), cap) - elongation (1 - rho)^10 rs
///     - height max(0, (height_m - y') / (height_m - 1))
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reward {
    /// Highest reward for stopping.
    pub cap: f64,
    /// Cost of elongation on land, where it can only add energy; s/m.
    pub elongation: f64,
    /// Cost of an apex below `height_m`.
    pub height: f64,
    /// Height wanted to spare, m; above 1.
    pub height_m: f64,
    /// Reward of a step that ends in a fall.
    pub fall: f64,
    /// Whether an apex below 1 m, which ends the episode, is rewarded like a fall
    /// and not like any other apex.
    pub low_is_fall: bool,
}

/// How episodes begin and end. Starts are vx = spread N(0, 1),
/// y = 1.001 + |spread N(0, 1)|, but for the shares below.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Most steps.
    pub max_steps: u32,
    /// Spread of the starts, m/s and m.
    pub spread: f64,
    /// Share of starts that are low: y = 1.001 + |0.4 N(0, 1)|.
    pub low_share: f64,
    /// Share of starts uniform in vx within 11 m/s and y from 1 to 12.5 m.
    pub uniform_share: f64,
    /// Share of episodes in thin media that begin where one before fell.
    pub retry_share: f64,
    /// Share of led episodes (see [`crate::environment`]) from each of the density
    /// ratios of `led_from` up.
    pub led_share: [f64; 2],
    /// See `led_share`; ascending.
    pub led_from: [f64; 2],
    /// Speed by which the leg is led at a full pull, m/s.
    pub lead_m_s: f64,
    /// Accuracy of the plant.
    pub tolerance: Tolerance,
}

/// Accuracy of the plant's integrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tolerance {
    /// 1e-8 on every state.
    Golden,
    /// 1e-6 m/s a step, faster.
    Training,
}

impl Tolerance {
    /// For the plant.
    #[must_use]
    pub fn plant(self) -> leg_plant::Tolerance {
        match self {
            Self::Golden => leg_plant::Tolerance::GOLDEN,
            Self::Training => leg_plant::Tolerance::TRAINING,
        }
    }
}

/// A stretch of training in one kind of medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Density ratios of its episodes.
    pub medium: MediumDraw,
    /// How long it is.
    pub length: Length,
}

/// How an episode's density ratio is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum MediumDraw {
    /// 1 - |N(0, 1)| / 10, not below 0.
    Water,
    /// |N(0, 1)| / 10, not above 1.
    Land,
    /// Pure water and pure air in turn.
    WaterAndAir,
    /// Shares of special densities; the rest is uniform from 0 to 1.
    Mixed {
        /// Share at exactly 0.
        air: f64,
        /// Share uniform from 0 to `thin_to`.
        thin: f64,
        /// See `thin`.
        thin_to: f64,
        /// Share at exactly 1.
        water: f64,
    },
}

/// The length of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Length {
    /// Episodes.
    Episodes(u64),
    /// Environment steps.
    Steps(u64),
}

impl Length {
    /// Of whatever it is counted in.
    #[must_use]
    pub fn count(self) -> u64 {
        match self {
            Self::Episodes(n) | Self::Steps(n) => n,
        }
    }
}

/// Which actor is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// Evaluations spread evenly over the last stage, the best of which is kept;
    /// with 0, the last actor is. Needs a last stage counted in steps.
    pub evaluations: u64,
    /// Starts in a vacuum in an evaluation, drawn for the selection alone; a quarter of
    /// them below a density ratio of 0.2, a sixteenth above, where falls are rare.
    pub starts: usize,
    /// Cost of a set-point that is not tracked, where a fall of all starts at one
    /// density costs 1.
    pub tracking: f64,
}
