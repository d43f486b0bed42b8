//! The table of all keys of a configuration: description, unit and range.
//!
//! Each key has one row. A key without a row fails [`Config::check`](super::Config::check),
//! and with it the test of every preset.

use leg_plant::Losses;
use std::fmt;

/// A key, its description and its range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Key {
    /// Path of tables and key, separated by dots; the same for every item of a list.
    pub(super) path: &'static str,
    /// Unit; empty without one.
    unit: &'static str,
    what: &'static str,
    pub(super) limit: Limit,
}

/// The range of a value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Limit {
    /// A number, or each number of a list.
    Number { low: End, high: End },
    /// As [`Self::Number`], or infinite.
    NumberOrInfinite { low: End },
    /// A whole number.
    Whole(i64, i64),
    /// One of a few whole numbers.
    Choice(&'static [i64]),
    /// One of a few keywords.
    Keyword(&'static [&'static str]),
    /// true or false.
    Flag,
    /// A name.
    Name,
    /// A table.
    Table,
    /// A list of tables, with its least and largest length.
    List(usize, usize),
}

/// An end of a range.
#[derive(Clone, Copy, Debug)]
pub(super) enum End {
    /// An end that belongs to the range.
    Closed(f64),
    /// An end that does not belong to the range.
    Open(f64),
}

/// Longest name of a preset, bytes.
const NAME_BYTES: usize = 64;
/// Largest number of steps or episodes of a stage.
const LONGEST: i64 = 1_000_000_000_000;

const fn from(low: f64, high: f64) -> Limit {
    Limit::Number { low: End::Closed(low), high: End::Closed(high) }
}

const fn from_to_below(low: f64, high: f64) -> Limit {
    Limit::Number { low: End::Closed(low), high: End::Open(high) }
}

const fn above(low: f64, high: f64) -> Limit {
    Limit::Number { low: End::Open(low), high: End::Closed(high) }
}

const fn row(path: &'static str, unit: &'static str, what: &'static str, limit: Limit) -> Key {
    Key { path, unit, what, limit }
}

const ANY: Limit = from(-1e6, 1e6);
const SHARE: Limit = from(0.0, 1.0);
const RATE: Limit = above(0.0, 1.0);
const POSITIVE: Limit = above(0.0, 1e6);
const POSITIVE_OR_INFINITE: Limit = Limit::NumberOrInfinite { low: End::Open(0.0) };
const CRITICS: Limit = Limit::Keyword(&["action-at-second-layer", "joint-50", "joint-100"]);
const WEIGHTS: Limit = Limit::Keyword(&["glorot", "fan-in"]);
const NOISES: Limit = Limit::Keyword(&["ornstein-uhlenbeck", "gaussian"]);
const MEDIA: Limit = Limit::Keyword(&["water", "land", "water-and-air", "mixed"]);
const TOLERANCES: Limit = Limit::Keyword(&["golden", "training"]);
const DISTRIBUTIONS: Limit = Limit::Keyword(&["uniform", "log-uniform", "normal"]);
const GAIN: Limit = from(-1000.0, 1000.0);

