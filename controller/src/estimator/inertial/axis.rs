//! One axis of the motion: what is estimated of it, and how it is corrected.

use nalgebra::Vector4;

use crate::estimator::factor::{Correction, Factor, Reading};

/// So many readings in a row beyond the gate, and the states are wrong, not the readings.
const GATED_IN_A_ROW: u8 = 10;

/// The states of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    /// Bias of the accelerometer, m/s2.
    pub(super) bias_m_s2: f32,
    /// Along x the error of the orientation, rad; along y the density ratio.
    pub(super) parameter: f32,
    /// Velocity, m/s.
    pub(super) velocity_m_s: f32,
    /// Along x from the foot to the mass in stance, m; along y the height over the foothold, m.
    pub(super) position_m: f32,
    pub(super) factor: Factor,
    gated_in_a_row: u8,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Use {
    /// It was used.
    Taken(Correction),
    /// It was too far off.
    LeftOut,
    /// It was one of too many in a row that were too far off.
    Contradicts,
}

impl Axis {
    /// Returns an axis with these states, each with its variance.
    pub(super) fn new(states: [[f32; 2]; 4]) -> Self {
        let [bias, parameter, velocity, position] = states;
        Self {
            bias_m_s2: bias[0],
            parameter: parameter[0],
            velocity_m_s: velocity[0],
            position_m: position[0],
            factor: Factor::new([bias[1], parameter[1], velocity[1], position[1]]),
            gated_in_a_row: 0,
        }
    }

    /// Adds a change of the velocity over `dt_s` that does not count the bias yet, m/s; the
    /// parameter takes part in it by `gain`, m/s, which is counted.
    pub(super) fn advance(&mut self, change_m_s: f32, dt_s: f32, gain: f32, noise: [f32; 2]) {
        let before_m_s = self.velocity_m_s;
        self.velocity_m_s += change_m_s - self.bias_m_s2 * dt_s;
        self.position_m += 0.5 * dt_s * (before_m_s + self.velocity_m_s);
        self.factor.propagate(dt_s, gain, noise);
    }

    /// Takes a reading.
    #[inline]
    pub(super) fn correct(&mut self, reading: &Reading) -> Use {
        let correction = self.factor.update(reading);
        self.apply(correction)
    }

    /// Takes a reading that is not to correct the bias.
    #[inline]
    pub(super) fn correct_all_but_bias(&mut self, reading: &Reading) -> Use {
        let correction = self.factor.update_all_but_bias(reading);
        self.apply(correction)
    }

    #[inline]
    fn apply(&mut self, correction: Option<Correction>) -> Use {
        let Some(correction) = correction else { return self.leave_out() };
        self.gated_in_a_row = 0;
        self.add(&correction.by());
        Use::Taken(correction)
    }

    /// Adds a change of the states.
    #[inline]
    pub(super) fn add(&mut self, change: &Vector4<f32>) {
        self.bias_m_s2 += change.x;
        self.parameter += change.y;
        self.velocity_m_s += change.z;
        self.position_m += change.w;
    }

    #[inline(never)]
    fn leave_out(&mut self) -> Use {
        self.gated_in_a_row += 1;
        if self.gated_in_a_row < GATED_IN_A_ROW {
            return Use::LeftOut;
        }
        self.gated_in_a_row = 0;
        Use::Contradicts
    }

    /// Takes a reading of the position as the position, whatever was known of it. The position
    /// so read changes with the parameter by `by_parameter`, m for each of its unit.
    pub(super) fn renew_position(&mut self, position_m: f32, by_parameter: f32, variance: f32) {
        self.position_m = position_m;
        self.factor.renew_position(by_parameter, variance);
        self.gated_in_a_row = 0;
    }

    /// Returns whether every number is finite.
    pub(super) fn is_finite(&self) -> bool {
        let Self { bias_m_s2, parameter, velocity_m_s, position_m, factor, .. } = self;
        let states = bias_m_s2 + parameter + velocity_m_s + position_m;
        (states + factor.variances().sum()).is_finite()
    }
}

/// Derivatives of a reading of the position alone.
pub(super) const POSITION: Vector4<f32> = Vector4::new(0.0, 0.0, 0.0, 1.0);
/// Derivatives of a reading of the velocity alone.
pub(super) const VELOCITY: Vector4<f32> = Vector4::new(0.0, 0.0, 1.0, 0.0);
