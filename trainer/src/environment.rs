//! Learning to stop: starts, steps and rewards.
//!
//! In *led* episodes the environment does to the actor what the cascade will do: it
//! shows a velocity that is off by an offset u, and rewards stopping relative to a
//! wanted speed w. Pull s, drawn uniformly from 0.3 to 1.2, and a direction give
//! w = s / rho m/s, about what drag lets a leg reach at s = 1, and u = w + lead s.
//! The stronger the pull, the more velocity the leg seems to lack. No height is asked
//! for there, only not to fall: the fastest gaits are the lowest.

use crate::config::{Config, Episode, MediumDraw, Reward};
use leg_plant::{Action, Apex, Hopper, Leg, Medium};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

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
        let elongation = self.elongation * (air * air).powi(5) * action.elongation_speed_m_s;
        let missing = (self.height_m - next.y_m) / (self.height_m - LOWEST_APEX_M);
        stopping - elongation - self.height * missing.max(0.0)
    }
}

/// Where an episode begins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The first apex.
    pub apex: Apex,
    /// Density ratio of the whole episode.
    pub density_ratio: f64,
}

impl Start {
    /// The start of the episode with this number.
    pub fn draw(config: &Config, medium: &MediumDraw, episode: u64, rng: &mut impl Rng) -> Self {
        let density_ratio = medium.density_ratio(episode, rng);
        Self { apex: config.episode.start(rng), density_ratio }
    }
}

/// How a led episode looks to the actor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lead {
    /// Taken from the velocity that is shown, m/s.
    offset_m_s: f64,
    /// The speed that is rewarded, m/s.
    wanted_m_s: f64,
}

impl Episode {
    /// How an episode is led, if it is.
    fn lead(&self, density_ratio: f64, rng: &mut impl Rng) -> Option<Lead> {
        let levels = self.led_from.iter().zip(self.led_share).rev();
        let share = levels.into_iter().find(|(from, _)| density_ratio >= **from)?.1;
        if share == 0.0 || rng.random::<f64>() >= share {
            return None;
        }
        let pull: f64 = rng.random_range(0.3..1.2);
        let direction = if rng.random() { 1.0 } else { -1.0 };
        let wanted_m_s = direction * pull / density_ratio;
        Some(Lead { offset_m_s: wanted_m_s + direction * pull * self.lead_m_s, wanted_m_s })
    }
}

/// An episode under way.
#[derive(Clone, Debug)]
pub struct Environment<'a> {
    config: &'a Config,
    hopper: Hopper,
    start: Start,
    lead: Option<Lead>,
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
    /// If the start's density ratio is not one; those that are drawn are.
    #[must_use]
    pub fn new(config: &'a Config, start: Start) -> Self {
        let medium = Medium::AIR.with_density_ratio(start.density_ratio).expect("a density ratio");
        let tolerance = config.episode.tolerance.plant();
        let hopper = Hopper::new(&Leg::human(), medium).with_tolerance(tolerance);
        Self { config, hopper, start, lead: None, apex: start.apex }
    }

    /// Led, if chance and the configuration will have it.
    #[must_use]
    pub fn perhaps_led(self, rng: &mut impl Rng) -> Self {
        Self { lead: self.config.episode.lead(self.start.density_ratio, rng), ..self }
    }

    /// Where it began.
    #[must_use]
    pub fn start(&self) -> Start {
        self.start
    }

    /// Whether it is led.
    #[must_use]
    pub fn is_led(&self) -> bool {
        self.lead.is_some()
    }

    /// The episode's density ratio.
    #[must_use]
    pub fn density_ratio(&self) -> f64 {
        self.start.density_ratio
    }

    /// The scaled observation, as the networks see it.
    #[must_use]
    pub fn observation(&self) -> [f32; 3] {
        let network = &self.config.network;
        let offset_m_s = self.lead.map_or(0.0, |lead| lead.offset_m_s);
        let seen = [self.apex.vx_m_s - offset_m_s, self.apex.y_m, self.start.density_ratio];
        let seen = seen.map(|x| x as f32);
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
        let [touchdown_angle_rad, elongation_speed_m_s] = [0, 1]
            .map(|i| action[i].clamp(f64::from(n.action_low[i]), f64::from(n.action_high[i])));
        let action = Action { touchdown_angle_rad, elongation_speed_m_s };
        let next = self.hopper.hop(self.apex, action).outcome.next();
        let reward = match self.lead {
            None => self.config.reward.of(action, next, self.start.density_ratio),
            Some(Lead { wanted_m_s, .. }) => {
                let relative = |apex: Apex| Apex { vx_m_s: apex.vx_m_s - wanted_m_s, ..apex };
                let any_height = Reward { height: 0.0, ..self.config.reward.clone() };
                any_height.of(action, next.map(relative), self.start.density_ratio)
            }
        };
        let standing = next.filter(|apex| apex.y_m >= LOWEST_APEX_M);
        // What follows an end is never bootstrapped from; keep it finite all the same.
        self.apex = next.unwrap_or(Apex { vx_m_s: 0.0, y_m: 0.0 });
        Outcome { reward, ended: standing.is_none() }
    }
}

#[cfg(test)]
mod tests {
    use super::{Environment, Start, draw_start};
    use crate::config::MediumDraw;
    use crate::preset::Preset;
    use leg_plant::{Action, Apex};
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    #[test]
    fn rewards_are_those_of_the_published_data() {
        let reward = Preset::Air.config().reward;
        let action = Action { touchdown_angle_rad: 1.5, elongation_speed_m_s: 1.0 };
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
        let start = Start::draw(&config, &MediumDraw::Water, 0, &mut rng);
        let mut environment = Environment::new(&config, start);
        assert!(environment.observation().iter().all(|x| x.is_finite()));
        let outcome = environment.step([-1.0, 0.0]);
        assert!(outcome.reward.is_finite());
        // A leg stretched far back catches nothing.
        let ended = (0..50).any(|_| environment.step([-1.0, -1.0]).ended);
        assert!(ended);
    }

    #[test]
    fn a_led_episode_shows_too_little_velocity_and_rewards_the_wanted_speed() {
        let config = Preset::Robust.config();
        let mut rng = Pcg64::seed_from_u64(1);
        let apex = Apex { vx_m_s: 0.5, y_m: 1.5 };
        let mut led = 0;
        for _ in 0..1000 {
            let start = Start { apex, density_ratio: 0.9 };
            let plain = Environment::new(&config, start);
            let mut environment = plain.clone().perhaps_led(&mut rng);
            let Some(lead) = environment.lead else { continue };
            led += 1;
            let pull = lead.wanted_m_s.abs() * 0.9;
            assert!((0.3..1.2).contains(&pull), "{pull}");
            let ahead = lead.offset_m_s - lead.wanted_m_s;
            assert!((ahead - lead.wanted_m_s.signum() * 3.0 * pull).abs() < 1e-12);
            let shown = environment.observation()[0] / config.network.observation_scale[0];
            assert!((f64::from(shown) - (0.5 - lead.offset_m_s)).abs() < 1e-5);
            let outcome = environment.act([1.5, 1.0]);
            let missing = (environment.apex().vx_m_s - lead.wanted_m_s).abs();
            let stopping = (1.0 + 1.0 / missing).log10().min(2.0);
            assert!((outcome.reward - stopping).abs() < 1e-6, "{outcome:?} {stopping}");
        }
        assert!((430..570).contains(&led), "{led}");
        let thin = Start { apex, density_ratio: 0.6 };
        let any = (0..100).any(|_| Environment::new(&config, thin).perhaps_led(&mut rng).is_led());
        assert!(!any);
    }
}
