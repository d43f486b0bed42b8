//! The environment of a training: starts, steps and rewards of learning to stop.
//!
//! In *velocity-bias* episodes the environment does to the actor what the velocity
//! cascade does later: it shows a velocity that is too low by an offset u, and rewards
//! stopping relative to a wanted speed w. With a strength s, drawn uniformly from 0.3 to
//! 1.2, and a direction, w = s / rho m/s (about the speed that drag permits at s = 1) and
//! u = w + `lead_m_s` s. The larger s, the larger the velocity error that the actor sees.
//! The cost of a low apex is left out in these episodes, because the fastest gaits are
//! the lowest.

#[cfg(test)]
mod tests;

use crate::config::{Config, Episode, MediumDraw, Reward};
use crate::world::{PathPoint, Shown, World};
use leg_control::leg::LegModel;
use leg_plant::{Action, Apex, EARTH_GRAVITY_M_S2, Leg};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Lowest apex height that counts as a hop, m.
pub const LOWEST_APEX_M: f64 = 1.0;
/// Lowest apex height of a start, m.
const LOWEST_START_M: f64 = 1.001;
/// The density ratio of [`MediumDraw::Water`] and [`MediumDraw::Land`] is off its pure
/// medium by a normal number over this: a standard deviation of 0.1.
const DRAWS_PER_RATIO: f64 = 10.0;
/// Standard deviations that the range of a normal draw states.
const RANGE_DEVIATIONS: f64 = 3.0;

/// Returns the leg that every training uses.
#[must_use]
pub fn leg() -> Leg {
    Leg::human()
}

/// Returns [`leg`] as a policy file states it.
#[must_use]
pub fn leg_model() -> LegModel {
    let leg = leg();
    let p = leg.parameters();
    LegModel {
        mass_kg: p.mass_kg as f32,
        added_mass_kg: p.added_mass_kg as f32,
        stiffness_n_m: p.stiffness_n_m as f32,
        volume_m3: p.volume_m3 as f32,
        rest_length_m: p.rest_length_m as f32,
        max_elongation_m: p.max_elongation_m as f32,
        area_x_m2: p.area_x_m2 as f32,
        area_y_m2: p.area_y_m2 as f32,
        drag_x: p.drag_x as f32,
        drag_y: p.drag_y as f32,
    }
}

/// Gravity of every training that does not randomise it, lowest and highest, m/s2.
pub const GRAVITY_M_S2: [f32; 2] = [EARTH_GRAVITY_M_S2 as f32; 2];

/// Draws a standard normal number.
pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Draws a start as the paper does: vx = spread N(0, 1), y = 1.001 + |spread N(0, 1)|,
/// in m/s and m.
pub fn draw_start(spread: f64, rng: &mut impl Rng) -> Apex {
    Apex { vx_m_s: spread * normal(rng), y_m: LOWEST_START_M + (spread * normal(rng)).abs() }
}

impl Episode {
    /// Draws the first apex of an episode.
    fn start(&self, rng: &mut impl Rng) -> Apex {
        let which: f64 = rng.random();
        if which < self.uniform_share {
            return Apex {
                vx_m_s: rng.random_range(-11.0..=11.0),
                y_m: rng.random_range(1.0..=12.5),
            };
        }
        let mut start = draw_start(self.spread, rng);
        if which < self.uniform_share + self.low_share {
            start.y_m = LOWEST_START_M + (0.4 * normal(rng)).abs();
        }
        start
    }
}

impl MediumDraw {
    /// Draws the density ratio of an episode; `episode` counts from 0 in each stage.
    pub(crate) fn density_ratio(&self, episode: u64, rng: &mut impl Rng) -> f64 {
        match *self {
            Self::Water => (1.0 - normal(rng).abs() / DRAWS_PER_RATIO).max(0.0),
            Self::Land => (normal(rng).abs() / DRAWS_PER_RATIO).min(1.0),
            Self::WaterAndAir => ((episode + 1) % 2) as f64,
            Self::Mixed { air, thin, thin_to, water } => {
                let (which, at): (f64, f64) = (rng.random(), rng.random());
                if which < air {
                    0.0
                } else if which < air + thin {
                    thin_to * at
                } else if which < air + thin + water {
                    1.0
                } else {
                    at
                }
            }
        }
    }