#[rustfmt::skip]
static KEYS: &[Key] = &[
    row("preset", "", "Name of the training; it becomes the policy's name", Limit::Name),
    row("network", "", "The networks and their scalings", Limit::Table),
    row("network.critic", "", "Layer at which the critic takes the action, and its width", CRITICS),
    row("network.initial_weights", "", "Distribution of the initial weights", WEIGHTS),
    row("network.actor_last_layer", "", "Factor of the initial weights of the actor's last layer", from(0.0, 100.0)),
    row("network.observation_offset", "m/s, m, 1", "Network input = (observation - offset) * scale, for vx, y, density ratio", ANY),
    row("network.observation_scale", "s/m, 1/m, 1", "See observation_offset", POSITIVE),
    row("network.action_offset", "rad, m/s", "Action = offset + scale * u: touchdown angle and elongation speed from u, the critic's input", ANY),
    row("network.action_scale", "rad, m/s", "See action_offset", POSITIVE),
    row("network.output_gain", "", "The actor's u = clip(gain * tanh z, -bound, bound)", POSITIVE),
    row("network.output_bound", "", "See output_gain; infinite where only the environment clips", POSITIVE_OR_INFINITE),
    row("network.action_low", "rad, m/s", "Lowest action that the environment takes", from(0.0, 100.0)),
    row("network.action_high", "rad, m/s", "Highest action that the environment takes", from(0.0, 100.0)),
    row("network.symmetric_actor", "", "Whether the actor stays mirror-symmetric: reversing vx reverses the touchdown angle", Limit::Flag),
    row("learning", "", "Parameters of the update", Limit::Table),
    row("learning.batch", "", "Samples in a batch", Limit::Choice(&[32, 64])),
    row("learning.discount", "", "Weight of the next step's value", from_to_below(0.0, 1.0)),
    row("learning.target_smoothing", "per update", "Rate at which the target networks follow", RATE),
    row("learning.actor_learning_rate", "", "Adam's learning rate for the actor", RATE),
    row("learning.critic_learning_rate", "", "Adam's learning rate for the critic", RATE),
    row("learning.final_learning_rate", "", "Both rates decay linearly to this share at the end of a stage counted in steps", RATE),
    row("learning.max_gradient_norm", "", "Largest norm of the gradient of either network; longer gradients are scaled down", POSITIVE_OR_INFINITE),
    row("learning.replay_capacity", "transitions", "Size of the replay buffer", Limit::Whole(32, u32::MAX as i64)),
    row("learning.random_steps", "steps", "Uniformly random actions before the first update of a stage", Limit::Whole(0, LONGEST)),
    row("learning.steps_per_update", "steps", "Environment steps for each update", Limit::Whole(1, LONGEST)),
    row("learning.mirror", "", "Whether sampled transitions are mirrored with probability 1/2", Limit::Flag),
    row("learning.actor_averaging", "per update", "Rate at which the averaged actor follows, which then is the trained actor; 0 for no averaging", SHARE),
    row("exploration", "", "Noise that is added to the actor's action in training, in the unit space of u", Limit::Table),
    row("exploration.kind", "", "Correlated (Ornstein-Uhlenbeck) or white (Gaussian) noise", NOISES),
    row("exploration.attraction", "per step", "Ornstein-Uhlenbeck: share of the noise that is lost", SHARE),
    row("exploration.deviation", "", "Standard deviation: at first (Ornstein-Uhlenbeck), or lowest and highest, log-uniform between, one draw an episode (Gaussian)", above(0.0, 100.0)),
    row("exploration.decay", "per step", "Ornstein-Uhlenbeck: share of the deviation that is lost", from_to_below(0.0, 1.0)),
    row("exploration.keep_unclipped", "", "Whether the replay buffer stores actions before the environment clips them", Limit::Flag),
    row("reward", "", "min(log10(1 + 1 / |vx'|), cap) - elongation (1 - rho)^10 rs - height max(0, (height_m - y') / (height_m - 1))", Limit::Table),
    row("reward.cap", "", "Highest reward for stopping", POSITIVE_OR_INFINITE),
    row("reward.elongation", "s/m", "Cost of elongation on land, where it can only add energy", from(0.0, 1000.0)),
    row("reward.height", "", "Cost of an apex below height_m", from(0.0, 1000.0)),
    row("reward.height_m", "m", "Apex height from which there is no cost", above(1.0, 100.0)),
    row("reward.fall", "", "Reward of a step that ends in a fall", from(-1000.0, 1000.0)),
    row("reward.low_is_fall", "", "Whether an apex below 1 m, which ends the episode, is rewarded like a fall", Limit::Flag),
    row("episode", "", "Start and end of episodes; starts are vx = spread N(0, 1), y = 1.001 + |spread N(0, 1)|, except for the shares", Limit::Table),
    row("episode.max_steps", "steps", "Longest episode", Limit::Whole(1, 100_000)),
    row("episode.spread", "m/s and m", "Spread of the starts", from(0.0, 100.0)),
    row("episode.low_share", "", "Share of starts that are low: y = 1.001 + |0.4 N(0, 1)|", SHARE),
    row("episode.uniform_share", "", "Share of starts uniform in vx within 11 m/s and y from 1 to 12.5 m", SHARE),
    row("episode.retry_share", "", "Share of episodes at density ratios below 0.2 that replay the start of an earlier fall, other than in a randomised world", SHARE),
    row("episode.led_share", "", "Share of velocity-bias episodes from each of led_from up: the velocity shown has an offset, as by the cascade, and the reward is highest at another speed", SHARE),
    row("episode.led_from", "", "Density ratios from which the shares of led_share hold", from(0.0, 1.0)),
    row("episode.lead_m_s", "m/s", "Velocity-bias episodes: offset beyond the wanted speed at a bias strength of 1", from(0.0, 100.0)),
    row("episode.tolerance", "", "Accuracy of the plant: 1e-8 on every state, or 1e-6 m/s a step and faster", TOLERANCES),
    row("stages", "", "Trained one after the other; the replay buffer and the exploration begin anew", Limit::List(1, 16)),
    row("stages.medium", "", "Density ratios of the episodes", Limit::Table),
    row("stages.medium.kind", "", "1 - |N(0, 1)| / 10, |N(0, 1)| / 10, 1 and 0 in turn, or the shares below and the rest uniform", MEDIA),
    row("stages.medium.air", "", "Share of episodes at exactly 0", SHARE),
    row("stages.medium.thin", "", "Share uniform from 0 to thin_to", SHARE),
    row("stages.medium.thin_to", "", "See thin", SHARE),
    row("stages.medium.water", "", "Share at exactly 1", SHARE),
    row("stages.length", "", "Length of the stage, in steps or in episodes", Limit::Table),
    row("stages.length.episodes", "episodes", "Length", Limit::Whole(1, LONGEST)),
    row("stages.length.steps", "steps", "Length", Limit::Whole(1, LONGEST)),
    row("selection", "", "Selection of the best actor", Limit::Table),
    row("selection.evaluations", "", "Number of evaluations over the last stage, of which the best actor is selected; with 0 the last actor is", Limit::Whole(0, 10_000)),
    row("selection.starts", "", "Number of starts of an evaluation in a vacuum; a quarter of them run below a density ratio of 0.2, a sixteenth above", Limit::Whole(0, 1_000_000)),
    row("selection.tracking", "", "Weight of the tracking cost; a fall of all starts at one density ratio costs 1", from(0.0, 100.0)),
    row("randomisation", "", "What differs from episode to episode beside start and medium; each quantity has a distribution, and keeps the trainer's value without one", Limit::Table),
    row("randomisation.share", "", "Share of episodes that are randomised", SHARE),
    row("randomisation.mass", "", "Factor of the dry mass, of an episode", from(0.1, 10.0)),
    row("randomisation.stiffness", "", "Factor of the spring's stiffness, of an episode", from(0.1, 10.0)),
    row("randomisation.gravity", "", "Factor of gravity, of an episode", from(0.05, 5.0)),
    row("randomisation.damping_n_s_m", "N s/m", "Damping along the leg, of an episode", from(0.0, Losses::MAX_DAMPING_N_S_M)),
    row("randomisation.foot_mass_kg", "kg", "Mass of the foot, which the impact stops, of an episode", from(0.0, Losses::MAX_FOOT_MASS_KG)),
    row("randomisation.friction", "", "Coefficient of friction, of an episode", from(Losses::MIN_FRICTION, Losses::MAX_FRICTION)),
    row("randomisation.ground_m", "m", "Height of the ground on which a hop lands, of a hop", from(-10.0, 10.0)),
    row("randomisation.delay_s", "s", "Time after an apex until its angle is taken, and after a touchdown until the leg elongates, of an episode", from(0.0, 1.0)),
    row("randomisation.noise_vx_m_s", "m/s", "Noise on the observed velocity, of a hop", from(-10.0, 10.0)),
    row("randomisation.noise_y_m", "m", "Noise on the observed height, of a hop", from(-10.0, 10.0)),
    row("randomisation.noise_density_ratio", "", "Noise on the observed density ratio, of a hop", from(-1.0, 1.0)),
    row("randomisation.bias_vx_m_s", "m/s", "Error of the observed velocity, of an episode", from(-10.0, 10.0)),
    row("randomisation.bias_y_m", "m", "Error of the observed height, of an episode", from(-10.0, 10.0)),
    row("randomisation.bias_density_ratio", "", "Error of the observed density ratio, of an episode", from(-1.0, 1.0)),
    row("gains", "", "Gains of the velocity cascade by ascending density ratio; without any they are searched after the training", Limit::List(0, 16)),
    row("gains.density_ratio", "", "Density ratio of these gains", from(0.0, 100.0)),
    row("gains.kp", "", "Proportional gain", GAIN),
    row("gains.ki", "per apex", "Integral gain", GAIN),
    row("gains.kd", "per apex", "Derivative gain", GAIN),
    row("gains.feed_forward", "", "Feed-forward of the set-point", GAIN),
    row("gains.limit_m_s", "m/s", "Bound of the velocity offset", from(0.0, 100.0)),
];

