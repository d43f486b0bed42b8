//! Random numbers of the tests: the same on every machine.

use core::f64::consts::TAU;

/// Xorshift64*, of George Marsaglia and Sebastiano Vigna.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }

    /// Returns a number of the uniform distribution between 0 and 1.
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11;
        (bits as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Returns a number of the standard normal distribution, by the Box-Muller transform.
    pub(super) fn normal(&mut self) -> f32 {
        let radius = libm::sqrt(-2.0 * libm::log(self.uniform()));
        (radius * libm::cos(TAU * self.uniform())) as f32
    }
}
