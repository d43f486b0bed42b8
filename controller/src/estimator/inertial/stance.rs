//! What corrects the state in stance: the encoders of the leg.

use nalgebra::Vector4;

use super::axis::{POSITION, Use};
use super::scales::Scales;
use super::{FIRST_VELOCITY, InertialFilter, SURELY_LOADED};
use crate::estimator::factor::Reading;
use crate::geometry::foot_to_mass;
use crate::measurement::LegPosture;

/// Least variance of a place by the encoders, m2: no reading makes the state certain.
const LEAST_VARIANCE: f32 = 1e-8;
/// Specific force beyond that of the flight, in g, from which on the leg bears the mass for
/// certain.
const BEARS_G: f32 = 0.4;

/// Deviation of a vertical acceleration that the model may be wrong by where the state contradicts
/// the encoders, as by another gravity, m/s2: the bias takes it.
const WRONG_MODEL_M_S2: f32 = 1.0;

/// The leg by its encoders, in the axes of the orientation that is read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    /// From foot to mass, m, and the variance of each coordinate, m2.
    pub(super) x_m: f32,
    pub(super) y_m: f32,
    pub(super) x_variance: f32,
    pub(super) y_variance: f32,
}

impl InertialFilter {
    /// Returns the leg by its encoders.
    #[inline]
    pub(super) fn stretch(&self, posture: LegPosture) -> Stretch {
        let LegPosture { length_m, angle_rad } = posture;
        let body = foot_to_mass(length_m, angle_rad);
        let [cosine, sine] = self.force.axis();
        let (x_m, y_m) = (cosine * body.x - sine * body.y, sine * body.x + cosine * body.y);
        let Scales { length_variance, angle_variance, .. } = self.scales;
        let per_length = 1.0 / (length_m * length_m + 1e-6);
        let (x_part, y_part) = (x_m * x_m * per_length, y_m * y_m * per_length);
        Stretch {
            x_m,
            y_m,
            x_variance: x_part * length_variance + y_m * y_m * angle_variance + LEAST_VARIANCE,
            y_variance: y_part * length_variance + x_m * x_m * angle_variance + LEAST_VARIANCE,
        }
    }

    /// Corrects by the leg's encoders while the foot stands: along one axis, and along the other
    /// at the next reading.
    #[inline]
    pub(super) fn correct_in_stance(
        &mut self,
        posture: LegPosture,
        excess_m_s2: Option<f32>,
        rest_m: f32,
    ) {
        // Around lift-off the foot may be in the air already: the force tells, or else the
        // length.
        let Scales { gravity_m_s2, rest_length_m, .. } = self.scales;
        let bears = match excess_m_s2 {
            Some(excess_m_s2) => excess_m_s2 > BEARS_G * gravity_m_s2,
            None => rest_m - posture.length_m > SURELY_LOADED * rest_length_m,
        };
        if !bears || self.contact.suspected().is_some() {
            return;
        }
        let stretch = self.stretch(posture);
        let Stretch { x_m, y_m, x_variance, y_variance } = stretch;
        let tilt = self.horizontal.parameter;
        self.is_turn_of_y = !self.is_turn_of_y;
        let use_of_it = if self.is_turn_of_y {
            self.correct_vertical(&Reading {
                by_state: POSITION,
                innovation: y_m + tilt * x_m - self.vertical.position_m,
                variance: y_variance,
            })
        } else {
            self.horizontal.correct(&Reading {
                by_state: Vector4::new(0.0, y_m, 0.0, 1.0),
                innovation: x_m - tilt * y_m - self.horizontal.position_m,
                variance: x_variance,
            })
        };
        if use_of_it == Use::Contradicts {
            self.reopen(&stretch);
        }
    }

    /// Opens the states of the axis along which they contradict the encoders. Along x a foot that
    /// slips does that; along y the states are wrong, or the model is.
    #[inline(never)]
    fn reopen(&mut self, stretch: &Stretch) {
        let Self { horizontal, vertical, scale_error, .. } = self;
        let &Stretch { x_m, y_m, x_variance, y_variance } = stretch;
        let tilt = horizontal.parameter;
        let variance = FIRST_VELOCITY[1] * FIRST_VELOCITY[1];
        if self.is_turn_of_y {
            vertical.renew_position(y_m + tilt * x_m, 0.0, y_variance);
            vertical.factor.add_velocity_noise(variance);
            vertical.factor.add_bias_noise(WRONG_MODEL_M_S2 * WRONG_MODEL_M_S2);
            scale_error.renew_position();
            self.contradicts = true;
        } else {
            horizontal.renew_position(x_m - tilt * y_m, -y_m, x_variance);
            horizontal.factor.add_velocity_noise(variance);
        }
    }
}
