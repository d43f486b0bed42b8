//! The accelerometer, and the sum of its readings.

use leg_control::measurement::SpecificImpulse;

use super::catalog::Figures;
use super::channel::Channel;
use super::figure::Sensor;
use super::rng;

/// Sums the specific force in body axes, in counts of [`SpecificImpulse::UNIT_M_S`].
///
/// Of each tick it measures the mean specific force: the change of the true velocity less
/// gravity's, over the tick. So without errors the sum is the true change of the velocity, however
/// stiff the spring is.
#[derive(Debug)]
pub(super) struct Accelerometer {
    axes: [Channel; 2],
    sum: [i32; 2],
    /// What the sum lacks, a part of a count: quantisation does not add up.
    remainder: [f64; 2],
}

impl Accelerometer {
    pub(super) fn new(figures: &Figures, run_rate_hz: u32, seed: u64) -> Self {
        // The sum takes in every tick, at whatever rate it is sent.
        let rate_hz = f64::from(run_rate_hz);
        let axis = |lane| {
            let rng = rng(seed, Sensor::Accelerometer, lane);
            Channel::new(figures, Sensor::Accelerometer, rate_hz, rng)
        };
        Self { axes: [axis(0), axis(1)], sum: [0; 2], remainder: [0.0; 2] }
    }

    /// Adds a tick of `dt_s` in which the velocity less gravity's part changed by `impulse_m_s`
    /// in level axes, and the body's pitch was `pitch_rad`.
    pub(super) fn add(&mut self, impulse_m_s: [f64; 2], pitch_rad: f64, dt_s: f64) {
        let [x, y] = impulse_m_s;
        let (sin, cos) = libm::sincos(pitch_rad);
        let of_body = [cos * x + sin * y, cos * y - sin * x];
        for (i, (axis, impulse_m_s)) in self.axes.iter_mut().zip(of_body).enumerate() {
            let force_m_s2 = impulse_m_s / dt_s;
            let counts = axis.read(force_m_s2, force_m_s2) * dt_s
                / f64::from(SpecificImpulse::UNIT_M_S)
                + self.remainder[i];
            let whole = libm::round(counts);
            // More than the sum's own range in one tick is nothing that a leg survives.
            if whole.abs() < f64::from(i32::MAX) {
                self.sum[i] = self.sum[i].wrapping_add(whole as i32);
                self.remainder[i] = counts - whole;
            }
        }
    }

    /// Returns the sum.
    pub(super) fn sum(&self) -> SpecificImpulse {
        SpecificImpulse(self.sum)
    }
}
