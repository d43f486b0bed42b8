//! Every parameter of a training, as the policy file that it produces stores it.
//!
//! A new parameter is a field here, a row in the table of `config/keys.rs` (its comment and its
//! range), and a value in each preset. The fields are the keys of the TOML files that users
//! write and that policy files hold, so a key is never renamed.

mod check;
mod keys;
mod randomisation;
mod text;

pub use check::ConfigError;
pub use randomisation::{Distribution, Parameter, Randomisation};
pub use text::{ReadError, SetError};

use leg_control::policy::GainPoint;
use leg_ddpg::Critic;
use serde::{Deserialize, Serialize};

/// The configuration of a training: the agent, and the stages of its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the preset; it becomes the policy's name.
    pub preset: String,
    /// Networks and their scalings.
    pub network: Network,
    /// Parameters of the update.
    pub learning: Learning,
    /// Exploration noise.
    pub exploration: Exploration,
    /// Reward function.
    pub reward: Reward,
    /// Start and end of the episodes.
    pub episode: Episode,
    /// Stages, trained one after the other. Networks, targets and optimisers are carried over;
    /// the replay buffer and the exploration begin anew.
    pub stages: Vec<Stage>,
    /// Selection of the best actor.
    pub selection: Selection,
    /// What differs from episode to episode beside start and medium; `None` for nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub randomisation: Option<Randomisation>,
    /// Recommended gains of the velocity cascade, by ascending density ratio. Where there are
    /// none, they are searched after the training.
    pub gains: Vec<GainPoint>,
}

/// The networks and their scalings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Where the critic takes its action, and its width.
    pub critic: Critic,
    /// Distribution of the initial weights.
    pub initial_weights: InitialWeights,
    /// Factor of the initial weights of the actor's last layer.
    pub actor_last_layer: f32,
    /// Whether the actor stays mirror-symmetric: reversing vx reverses the touchdown angle. It
    /// then hops on the spot at exactly zero speed.
    pub symmetric_actor: bool,
    /// Offset of the observation (m/s, m, density ratio): network input = (observation -
    /// offset) * scale.
    pub observation_offset: [f32; 3],
    /// Scale of the observation, see [`Self::observation_offset`].
    pub observation_scale: [f32; 3],
    /// Offset of the action (rad, m/s): action = offset + scale * u, where u is the action in
    /// unit space, which the critic takes.
    pub action_offset: [f32; 2],
    /// Scale of the action, see [`Self::action_offset`].
    pub action_scale: [f32; 2],
    /// Gain of the actor's output: u = clip(gain * tanh z, -bound, bound).
    pub output_gain: [f32; 2],
    /// Bound of the actor's output, see [`Self::output_gain`]; infinite where only the
    /// environment clips.
    pub output_bound: f32,
    /// Lowest action of the environment: rad, m/s.
    pub action_low: [f32; 2],
    /// Highest action of the environment: rad, m/s.
    pub action_high: [f32; 2],
}

/// The distribution of the initial weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialWeights {
    /// Uniform within sqrt(6 / (inputs + outputs)), biases 0 (Glorot and Bengio 2010).
    Glorot,
    /// Weights and biases uniform within 1 / sqrt(inputs).
    FanIn,
}

/// The parameters of the update.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learning {
    /// Number of samples in a batch, 32 or 64.
    pub batch: usize,
    /// Weight of the next step's value, from 0 to below 1.
    pub discount: f32,
    /// Rate of the soft update of the target networks, per update.
    pub target_smoothing: f32,
    /// Adam's learning rate for the actor.
    pub actor_learning_rate: f32,
    /// Adam's learning rate for the critic.
    pub critic_learning_rate: f32,
    /// Share of both learning rates at the end of a stage counted in steps; they decay linearly
    /// to it.
    pub final_learning_rate: f32,
    /// Largest norm of the gradient of either network; longer gradients are scaled down.
    pub max_gradient_norm: f32,
    /// Capacity of the replay buffer, transitions.
    pub replay_capacity: usize,
    /// Number of uniformly random actions before the first update of a stage.
    pub random_steps: u64,
    /// Number of environment steps for each update.
    pub steps_per_update: u64,
    /// Whether sampled transitions are mirrored with probability 1/2.
    pub mirror: bool,
    /// Rate at which the averaged actor follows, per update; 0 for no averaging.
    pub actor_averaging: f32,
}