    /// Returns the lowest and highest density ratio that [`Self::density_ratio`] draws;
    /// of its normal draws, those within [`RANGE_DEVIATIONS`].
    fn density_range(&self) -> [f64; 2] {
        let deviation = RANGE_DEVIATIONS / DRAWS_PER_RATIO;
        match *self {
            Self::Water => [1.0 - deviation, 1.0],
            Self::Land => [0.0, deviation],
            Self::WaterAndAir => [0.0, 1.0],
            Self::Mixed { air, thin, thin_to, water } => {
                let rest = 1.0 - (air + thin + water);
                let parts = [
                    (air, [0.0, 0.0]),
                    (thin, [0.0, thin_to]),
                    (water, [1.0, 1.0]),
                    (rest, [0.0, 1.0]),
                ];
                let drawn = parts.into_iter().filter(|(share, _)| *share > 1e-9);
                drawn.map(|(_, range)| range).reduce(union).unwrap_or([0.0, 1.0])
            }
        }
    }
}

/// Returns the smallest range that holds both.
fn union(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Config {
    /// Returns the lowest and highest density ratio of all stages; of normal draws, those
    /// within three standard deviations.
    #[must_use]
    pub fn density_range(&self) -> [f32; 2] {
        let stages = self.stages.iter().map(|stage| stage.medium.density_range());
        stages.reduce(union).unwrap_or([0.0, 1.0]).map(|rho| rho as f32)
    }

    /// Returns the lowest and highest gravity of the training, m/s2.
    #[must_use]
    pub fn gravity_range_m_s2(&self) -> [f32; 2] {
        self.randomisation.as_ref().map_or(GRAVITY_M_S2, |randomisation| {
            randomisation.gravity_range().map(|factor| (factor * EARTH_GRAVITY_M_S2) as f32)
        })
    }
}

impl Reward {
    /// Returns the reward of a step to the apex `next`; `None` is a fall.
    #[must_use]
    pub fn of(&self, action: Action, next: Option<Apex>, density_ratio: f64) -> f64 {
        let Some(next) = next else { return self.fall };
        if self.low_is_fall && next.y_m < LOWEST_APEX_M {
            return self.fall;
        }
        let stopping = libm::log10(1.0 + 1.0 / next.vx_m_s.abs()).min(self.cap);
        let air = 1.0 - density_ratio;
        let elongation = self.elongation * (air * air).powi(5) * action.elongation_speed_m_s;
        let missing = (self.height_m - next.y_m) / (self.height_m - LOWEST_APEX_M);
        stopping - elongation - self.height * missing.max(0.0)
    }
}

/// The start of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The first apex.
    pub apex: Apex,
    /// Density ratio of the whole episode.
    pub density_ratio: f64,
}

impl Start {
    /// Draws the start of an episode; `episode` counts from 0 in each stage.
    pub fn draw(config: &Config, medium: &MediumDraw, episode: u64, rng: &mut impl Rng) -> Self {
        let density_ratio = medium.density_ratio(episode, rng);
        Self { apex: config.episode.start(rng), density_ratio }
    }
}

/// The bias of a velocity-bias episode.
#[derive(Clone, Copy, Debug, PartialEq)]
struct VelocityBias {
    /// Subtracted from the velocity that the actor sees, m/s.
    offset_m_s: f64,
    /// Apex velocity at which the reward is highest, m/s.
    wanted_m_s: f64,
}

impl Episode {
    /// Draws the bias of an episode; `None` for an episode without one.
    fn velocity_bias(&self, density_ratio: f64, rng: &mut impl Rng) -> Option<VelocityBias> {
        let levels = self.led_from.iter().zip(self.led_share).rev();
        let share = levels.into_iter().find(|(from, _)| density_ratio >= **from)?.1;
        if share == 0.0 || rng.random::<f64>() >= share {
            return None;
        }
        let strength: f64 = rng.random_range(0.3..1.2);
        let direction = if rng.random() { 1.0 } else { -1.0 };
        let wanted_m_s = direction * strength / density_ratio;
        let offset_m_s = wanted_m_s + direction * strength * self.lead_m_s;
        Some(VelocityBias { offset_m_s, wanted_m_s })
    }
}

/// A running episode.
#[derive(Clone, Debug)]
pub struct Environment<'a> {
    config: &'a Config,
    world: World,
    start: Start,
    bias: Option<VelocityBias>,
    apex: Apex,
}

/// The outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Reward of the step.
    pub reward: f64,
    /// Whether the episode ended with a fall or an apex below 1 m.
    pub ended: bool,
}

