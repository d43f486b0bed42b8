//! Exploration noise.

use crate::config::Exploration;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// A source of exploration noise, in unit space.
#[derive(Clone, Debug)]
pub struct Noise {
    kind: Exploration,
    /// Present standard deviation.
    deviation: f32,
    /// State of the Ornstein-Uhlenbeck process.
    state: [f32; 2],
}

/// The state of a noise source, as a checkpoint stores it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct NoiseState {
    deviation: f32,
    state: [f32; 2],
}

impl Noise {
    /// Returns the noise source for the start of a stage.
    #[must_use]
    pub fn new(kind: &Exploration) -> Self {
        let deviation = match kind {
            Exploration::OrnsteinUhlenbeck { deviation, .. } => *deviation,
            Exploration::Gaussian { deviation } => deviation[1],
        };
        Self { kind: kind.clone(), deviation, state: [0.0; 2] }
    }

    /// Returns the state to store in a checkpoint.
    #[must_use]
    pub fn state(&self) -> NoiseState {
        NoiseState { deviation: self.deviation, state: self.state }
    }

    /// Restores a source of the same kind from its state.
    #[must_use]
    pub fn from_state(kind: &Exploration, state: NoiseState) -> Self {
        Self { kind: kind.clone(), deviation: state.deviation, state: state.state }
    }

    /// Begins an episode: resets the process, or draws the episode's deviation.
    pub fn begin_episode(&mut self, rng: &mut impl Rng) {
        self.state = [0.0; 2];
        if let Exploration::Gaussian { deviation: [low, high] } = self.kind {
            let at = rng.random::<f32>();
            self.deviation = low * libm::powf(high / low, at);
        }
    }

    /// Returns the noise of the next step, in unit space.
    pub fn next(&mut self, rng: &mut impl Rng) -> [f32; 2] {
        let normal = [0; 2].map(|_| StandardNormal.sample(rng)).map(|n: f32| self.deviation * n);
        match self.kind {
            Exploration::OrnsteinUhlenbeck { attraction, decay, .. } => {
                for (x, n) in self.state.iter_mut().zip(normal) {
                    *x += n - attraction * *x;
                }
                self.deviation *= 1.0 - decay;
                self.state
            }
            Exploration::Gaussian { .. } => normal,
        }
    }

    /// Whether the replay buffer stores actions as the environment clips them.
    #[must_use]
    pub fn stores_clipped(&self) -> bool {
        !matches!(self.kind, Exploration::OrnsteinUhlenbeck { keep_unclipped: true, .. })
    }
}

#[cfg(test)]
mod tests {
    use super::Noise;
    use crate::config::Exploration;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    #[test]
    fn ornstein_uhlenbeck_noise_reaches_its_stationary_variance_and_decays() {
        let kind = |decay| Exploration::OrnsteinUhlenbeck {
            attraction: 0.15,
            deviation: 0.6,
            decay,
            keep_unclipped: true,
        };
        let mut rng = Pcg64::seed_from_u64(1);
        let mut noise = Noise::new(&kind(0.0));
        noise.begin_episode(&mut rng);
        let n = 100_000;
        let sum: f32 = (0..n).map(|_| noise.next(&mut rng)[0].powi(2)).sum();
        // The variance of x' = 0.85 x + n is 0.36 / (1 - 0.85^2).
        let variance = sum / n as f32;
        assert!((variance - 1.297).abs() < 0.05, "{variance}");
        let mut noise = Noise::new(&kind(1e-3));
        (0..1000).for_each(|_| _ = noise.next(&mut rng));
        assert!((noise.deviation - 0.6 * 0.999_f32.powi(1000)).abs() < 1e-5);
    }

    #[test]
    fn gaussian_noise_draws_a_log_uniform_deviation_for_each_episode() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut noise = Noise::new(&Exploration::Gaussian { deviation: [0.003, 0.4] });
        let mut below = 0;
        for _ in 0..1000 {
            noise.begin_episode(&mut rng);
            assert!((0.003..=0.4001).contains(&noise.deviation));
            below += usize::from(noise.deviation < 0.0346);
        }
        // Half of a log-uniform distribution lies below the geometric mean.
        assert!((450..550).contains(&below), "{below}");
    }
}
