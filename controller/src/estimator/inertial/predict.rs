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
/// Ticks of a lap, in which noise is added to biases, tilt and density once.
const LAP: u8 = 16;

impl InertialFilter {
    /// Moves the state by what pushed the mass.
    #[inline]
    pub(super) fn predict(&mut self, push: Option<Push>, dt_s: f32) {
        let position_noise = POSITION_NOISE * dt_s;
        let Some(push) = push else { return self.predict_unfelt(dt_s) };
        let in_flight_m_s2 = self.scales.gravity_m_s2 + self.ay_m_s2();
        let Self { scales, horizontal, vertical, .. } = self;
        let [x, y] = push.impulse_m_s;
        let tilt = horizontal.parameter;
        let per_s = if dt_s > 0.0 { 1.0 / dt_s } else { 0.0 };
        // The spring's force is scaled wrongly for all of a stance; that of the flight as a bias.
        let by_spring = y - in_flight_m_s2 * dt_s;
        let scaled = scales.scale_noise * (x * x + by_spring * by_spring) * per_s;
        let noise = scales.impulse_noise * dt_s + scaled;
        let clips = x.abs().max(y.abs()) > scales.clips_from_m_s2 * dt_s;
        let noise = if clips { noise + CLIPPED_VARIANCE * dt_s * dt_s } else { noise };
        let noise = [noise, position_noise];
        horizontal.advance(x - tilt * y, dt_s, -y, noise);
        vertical.advance(y + tilt * x - scales.gravity_m_s2 * dt_s, dt_s, 0.0, noise);
    }

    /// Adds noise to biases, tilt and density: each once a lap, in a tick of its own, so that no
    /// tick is costly.
    #[inline]
    pub(super) fn add_slow_noise(&mut self, dt_s: f32) {
        let Self { scales, horizontal, vertical, lap_s: [this_s, last_s], .. } = self;
        *this_s += dt_s;
        self.lap_tick = (self.lap_tick + 1) % LAP;
        match self.lap_tick {
            3 => horizontal.factor.add_bias_noise(scales.bias_noise * *last_s),
            7 => horizontal.factor.add_parameter_noise(scales.tilt_noise * *last_s),
            11 => vertical.factor.add_bias_noise(scales.bias_noise * *last_s),
            15 => vertical.factor.add_parameter_noise(DENSITY_NOISE * *last_s),
            0 => (*last_s, *this_s) = (*this_s, 0.0),
            _ => (),
        }
    }

    /// Moves the state without an accelerometer: by the model in flight, as a random walk in
    /// stance.
    #[inline(never)]
    fn predict_unfelt(&mut self, dt_s: f32) {
        let in_stance = self.in_stance();
        let Self { model, horizontal, vertical, .. } = self;
        let change = if in_stance {
            [0.0; 2]
        } else {
            let (vx_m_s, vy_m_s) = (horizontal.velocity_m_s, vertical.velocity_m_s);
            let (y_m, density_ratio) = (vertical.position_m, vertical.parameter);
            let mut flight = Flight { vx_m_s, y_m, vy_m_s, density_ratio };
            model.advance(&mut flight, dt_s);
            [flight.vx_m_s - vx_m_s, flight.vy_m_s - vy_m_s]
        };
        let noise = if in_stance { UNFELT_NOISE * dt_s } else { VELOCITY_NOISE * dt_s };
        let noise = [noise, POSITION_NOISE * dt_s];
        // The biases are no part of the motion: what they would take is given back.
        let [x, y] = change;
        horizontal.advance(x + horizontal.bias_m_s2 * dt_s, dt_s, 0.0, noise);
        vertical.advance(y + vertical.bias_m_s2 * dt_s, dt_s, 0.0, noise);
    }
}
