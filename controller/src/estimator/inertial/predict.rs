//! The state from one measurement to the next.

use super::InertialFilter;
use super::force::Push;
use super::scales::VELOCITY_NOISE;
use crate::estimator::model::Flight;

/// Process noise of the density ratio, 1/s.
const DENSITY_NOISE: f32 = 0.02 * 0.02;
/// Process noise of the position, m2/s.
const POSITION_NOISE: f32 = 1e-3 * 1e-3;
/// Process noise of the velocities in stance without an accelerometer, m2/s3.
const UNFELT_NOISE: f32 = 10.0 * 10.0;
/// Variance of the part of a specific force that clips, (m/s2)2.
const CLIPPED_VARIANCE: f32 = 20.0 * 20.0;
/// What a force that changes by its size in a third of a stance, 30 ms, adds to the trapezoid
/// rule: one over twelve times this time, 1/s.
const BEND_1_S: f32 = 1.0 / (12.0 * 0.03);
/// Ticks of a lap, in which noise is added to biases, tilt and density once.
const LAP: u8 = 16;

impl InertialFilter {
    /// Moves the state by what pushed the mass.
    #[inline]
    pub(super) fn predict(&mut self, push: Option<Push>, dt_s: f32) {
        let position_noise = POSITION_NOISE * dt_s;
        let Some(push) = push else { return self.predict_unfelt(dt_s) };
        let Self { scales, horizontal, vertical, scale_error, .. } = self;
        let [x, y] = push.impulse_m_s;
        let tilt = horizontal.parameter;
        let mut noise = scales.impulse_noise * dt_s;
        let clips = x.abs().max(y.abs()) > scales.clips_from_m_s2 * dt_s;
        if clips {
            noise += CLIPPED_VARIANCE * dt_s * dt_s;
        }
        horizontal.advance(x - tilt * y, dt_s, -y, [noise, position_noise]);
        // Where messages are lost, the mean force of the gap alone is known, not its course.
        let bent_m = BEND_1_S * dt_s * dt_s * y;
        let position_noise = position_noise + bent_m * bent_m;
        let fall_m_s = scales.gravity_m_s2 * dt_s;
        vertical.advance(y + tilt * x - fall_m_s, dt_s, 0.0, [noise, position_noise]);
        scale_error.propagate(y, dt_s);
    }

    /// Adds noise to biases, tilt and density: each once a lap, in a tick of its own, so that no
    /// tick is costly.
    #[inline]
    pub(super) fn add_slow_noise(&mut self, dt_s: f32) {
        let Self { scales, horizontal, vertical, scale_error, lap_s: [this_s, last_s], .. } = self;
        *this_s += dt_s;
        self.lap_tick = (self.lap_tick + 1) % LAP;
        match self.lap_tick {
            1 => scale_error.add_noise(*last_s),
            3 => horizontal.factor.add_bias_noise(scales.bias_noise * *last_s),
            7 => horizontal.factor.add_parameter_noise(scales.tilt_noise * *last_s),
            11 => vertical.factor.add_bias_noise(scales.bias_noise * *last_s),
            15 => vertical.factor.add_parameter_noise(DENSITY_NOISE * *last_s),
            0 => (*last_s, *this_s) = (*this_s, 0.0),
            _ => (),
        }
    }

    /// Moves the state without an accelerometer: by the model in flight, as a random walk while the
    /// spring is pressed.
    #[inline(never)]
    fn predict_unfelt(&mut self, dt_s: f32) {
        let is_pushed = self.in_stance() && self.is_pressed;
        let Self { model, horizontal, vertical, scale_error, .. } = self;
        let change = if is_pushed {
            [0.0; 2]
        } else {
            let (vx_m_s, vy_m_s) = (horizontal.velocity_m_s, vertical.velocity_m_s);
            let (y_m, density_ratio) = (vertical.position_m, vertical.parameter);
            let mut flight = Flight { vx_m_s, y_m, vy_m_s, density_ratio };
            model.advance(&mut flight, dt_s);
            [flight.vx_m_s - vx_m_s, flight.vy_m_s - vy_m_s]
        };
        let noise = if is_pushed { UNFELT_NOISE * dt_s } else { VELOCITY_NOISE * dt_s };
        let noise = [noise, POSITION_NOISE * dt_s];
        // The biases are no part of the motion: what they would take is given back.
        let [x, y] = change;
        horizontal.advance(x + horizontal.bias_m_s2 * dt_s, dt_s, 0.0, noise);
        vertical.advance(y + vertical.bias_m_s2 * dt_s, dt_s, 0.0, noise);
        scale_error.propagate(0.0, dt_s);
    }
}
