//! The noise of raw sensors, as the user states it.

/// The noise of each sensor of [`Sensors`](crate::measurement::Sensors): standard deviations.
/// Those of sensors that a leg does not have count for nothing.
///
/// Where a figure is not known, state one that is too large: the estimate is then a little
/// less certain. One that is too small makes the filter believe its sensors too much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Noise density of the accelerometer, m/s2 per root hertz: the deviation of a sample over
    /// the root of the samples a second.
    pub acceleration_density: f32,
    /// Bias of the accelerometer at its start, m/s2.
    pub acceleration_bias_m_s2: f32,
    /// Scale error of the accelerometer, as a share.
    pub acceleration_scale: f32,
    /// Walk of the bias, m/s2 per root second.
    pub bias_walk: f32,
    /// Specific force from which on the accelerometer clips, m/s2.
    pub acceleration_range_m_s2: f32,
    /// Error of the orientation at its start, rad.
    pub pitch_rad: f32,
    /// Walk of that error, rad per root second.
    pub pitch_walk: f32,
    /// Length of the leg, m.
    pub leg_length_m: f32,
    /// Angle of the leg, rad.
    pub leg_angle_rad: f32,
    /// Velocity over the ground, m/s.
    pub velocity_m_s: f32,
    /// Height above the ground, m.
    pub height_m: f32,
    /// Pressure, Pa.
    pub pressure_pa: f32,
}

impl Default for SensorNoise {
    /// Returns the figures of a common MEMS accelerometer (175 ug per root hertz, 20 mg, 0.5 %,
    /// 16 g),
    /// 0.03 rad of orientation with a walk of 1 mrad per root
    /// second, 1 mm and 14 bits of the leg's encoders, 0.02 m/s, 0.05 m and
    /// 50 Pa.
    fn default() -> Self {
        Self {
            acceleration_density: 1.7e-3,
            acceleration_bias_m_s2: 0.2,
            acceleration_scale: 0.005,
            bias_walk: 2e-3,
            acceleration_range_m_s2: 157.0,
            pitch_rad: 0.03,
            pitch_walk: 1e-3,
            leg_length_m: 1e-3,
            leg_angle_rad: 4e-4,
            velocity_m_s: 0.02,
            height_m: 0.05,
            pressure_pa: 50.0,
        }
    }
}

impl SensorNoise {
    /// Range of every figure.
    pub const RANGE: core::ops::RangeInclusive<f32> = 1e-6..=1e5;

    /// Returns whether every figure is within [`Self::RANGE`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.figures().iter().all(|figure| Self::RANGE.contains(figure))
    }

    /// Returns the figures in the order of declaration.
    #[must_use]
    pub fn figures(&self) -> [f32; 12] {
        let Self {
            acceleration_density,
            acceleration_bias_m_s2,
            acceleration_scale,
            bias_walk,
            acceleration_range_m_s2,
            pitch_rad,
            pitch_walk,
            leg_length_m,
            leg_angle_rad,
            velocity_m_s,
            height_m,
            pressure_pa,
        } = *self;
        [
            acceleration_density,
            acceleration_bias_m_s2,
            acceleration_scale,
            bias_walk,
            acceleration_range_m_s2,
            pitch_rad,
            pitch_walk,
            leg_length_m,
            leg_angle_rad,
            velocity_m_s,
            height_m,
            pressure_pa,
        ]
    }

    /// Returns the noise of these figures, the inverse of [`Self::figures`].
    #[must_use]
    pub fn from_figures(figures: [f32; 12]) -> Self {
        let [
            acceleration_density,
            acceleration_bias_m_s2,
            acceleration_scale,
            bias_walk,
            acceleration_range_m_s2,
            pitch_rad,
            pitch_walk,
            leg_length_m,
            leg_angle_rad,
            velocity_m_s,
            height_m,
            pressure_pa,
        ] = figures;
        Self {
            acceleration_density,
            acceleration_bias_m_s2,
            acceleration_scale,
            bias_walk,
            acceleration_range_m_s2,
            pitch_rad,
            pitch_walk,
            leg_length_m,
            leg_angle_rad,
            velocity_m_s,
            height_m,
            pressure_pa,
        }
    }
}
