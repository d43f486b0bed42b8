//! Learning to stop: starts, steps and rewards.

use crate::config::{Config, Episode, MediumDraw, Reward};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use sim_host::plant::{Action, Apex, Hopper, Leg, Medium};

/// An apex below this is no hop any more, m.
pub const LOWEST_APEX_M: f64 = 1.0;
/// Starts are above this, m.
const LOWEST_START_M: f64 = 1.001;

/// A standard normal number.
pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A start as the paper draws them: vx = spread N(0, 1), y = 1.001 + |spread N(0, 1)|.
pub fn draw_start(spread: f64, rng: &mut impl Rng) -> Apex {
    Apex { vx_m_s: spread * normal(rng), y_m: LOWEST_START_M + (spread * normal(rng)).abs() }
}

impl Episode {
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
    /// The density ratio of the episode with this number.
    pub(crate) fn density_ratio(&self, episode: u64, rng: &mut impl Rng) -> f64 {
        match *self {
            Self::Water => (1.0 - normal(rng).abs() / 10.0).max(0.0),
            Self::Land => (normal(rng).abs() / 10.0).min(1.0),
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
}

impl Reward {
    /// Of a step that led to `next`, or to a fall.
    #[must_use]
    pub fn of(&self, action: Action, next: Option<Apex>, density_ratio: f64) -> f64 {
        let Some(next) = next else { return self.fall };
        if self.low_is_fall && next.y_m < LOWEST_APEX_M {
            return self.fall;
        }
        let stopping = libm::log10(1.0 + 1.0 / next.vx_m_s.abs()).min(self.cap);
        let air = 1.0 - density_ratio;
        let elongation = self.elongation * (air * air).powi(5) * action.rs_m_s;
        let missing = (self.height_m - next.y_m) / (self.height_m - LOWEST_APEX_M);
        stopping - elongation - self.height * missing.max(0.0)
    }
}

/// An episode under way.
#[derive(Clone, Debug)]
pub struct Environment<'a> {
    config: &'a Config,
    hopper: Hopper,
    density_ratio: f64,
    apex: Apex,
}

/// What a step led to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The reward.
    pub reward: f64,
    /// Whether the episode ended for good: a fall or an apex below 1 m.
    pub ended: bool,
}

impl<'a> Environment<'a> {
    /// A new episode.
    ///
    /// # Panics
    /// Never: the densities drawn are valid.
    pub fn begin(
        config: &'a Config,
        medium: &MediumDraw,
        episode: u64,
        rng: &mut impl Rng,
    ) -> Self {
        let density_ratio = medium.density_ratio(episode, rng);
        let medium = Medium::AIR.with_density_ratio(density_ratio).expect("densities from 0 to 1");
        let tolerance = config.episode.tolerance.plant();
        Self {
            config,
            hopper: Hopper::new(&Leg::human(), medium).with_tolerance(tolerance),
            density_ratio,
            apex: config.episode.start(rng),
        }
    }

    /// The episode's density ratio.
    #[must_use]
    pub fn density_ratio(&self) -> f64 {
        self.density_ratio
    }

    /// The scaled observation, as the networks see it.
    #[must_use]
    pub fn observation(&self) -> [f32; 3] {
        let network = &self.config.network;
        let seen = [self.apex.vx_m_s, self.apex.y_m, self.density_ratio].map(|x| x as f32);
        [0, 1, 2].map(|i| (seen[i] - network.observation_offset[i]) * network.observation_scale[i])
    }

    /// The apex that the next step starts from.
    #[must_use]
    pub fn apex(&self) -> Apex {
        self.apex
    }

    /// One step with an action in unit space, clipped to the leg's bounds.
    pub fn step(&mut self, unit: [f32; 2]) -> Outcome {
        let n = &self.config.network;
        self.act([0, 1].map(|i| f64::from(n.action_offset[i] + n.action_scale[i] * unit[i])))
    }