/// Rows of the distribution of every randomised quantity, whose own row has the range of its
/// values.
#[rustfmt::skip]
static DISTRIBUTION: &[Key] = &[
    row("kind", "", "Distribution: uniform, uniform in the logarithm, or normal and clipped to low and high", DISTRIBUTIONS),
    row("low", "", "Lowest value", Limit::Table),
    row("high", "", "Highest value", Limit::Table),
    row("mean", "", "Mean before clipping", Limit::Table),
    row("deviation", "", "Standard deviation before clipping", above(0.0, 1e6)),
];

/// Returns the row of a path.
pub(super) fn find(path: &str) -> Option<Key> {
    if let Some(key) = KEYS.iter().find(|key| key.path == path) {
        return Some(*key);
    }
    let (parent, last) = path.strip_prefix("randomisation.")?.split_once('.')?;
    let key = DISTRIBUTION.iter().find(|key| key.path == last)?;
    let of = find(&format!("randomisation.{parent}"))?;
    let limit = if matches!(key.limit, Limit::Table) { of.limit } else { key.limit };
    Some(Key { unit: if last == "kind" { "" } else { of.unit }, limit, ..*key })
}

/// Returns the rows of the quantities that can be randomised, and their table's.
pub(super) fn randomisation() -> impl Iterator<Item = &'static Key> {
    KEYS.iter().filter(|key| key.path.starts_with("randomisation"))
}

