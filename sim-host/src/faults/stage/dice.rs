//! Chance, by seed.

use std::f64::consts::TAU;

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// The generator of one fault.
#[derive(Clone, Debug)]
pub struct Dice(Pcg32);

impl Dice {
    /// That of the fault `index` in a run of this seed: another index is another
    /// sequence, not a later part of the same one.
    #[must_use]
    pub fn new(seed: u64, index: u64) -> Self {
        Self(Pcg32::new(seed, index))
    }

    /// From 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Yes, in this share of the cases, 0 to 1.
    pub fn happens(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    /// A whole number from 0 to `most`.
    pub fn up_to(&mut self, most: u32) -> u32 {
        (self.unit() * (f64::from(most) + 1.0)) as u32
    }

    /// Of a normal distribution of mean 0 and standard deviation 1, by Box and
    /// Muller; the functions of `libm` are the same on every machine.
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(TAU * self.unit())
    }
}
