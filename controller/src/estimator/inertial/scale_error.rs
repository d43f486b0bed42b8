//! The scale error of the accelerometer along y: it stays the same over a run, and a stance shows
//! it, for there the encoders tell the change of the velocity too. Along x the spring brakes as much
//! as it pushes, so that the error changes little.
//!
//! A fifth state would cost every tick of the axis. Instead the four are estimated as if the
//! scale were known, and beside them how much each would change with it: the separated bias
//! estimation of Friedland, "Treatment of bias in recursive filtering", 1969. For a constant the
//! result is that of the larger filter.

use nalgebra::Vector4;

use super::axis::Axis;
use crate::estimator::factor::{Correction, Reading};

/// Walk of the scale error, as a share of its first deviation, per root second.
const WALK: f32 = 0.02;

/// The scale error, and what it does to the states along y.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleError {
    /// Specific force that is felt over the true one, less 1.
    pub(super) value: f32,
    variance: f32,
    /// Variance that a second adds.
    walk: f32,
    /// Change of the states with the error.
    by_error: Vector4<f32>,
}

impl ScaleError {
    /// Returns an error of which the standard deviation alone is known.
    pub(super) fn new(deviation: f32) -> Self {
        let variance = deviation * deviation;
        Self { value: 0.0, variance, walk: WALK * WALK * variance, by_error: Vector4::zeros() }
    }

    /// Returns what the error adds to the variances of the states.
    pub(super) fn variances(&self) -> Vector4<f32> {
        self.by_error.component_mul(&self.by_error) * self.variance
    }

    /// Follows the states over `dt_s`, in which the accelerometer felt an impulse, m/s.
    #[inline]
    pub(super) fn propagate(&mut self, felt_m_s: f32, dt_s: f32) {
        let by = &mut self.by_error;
        let before = by.z;
        by.z -= felt_m_s + dt_s * by.x;
        by.w += 0.5 * dt_s * (before + by.z);
    }

    /// Adds what the error may have changed in `dt_s`.
    pub(super) fn add_noise(&mut self, dt_s: f32) {
        self.variance += self.walk * dt_s;
    }

    /// Follows a reading of the force in flight, m/s2, which does not correct the error: a mass
    /// that is not the model's would pass for it.
    #[inline]
    pub(super) fn follow_in_flight(&mut self, reading: &Reading, gain: &Vector4<f32>, force: f32) {
        let seen = reading.by_state.dot(&self.by_error) + force;
        self.by_error -= gain * seen;
    }

    /// Corrects the error by a reading that has corrected the states.
    #[inline]
    pub(super) fn correct(&mut self, reading: &Reading, correction: &Correction, axis: &mut Axis) {
        let Correction { gain, innovation } = correction;
        let seen = reading.by_state.dot(&self.by_error);
        let covariance = self.variance * seen * innovation.inverse;
        let kept = 1.0 / (1.0 + covariance * seen);
        self.variance *= kept;
        self.by_error -= gain * seen;
        let change = covariance * kept * innovation.value;
        self.value += change;
        axis.add(&(self.by_error * change));
    }

    /// Forgets what the error did to the position, which has been renewed.
    pub(super) fn renew_position(&mut self) {
        self.by_error.w = 0.0;
    }
}