impl fmt::Display for Key {
    /// Formats the row as a comment: description, unit and range.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.what)?;
        if !self.unit.is_empty() {
            write!(f, " [{}]", self.unit)?;
        }
        match self.limit {
            Limit::Table => Ok(()),
            limit => write!(f, ": {limit}"),
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use End::{Closed, Open};
        match *self {
            Self::Number { low: Closed(a), high: Closed(b) } => write!(f, "from {a} to {b}"),
            Self::Number { low: Closed(a), high: Open(b) } => write!(f, "from {a} to below {b}"),
            Self::Number { low: Open(a), high: Closed(b) } => write!(f, "above {a}, at most {b}"),
            Self::Number { low: Open(a), high: Open(b) } => write!(f, "above {a}, below {b}"),
            Self::NumberOrInfinite { low: Closed(a) } => write!(f, "at least {a}, or inf"),
            Self::NumberOrInfinite { low: Open(a) } => write!(f, "above {a}, or inf"),
            Self::Whole(a, b) => write!(f, "whole, from {a} to {b}"),
            Self::Choice(of) => {
                let of: Vec<_> = of.iter().map(ToString::to_string).collect();
                f.write_str(&of.join(" or "))
            }
            Self::Keyword(of) => f.write_str(&of.join(" or ")),
            Self::Flag => f.write_str("true or false"),
            Self::Name => write!(f, "1 to {NAME_BYTES} bytes, no control characters"),
            Self::Table => f.write_str("a table"),
            Self::List(least, most) => write!(f, "{least} to {most} of them"),
        }
    }
}

impl Limit {
    /// Whether a number is in the range.
    pub(super) fn allows_number(&self, x: f64) -> bool {
        let above = |end: End| match end {
            End::Closed(low) => x >= low,
            End::Open(low) => x > low,
        };
        let below = |end: End| match end {
            End::Closed(high) => x <= high,
            End::Open(high) => x < high,
        };
        match *self {
            Self::Number { low, high } => above(low) && below(high),
            Self::NumberOrInfinite { low } => above(low),
            _ => false,
        }
    }

    /// Whether a whole number is in the range.
    pub(super) fn allows_whole(&self, n: i64) -> bool {
        match self {
            Self::Whole(low, high) => (*low..=*high).contains(&n),
            Self::Choice(of) => of.contains(&n),
            _ => false,
        }
    }

    /// Whether a text is allowed.
    pub(super) fn allows_text(&self, text: &str) -> bool {
        match self {
            Self::Keyword(of) => of.contains(&text),
            Self::Name => {
                (1..=NAME_BYTES).contains(&text.len()) && !text.chars().any(char::is_control)
            }
            _ => false,
        }
    }

    /// Whether a list may have this length.
    pub(super) fn allows_length(&self, length: usize) -> bool {
        !matches!(self, Self::List(least, most) if !(*least..=*most).contains(&length))
    }
}