    /// One step with an action in rad and m/s, clipped to the leg's bounds.
    pub fn act(&mut self, action: [f64; 2]) -> Outcome {
        let n = &self.config.network;
        let [alpha_rad, rs_m_s] = [0, 1]
            .map(|i| action[i].clamp(f64::from(n.action_low[i]), f64::from(n.action_high[i])));
        let action = Action { alpha_rad, rs_m_s };
        let next = self.hopper.hop(self.apex, action).outcome.next();
        let reward = self.config.reward.of(action, next, self.density_ratio);
        let standing = next.filter(|apex| apex.y_m >= LOWEST_APEX_M);
        // What follows an end is never bootstrapped from; keep it finite all the same.
        self.apex = next.unwrap_or(Apex { vx_m_s: 0.0, y_m: 0.0 });
        Outcome { reward, ended: standing.is_none() }
    }
}

#[cfg(test)]
mod tests {
    use super::{Environment, draw_start};
    use crate::config::MediumDraw;
    use crate::preset::Preset;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;
    use sim_host::plant::{Action, Apex};

    #[test]
    fn rewards_are_those_of_the_published_data() {
        let reward = Preset::Air.config().reward;
        let action = Action { alpha_rad: 1.5, rs_m_s: 1.0 };
        let at = |vx_m_s, y_m| reward.of(action, Some(Apex { vx_m_s, y_m }), 0.0);
        assert_eq!(at(1.0, 2.0), 2_f64.log10());
        assert_eq!(at(-1.0, 2.0), at(1.0, 2.0));
        // The last apex is paid although it is low; a fall is not.
        assert_eq!(at(1.0, 0.5), 2_f64.log10());
        assert_eq!(reward.of(action, None, 0.0), 0.0);
        let robust = Preset::Robust.config().reward;
        let low = Some(Apex { vx_m_s: 1.0, y_m: 0.999 });
        assert_eq!(robust.of(action, low, 1.0), -0.5);
        let apex = Some(Apex { vx_m_s: 1e-9, y_m: 1.4 });
        assert!((robust.of(action, apex, 0.0) - (2.0 - 0.2 - 0.25)).abs() < 1e-12);
        assert!((robust.of(action, apex, 1.0) - (2.0 - 0.25)).abs() < 1e-12);
    }

    #[test]
    fn densities_and_starts_are_drawn_as_documented() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut of = |medium: MediumDraw| -> Vec<f64> {
            (0..20_000).map(|i| medium.density_ratio(i, &mut rng)).collect()
        };
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        // E|N| is sqrt(2 / pi).
        assert!((mean(&of(MediumDraw::Water)) - 0.9202).abs() < 0.002);
        assert!((mean(&of(MediumDraw::Land)) - 0.0798).abs() < 0.002);
        assert_eq!(of(MediumDraw::WaterAndAir)[..4], [1.0, 0.0, 1.0, 0.0]);
        let mixed = of(MediumDraw::Mixed { air: 0.2, thin: 0.15, thin_to: 0.1, water: 0.1 });
        let share = |f: &dyn Fn(f64) -> bool| {
            mixed.iter().filter(|&&x| f(x)).count() as f64 / mixed.len() as f64
        };
        assert!((share(&|x| x == 0.0) - 0.2).abs() < 0.01);
        assert!((share(&|x| x == 1.0) - 0.1).abs() < 0.01);
        assert!((share(&|x| x > 0.0 && x < 0.1) - 0.205).abs() < 0.012);
        let starts: Vec<_> = (0..20_000).map(|_| draw_start(3.0, &mut rng)).collect();
        let squares: Vec<f64> = starts.iter().map(|s| s.vx_m_s.powi(2)).collect();
        assert!((mean(&squares) - 9.0).abs() < 0.4);
        assert!(starts.iter().all(|s| s.y_m >= 1.001));
    }

    #[test]
    fn an_episode_hops_until_it_ends() {
        let config = Preset::Robust.config();
        let mut rng = Pcg64::seed_from_u64(1);
        let mut environment = Environment::begin(&config, &MediumDraw::Water, 0, &mut rng);
        assert!(environment.observation().iter().all(|x| x.is_finite()));
        let outcome = environment.step([-1.0, 0.0]);
        assert!(outcome.reward.is_finite());
        // A leg stretched far back catches nothing.
        let ended = (0..50).any(|_| environment.step([-1.0, -1.0]).ended);
        assert!(ended);
    }
}