impl<'a> Environment<'a> {
    /// Begins an episode without a velocity bias and without randomisation.
    ///
    /// # Panics
    /// If the start's density ratio is negative or not finite.
    #[must_use]
    pub fn new(config: &'a Config, start: Start) -> Self {
        let world = World::exact(start.density_ratio, config.episode.tolerance.plant());
        Self { config, world, start, bias: None, apex: start.apex }
    }

    /// Draws the world of this episode of a training with this seed, where the configuration has a
    /// randomisation. Episodes count over all stages. A velocity-bias episode stays exact: it
    /// leads to the highest speeds, which a weak leg or slippery ground does not carry.
    #[must_use]
    pub fn with_random_world(self, seed: u64, episode: u64) -> Self {
        let (Some(randomisation), None) = (&self.config.randomisation, self.bias) else {
            return self;
        };
        let tolerance = self.config.episode.tolerance.plant();
        let density_ratio = self.start.density_ratio;
        let world = World::draw(randomisation, seed, episode, density_ratio, tolerance);
        Self { world, ..self }
    }

    /// Adds a velocity bias with the configured probability.
    #[must_use]
    pub fn with_random_bias(self, rng: &mut impl Rng) -> Self {
        Self { bias: self.config.episode.velocity_bias(self.start.density_ratio, rng), ..self }
    }

    /// Returns the start of the episode.
    #[must_use]
    pub fn start(&self) -> Start {
        self.start
    }

    /// Whether this is a velocity-bias episode.
    #[must_use]
    pub fn is_biased(&self) -> bool {
        self.bias.is_some()
    }

    /// Whether the world of the episode is randomised.
    #[must_use]
    pub fn is_randomised(&self) -> bool {
        self.world.is_randomised()
    }

    /// Returns the episode's density ratio.
    #[must_use]
    pub fn density_ratio(&self) -> f64 {
        self.start.density_ratio
    }

    /// Returns the scaled observation, which is the networks' input.
    #[must_use]
    pub fn observation(&self) -> [f32; 3] {
        let network = &self.config.network;
        let offset_m_s = self.bias.map_or(0.0, |bias| bias.offset_m_s);
        let [vx_m_s, y_m, density_ratio] = self.shown();
        let shown = [vx_m_s - offset_m_s, y_m, density_ratio].map(|x| x as f32);
        [0, 1, 2].map(|i| (shown[i] - network.observation_offset[i]) * network.observation_scale[i])
    }

    /// Returns what the actor observes of the apex that the next step starts from, without a
    /// velocity bias.
    #[must_use]
    pub fn shown(&self) -> Shown {
        self.world.show(self.apex)
    }

    /// Returns the apex that the next step starts from.
    #[must_use]
    pub fn apex(&self) -> Apex {
        self.apex
    }

    /// Takes a step with an action in unit space, clipped to the leg's bounds.
    pub fn step(&mut self, unit: [f32; 2]) -> Outcome {
        let n = &self.config.network;
        self.act([0, 1].map(|i| f64::from(n.action_offset[i] + n.action_scale[i] * unit[i])))
    }

    /// Returns an action within the leg's bounds.
    fn within_bounds(&self, action: [f64; 2]) -> Action {
        let n = &self.config.network;
        let [touchdown_angle_rad, elongation_speed_m_s] = [0, 1]
            .map(|i| action[i].clamp(f64::from(n.action_low[i]), f64::from(n.action_high[i])));
        Action { touchdown_angle_rad, elongation_speed_m_s }
    }

    /// Returns the way of the hop that [`Self::act`] would take with this action.
    #[must_use]
    pub fn path(&self, action: [f64; 2]) -> Vec<PathPoint> {
        self.world.path(self.apex, self.within_bounds(action))
    }

    /// Takes a step with an action in rad and m/s, clipped to the leg's bounds.
    pub fn act(&mut self, action: [f64; 2]) -> Outcome {
        let action = self.within_bounds(action);
        let next = self.world.hop(self.apex, action);
        let reward = match self.bias {
            None => self.config.reward.of(action, next, self.start.density_ratio),
            Some(VelocityBias { wanted_m_s, .. }) => {
                let relative = |apex: Apex| Apex { vx_m_s: apex.vx_m_s - wanted_m_s, ..apex };
                let any_height = Reward { height: 0.0, ..self.config.reward.clone() };
                any_height.of(action, next.map(relative), self.start.density_ratio)
            }
        };
        let ended = next.is_none_or(|apex| apex.y_m < LOWEST_APEX_M);
        // No update uses the value of this state, but its bits enter the networks.
        self.apex = next.unwrap_or(Apex { vx_m_s: 0.0, y_m: 0.0 });
        Outcome { reward, ended }
    }
}
