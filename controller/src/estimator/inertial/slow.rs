//! Readings that come seldom and late: velocity, height, pressure, density.

use nalgebra::Vector4;

use super::axis::{POSITION, Use, VELOCITY};
use super::{FIRST_DENSITY, FIRST_VELOCITY, InertialFilter};
use crate::estimator::factor::Reading;
use crate::guard::Channels;
use crate::measurement::{Aged, Measurement};

/// Variance of a density ratio that is measured.
const MEASURED_DENSITY_VARIANCE: f32 = 1e-4;
/// Deviation of the pressure that a change of the medium adds, m of water a second.
const SHORE_M_S: f32 = 0.2;

impl InertialFilter {
    pub(super) fn in_or_near_stance(&self) -> bool {
        self.contact.in_stance() || self.contact.suspected().is_some()
    }

    /// Corrects by velocity, height, pressure and density, where a reading has come.
    #[inline]
    pub(super) fn correct_by_slow_sensors(&mut self, measurement: &Measurement, usable: Channels) {
        let sensors = &measurement.sensors;
        let is_there = sensors.velocity_m_s.is_some()
            || sensors.height_m.is_some()
            || sensors.pressure_pa.is_some()
            || measurement.density_ratio.is_some();
        if is_there {
            self.has_slow_sensors = true;
            self.correct_by_readings_that_came(measurement, usable);
        }
    }

    #[inline(never)]
    fn correct_by_readings_that_came(&mut self, measurement: &Measurement, usable: Channels) {
        let sensors = &measurement.sensors;
        if let Some(velocity) = sensors.velocity_m_s.filter(|_| usable.has(Channels::VELOCITY)) {
            self.correct_velocity(measurement.t_ns, velocity);
        }
        if let Some(height) = sensors.height_m.filter(|_| usable.has(Channels::HEIGHT)) {
            self.correct_height(measurement.t_ns, height);
        }
        if let Some(pressure) = sensors.pressure_pa.filter(|_| usable.has(Channels::PRESSURE)) {
            self.correct_by_pressure(measurement.t_ns, pressure);
        }
        let density_ratio = measurement.density_ratio.filter(|_| usable.has(Channels::DENSITY));
        if let Some(density_ratio) = density_ratio {
            self.correct_density(density_ratio);
        }
    }

    #[inline(never)]
    fn correct_velocity(&mut self, t_ns: u64, reading: Aged<[f32; 2]>) {
        let Some(then) = self.history.before(self.motion_now(t_ns), reading.age_ns) else { return };
        let before = [self.horizontal.velocity_m_s, self.vertical.velocity_m_s];
        let ([x, y], variance) = (reading.value, self.scales.velocity_variance);
        let of = |innovation| Reading { by_state: VELOCITY, innovation, variance };
        if self.horizontal.correct(&of(x - then.vx_m_s)) == Use::Contradicts {
            self.horizontal.factor.add_velocity_noise(FIRST_VELOCITY[1]);
        }
        if self.correct_vertical(&of(y - then.vy_m_s)) == Use::Contradicts {
            self.vertical.factor.add_velocity_noise(FIRST_VELOCITY[1]);
        }
        let [vx, vy] = before;
        self.history.shift([self.horizontal.velocity_m_s - vx, self.vertical.velocity_m_s - vy]);
    }

    #[inline(never)]
    fn correct_height(&mut self, t_ns: u64, reading: Aged<f32>) {
        let Some(then) = self.history.before(self.motion_now(t_ns), reading.age_ns) else { return };
        if then.t_ns < self.landed_ns {
            return;
        }
        let innovation = reading.value - then.y_m;
        let variance = self.scales.height_variance;
        let reading = Reading { by_state: POSITION, innovation, variance };
        if self.correct_vertical(&reading) == Use::Contradicts {
            self.vertical.renew_position(reading.innovation + then.y_m, 0.0, variance);
            self.scale_error.renew_position();
        }
    }

    /// Corrects by the change of the pressure since the flight began.
    #[inline(never)]
    fn correct_by_pressure(&mut self, t_ns: u64, reading: Aged<f32>) {
        if self.in_or_near_stance() {
            return;
        }
        let Some(then) = self.history.before(self.motion_now(t_ns), reading.age_ns) else { return };
        let Some((first_pa, first_y_m, first_ns)) = self.first_pressure else {
            self.first_pressure = Some((reading.value, then.y_m, then.t_ns));
            return;
        };
        let Self { scales, vertical, .. } = &*self;
        let rho = vertical.parameter;
        let risen_m = then.y_m - first_y_m;
        let since_s = 1e-9 * then.t_ns.saturating_sub(first_ns) as u32 as f32;
        let shore_m = SHORE_M_S * since_s;
        let reading = Reading {
            // An error of the height itself is in both heights.
            by_state: Vector4::new(0.0, risen_m, rho * since_s, 0.0),
            innovation: (first_pa - reading.value) * scales.column_m_pa - rho * risen_m,
            variance: scales.pressure_variance + shore_m * shore_m,
        };
        // One that is far off tells of the medium, which the accelerometer feels better.
        let _ = self.correct_vertical(&reading);
    }

    #[inline(never)]
    fn correct_density(&mut self, density_ratio: f32) {
        let reading = Reading {
            by_state: Vector4::new(0.0, 1.0, 0.0, 0.0),
            innovation: density_ratio - self.vertical.parameter,
            variance: MEASURED_DENSITY_VARIANCE,
        };
        if self.correct_vertical(&reading) == Use::Contradicts {
            self.vertical.factor.add_parameter_noise(FIRST_DENSITY[1]);
        }
    }
}
