//! What corrects the state in flight: the accelerometer, which feels the medium.

use nalgebra::Vector4;

use super::axis::Use;
use super::force::Felt;
use super::{FIRST_DENSITY, FIRST_VELOCITY, InertialFilter};
use crate::estimator::factor::Reading;

/// Variance of the model of the flight, (m/s2)2.
const MODEL_VARIANCE: f32 = 0.005 * 0.005;
/// Distance from the touchdown height in which no reading of the flight counts, in rest
/// lengths.
const CLEARANCE: f32 = 0.03;

impl InertialFilter {
    /// Returns the size of the vertical specific force beyond that of the flight, m/s2.
    #[inline]
    pub(super) fn excess_m_s2(&self, felt: Felt) -> f32 {
        let [_, fy] = felt.force_m_s2;
        let in_flight = self.scales.gravity_m_s2 + self.ay_m_s2() + self.vertical.bias_m_s2;
        (fy - in_flight).abs()
    }

    /// Corrects by what the accelerometer feels in free flight: along one axis, by the mean of the
    /// last two readings, and along the other at the next reading.
    #[inline]
    pub(super) fn correct_in_flight(&mut self, felt: Option<Felt>, touchdown_y_m: f32) {
        let clearance_m = self.vertical.position_m - touchdown_y_m;
        let is_clear =
            self.vertical.velocity_m_s > 0.0 || clearance_m > CLEARANCE * self.scales.rest_length_m;
        if !is_clear || self.contact.suspected().is_some() {
            self.last_felt = None;
            return;
        }
        let Some(felt) = felt else { return };
        let mean = self.last_felt.replace(felt).map_or(felt, |last| felt.mean_with(&last));
        self.is_turn_of_y = !self.is_turn_of_y;
        if self.is_turn_of_y {
            self.correct_vertically(&mean);
        } else {
            self.correct_horizontally(&mean);
        }
    }

    fn correct_vertically(&mut self, felt: &Felt) {
        let Self { model, scales, horizontal, vertical, variances, scale_error, .. } = self;
        let &Felt { force_m_s2: [fx, fy], over_s, per_s } = felt;
        // The reading is the mean over some time: what it says is of the middle of it.
        let gained_m_s = 0.5 * over_s * (fy - scales.gravity_m_s2 - vertical.bias_m_s2);
        let (vy_m_s, rho) = (vertical.velocity_m_s - gained_m_s, vertical.parameter);
        let in_flight = scales.gravity_m_s2 + model.ay_m_s2(vy_m_s, rho);
        // What the line misses of the drag's square stays the same from tick to tick: it counts
        // like white noise of the same size over a second.
        let bent = rho * model.drag_y_1_m() * variances.z;
        let reading = Reading {
            by_state: Vector4::new(
                1.0,
                model.ay_by_density(vy_m_s),
                model.ay_by_vy(vy_m_s, rho),
                0.0,
            ),
            innovation: fy + horizontal.parameter * fx - in_flight - vertical.bias_m_s2,
            variance: (scales.force_noise + bent * bent) * per_s + MODEL_VARIANCE,
        };
        // A mass that is not the model's would pass for a bias, and pull the velocity along:
        // stances alone tell the bias.
        match vertical.correct_all_but_bias(&reading) {
            Use::Taken(correction) => {
                scale_error.follow_in_flight(&reading, &correction.gain, fy);
                self.innovation = correction.innovation;
            }
            Use::LeftOut => (),
            // Another medium.
            Use::Contradicts => vertical.factor.add_parameter_noise(FIRST_DENSITY[1]),
        }
    }

    fn correct_horizontally(&mut self, felt: &Felt) {
        let Self { model, scales, horizontal, vertical, .. } = self;
        let &Felt { force_m_s2: [fx, fy], over_s, per_s } = felt;
        let gained_m_s = 0.5 * over_s * (fx - horizontal.bias_m_s2);
        let (vx_m_s, rho) = (horizontal.velocity_m_s - gained_m_s, vertical.parameter);
        let by_density = model.ax_by_density(vx_m_s);
        let bent = rho * model.drag_x_1_m() * self.vx_variance;
        let lasting = by_density * by_density * self.variances.y + bent * bent;
        let reading = Reading {
            by_state: Vector4::new(1.0, fy, model.ax_by_vx(vx_m_s, rho), 0.0),
            innovation: fx - horizontal.parameter * fy - rho * by_density - horizontal.bias_m_s2,
            variance: (scales.force_noise + lasting) * per_s + MODEL_VARIANCE,
        };
        if horizontal.correct(&reading) == Use::Contradicts {
            horizontal.factor.add_velocity_noise(FIRST_VELOCITY[1]);
        }
    }
}