/// Exploration noise, in unit space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum Exploration {
    /// A process x += -attraction x + deviation N(0, 1), with x = 0 at the start of an episode.
    OrnsteinUhlenbeck {
        /// Share of x that is lost each step.
        attraction: f32,
        /// Initial standard deviation of the steps of x.
        deviation: f32,
        /// Share of the deviation that is lost each step.
        decay: f32,
        /// Whether the replay buffer stores the action before the environment clips it.
        keep_unclipped: bool,
    },
    /// White noise, with a standard deviation drawn for each episode.
    Gaussian {
        /// Lowest and highest standard deviation; the draw is log-uniform.
        deviation: [f32; 2],
    },
}

/// The reward of a step to an apex (vx', y') with touchdown angle alpha and elongation speed rs
/// at density ratio rho:
///
/// ```text
/// min(log10(1 + 1 / |vx'|), cap) - elongation (1 - rho)^10 rs
///     - height max(0, (height_m - y') / (height_m - 1))
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reward {
    /// Largest reward for stopping.
    pub cap: f64,
    /// Cost of elongation on land, where it can only add energy, s/m.
    pub elongation: f64,
    /// Cost of an apex at 1 m; it falls linearly to 0 at `height_m`.
    pub height: f64,
    /// Apex height from which there is no cost, m; above 1.
    pub height_m: f64,
    /// Reward of a step that ends in a fall.
    pub fall: f64,
    /// Whether an apex below 1 m, which ends the episode, has the reward of a fall instead of
    /// its own.
    pub low_is_fall: bool,
}

/// The start and end of episodes. Starts are vx = spread N(0, 1) and
/// y = 1.001 + |spread N(0, 1)|, except for the shares below.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Largest number of steps in an episode.
    pub max_steps: u32,
    /// Standard deviation of the starts, m/s and m.
    pub spread: f64,
    /// Share of low starts: y = 1.001 + |0.4 N(0, 1)|.
    pub low_share: f64,
    /// Share of starts that are uniform in vx within 11 m/s and in y from 1 to 12.5 m.
    pub uniform_share: f64,
    /// Share of episodes in thin media that replay a failed start, see
    /// [`crate::failed_starts`].
    pub retry_share: f64,
    /// Shares of velocity-bias episodes (see [`crate::environment`]) from each of the density
    /// ratios of `led_from` up.
    pub led_share: [f64; 2],
    /// Density ratios at which the shares of `led_share` begin; ascending.
    pub led_from: [f64; 2],
    /// Velocity offset beyond the wanted speed at a bias strength of 1, m/s.
    pub lead_m_s: f64,
    /// Accuracy of the plant.
    pub tolerance: Tolerance,
}

/// Accuracy of the plant's integrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tolerance {
    /// An error of at most 1e-8 on every state.
    Golden,
    /// An error of about 1e-6 m/s a step, and faster.
    Training,
}

impl Tolerance {
    /// Returns the tolerance of the plant.
    #[must_use]
    pub fn plant(self) -> leg_plant::Tolerance {
        match self {
            Self::Golden => leg_plant::Tolerance::GOLDEN,
            Self::Training => leg_plant::Tolerance::TRAINING,
        }
    }
}

/// A stage of a training, in one kind of medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Distribution of the episodes' density ratios.
    pub medium: MediumDraw,
    /// Length of the stage.
    pub length: Length,
}

/// The distribution of an episode's density ratio.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum MediumDraw {
    /// Near water: 1 - |N(0, 1)| / 10, not below 0.
    Water,
    /// Near air: |N(0, 1)| / 10, not above 1.
    Land,
    /// Alternating: 1 and 0 in turn.
    WaterAndAir,
    /// A mixture of special density ratios; the rest is uniform from 0 to 1.
    Mixed {
        /// Share of episodes at exactly 0.
        air: f64,
        /// Share of episodes uniform from 0 to `thin_to`.
        thin: f64,
        /// Highest density ratio of the share `thin`.
        thin_to: f64,
        /// Share of episodes at exactly 1.
        water: f64,
    },
}

/// The length of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Length {
    /// A number of episodes.
    Episodes(u64),
    /// A number of environment steps.
    Steps(u64),
}

impl Length {
    /// Returns the number of steps or episodes.
    #[must_use]
    pub fn count(self) -> u64 {
        match self {
            Self::Episodes(n) | Self::Steps(n) => n,
        }
    }
}

/// The selection of the best actor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// Number of evaluations, evenly spaced over the last stage; the best actor is selected.
    /// With 0 the last actor is. Needs a last stage counted in steps.
    pub evaluations: u64,
    /// Number of starts of an evaluation in a vacuum, drawn for the selection alone. A quarter
    /// of them run below a density ratio of 0.2, a sixteenth above, where falls are rare.
    pub starts: usize,
    /// Weight of the tracking cost of the set-points, where a fall of all starts at one density
    /// ratio costs 1.
    pub tracking: f64,
}
