//! One channel of a sensor: what it makes of the true value.

use super::catalog::Figures;
use super::figure::{Quantity, Sensor};
use crate::faults::stage::FaultRng;

/// A channel with noise, bias, scale error, clipping and quantisation, in this order. A figure of
/// 0 leaves the value as it is, to the last bit.
#[derive(Debug)]
pub(super) struct Channel {
    /// Standard deviation of the noise of a reading.
    noise: f64,
    noise_share: f64,
    uniform: f64,
    bias: f64,
    /// Standard deviation of the change of the bias between two readings.
    walk: f64,
    scale: f64,
    resolution: f64,
    range: f64,
    rng: FaultRng,
}

impl Channel {
    /// Creates a channel that is read `rate_hz` times a second. Draws the signs of bias and scale
    /// error.
    pub(super) fn new(figures: &Figures, sensor: Sensor, rate_hz: f64, mut rng: FaultRng) -> Self {
        let figure = |quantity| figures.of(sensor, quantity);
        let mut signed = |quantity| {
            let size = figure(quantity);
            if rng.occurs(0.5) { size } else { -size }
        };
        let (bias, scale) = (signed(Quantity::Bias), signed(Quantity::Scale));
        let is_density = matches!(sensor, Sensor::Accelerometer | Sensor::Gyro);
        let noise = figure(Quantity::Noise);
        Self {
            noise: if is_density { noise * libm::sqrt(rate_hz) } else { noise },
            noise_share: figure(Quantity::NoiseShare),
            uniform: figure(Quantity::Uniform),
            bias,
            walk: figure(Quantity::Walk) / libm::sqrt(rate_hz),
            scale,
            resolution: figure(Quantity::Resolution),
            range: figure(Quantity::Range),
            rng,
        }
    }

    /// Returns the reading of a true value; `size` is that of which a share is noise.
    pub(super) fn read(&mut self, truth: f64, size: f64) -> f64 {
        if self.walk > 0.0 {
            self.bias += self.walk * self.rng.normal();
        }
        let mut reading = truth;
        if self.scale != 0.0 {
            reading *= 1.0 + self.scale;
        }
        if self.bias != 0.0 {
            reading += self.bias;
        }
        if self.noise > 0.0 {
            reading += self.noise * self.rng.normal();
        }
        if self.noise_share > 0.0 {
            reading += self.noise_share * size.abs() * self.rng.normal();
        }
        if self.uniform > 0.0 {
            reading += self.uniform * (2.0 * self.rng.uniform() - 1.0);
        }
        if self.range > 0.0 {
            reading = reading.clamp(-self.range, self.range);
        }
        if self.resolution > 0.0 {
            reading = self.resolution * libm::round(reading / self.resolution);
        }
        reading
    }
}
