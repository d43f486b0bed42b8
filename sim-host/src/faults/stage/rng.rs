//! The random generator of a fault.

use std::f64::consts::TAU;

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// A seeded random generator. The same seed and index give the same sequence on every machine.
#[derive(Clone, Debug)]
pub struct FaultRng(Pcg32);

impl FaultRng {
    /// Creates the generator of fault `index` in a run of this seed. Each index has a sequence of
    /// its own, not a later part of the same one.
    #[must_use]
    pub fn new(seed: u64, index: u64) -> Self {
        Self(Pcg32::new(seed, index))
    }

    /// Draws a number of the uniform distribution over `[0, 1)`.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Returns true with this probability, 0 to 1.
    pub fn occurs(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Draws a whole number from 0 to `max`, both included.
    pub fn up_to(&mut self, max: u32) -> u32 {
        (self.uniform() * (f64::from(max) + 1.0)) as u32
    }

    /// Draws a number of the normal distribution of mean 0 and standard deviation 1, by the
    /// Box-Muller transform. The functions of `libm` give the same bits on every machine.
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
        radius * libm::cos(TAU * self.uniform())
    }
}
