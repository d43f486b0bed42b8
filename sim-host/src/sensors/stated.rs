//! What an estimator is told of the sensors.

use leg_control::estimator::{SensorNoise, StateNoise};
use leg_control::serial::message::Estimator;

use super::catalog::Figures;
use super::figure::{Quantity, Sensor};

/// Largest speed for which the share of a velocity's noise is stated, m/s.
const SPEED_M_S: f64 = 1.0;
/// Largest height for which the scale error of an echo sounder is stated, m.
const HEIGHT_M: f64 = 2.0;

impl Figures {
    /// Returns the estimator for these sensors: from the state's channels where the leg senses
    /// them, for their noise is measured; else from raw sensors, with their noise stated.
    #[must_use]
    pub fn estimator(&self) -> Estimator {
        if self.has(Sensor::State) {
            let StateNoise { velocity_m_s, height_m, leg_length_m } = StateNoise::default();
            Estimator::State { velocity_m_s, height_m, leg_length_m }
        } else {
            Estimator::Inertial { figures: self.stated().figures() }
        }
    }

    /// Returns the noise of raw sensors as these figures state it.
    #[must_use]
    pub fn stated(&self) -> SensorNoise {
        let of = |sensor, quantity| self.of(sensor, quantity);
        // Uniform within a step of the resolution.
        let rounding = |sensor| of(sensor, Quantity::Resolution) / 12_f64.sqrt();
        let white = |sensor| of(sensor, Quantity::Noise).hypot(rounding(sensor));
        let off = |sensor| white(sensor).hypot(of(sensor, Quantity::Bias));
        let slow = |sensor: Sensor, size: f64| {
            let share = of(sensor, Quantity::NoiseShare).hypot(of(sensor, Quantity::Scale));
            off(sensor).hypot(share * size)
        };
        let stated = |figure: f64| {
            (figure as f32).clamp(*SensorNoise::RANGE.start(), *SensorNoise::RANGE.end())
        };
        let range = of(Sensor::Accelerometer, Quantity::Range);
        SensorNoise {
            acceleration_density: stated(of(Sensor::Accelerometer, Quantity::Noise)),
            acceleration_bias_m_s2: stated(of(Sensor::Accelerometer, Quantity::Bias)),
            acceleration_scale: stated(of(Sensor::Accelerometer, Quantity::Scale)),
            bias_walk: stated(of(Sensor::Accelerometer, Quantity::Walk)),
            // 0 stands for no limit.
            acceleration_range_m_s2: stated(if range > 0.0 { range } else { f64::INFINITY }),
            pitch_rad: stated(off(Sensor::Pitch)),
            pitch_walk: stated(of(Sensor::Pitch, Quantity::Walk)),
            leg_length_m: stated(off(Sensor::LegLength)),
            leg_angle_rad: stated(off(Sensor::LegAngle)),
            velocity_m_s: stated(slow(Sensor::Velocity, SPEED_M_S)),
            height_m: stated(slow(Sensor::Height, HEIGHT_M)),
            pressure_pa: stated(white(Sensor::Pressure)),
        }
    }
}
