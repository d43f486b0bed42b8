//! What the leg and the stated noise make of the constants.

use crate::estimator::sensor_noise::SensorNoise;
use crate::leg::{LegModel, WATER_DENSITY_KG_M3};

/// Process noise of the velocities beside that of the accelerometer, m2/s3: its scale.
pub(super) const VELOCITY_NOISE: f32 = 0.02 * 0.02;
/// Deviation of the height of the ground between foothold and mass, m.
pub(super) const GROUND_M: f32 = 0.1;

/// What the leg and its tick make of the constants.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scales {
    pub(super) gravity_m_s2: f32,
    pub(super) rest_length_m: f32,
    /// Variance of an impulse over a second, m2/s3, by the accelerometer's noise alone.
    pub(super) force_noise: f32,
    /// The same with what else moves the velocity.
    pub(super) impulse_noise: f32,
    pub(super) bias_noise: f32,
    pub(super) tilt_noise: f32,
    pub(super) clips_from_m_s2: f32,
    pub(super) length_variance: f32,
    pub(super) angle_variance: f32,
    pub(super) velocity_variance: f32,
    pub(super) height_variance: f32,
    /// Of the height of a column of water, m2.
    pub(super) pressure_variance: f32,
    /// Height of a column of water, m/Pa.
    pub(super) column_m_pa: f32,
}

impl Scales {
    pub(super) fn new(leg: &LegModel, gravity_m_s2: f32, noise: &SensorNoise) -> Self {
        let square = |x: f32| x * x;
        let column_m_pa = 1.0 / (WATER_DENSITY_KG_M3 * gravity_m_s2);
        Self {
            gravity_m_s2,
            rest_length_m: leg.rest_length_m,
            force_noise: square(noise.acceleration_density),
            impulse_noise: square(noise.acceleration_density) + VELOCITY_NOISE * 1e-3,
            bias_noise: square(noise.bias_walk),
            tilt_noise: square(noise.pitch_walk),
            clips_from_m_s2: 0.99 * noise.acceleration_range_m_s2,
            length_variance: square(noise.leg_length_m),
            angle_variance: square(noise.leg_angle_rad),
            velocity_variance: square(noise.velocity_m_s),
            height_variance: square(noise.height_m) + square(GROUND_M),
            pressure_variance: 2.0 * square(noise.pressure_pa * column_m_pa),
            column_m_pa,
        }
    }
}
