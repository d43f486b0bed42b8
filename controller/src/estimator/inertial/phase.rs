//! Touchdown, lift-off and apex.

use super::scales::GROUND_M;
use super::stance::Stretch;
use super::{InertialFilter, KNOWN_DENSITY_VARIANCE, SURELY_LOADED};
use crate::estimator::Events;
use crate::estimator::contact::Edge;
use crate::guard::Channels;
use crate::measurement::{Contact, LegPosture};

/// Specific force beyond that of the flight, in g, below which the leg does not bear the mass.
const FALLS_G: f32 = 0.15;
/// Time for which the mass falls freely after which the foot is off the ground whatever the
/// contact reading, s.
const FALLS_FOR_S: f32 = 0.012;
/// Height of the touchdown beside the estimate, in rest lengths, and time of the fall beside
/// it, s, within which a touchdown is likely whatever the variance.
const TOUCHDOWN_MARGIN: f32 = 0.05;
const TOUCHDOWN_MARGIN_S: f32 = 0.02;
/// Standard deviations within which something is likely, squared.
const LIKELY: f32 = 3.0 * 3.0;

impl InertialFilter {
    /// Returns whether the foot is loaded, where anything tells: by the contact reading, unless
    /// the leg is far shorter than at rest, or the mass falls freely.
    #[inline]
    pub(super) fn is_loaded(
        &mut self,
        by_contact: Option<bool>,
        shortened_m: Option<f32>,
        excess_m_s2: Option<f32>,
        dt_s: f32,
    ) -> Option<bool> {
        let surely_m = SURELY_LOADED * self.scales.rest_length_m + 3.0 * self.noise.leg_length_m;
        let falls = excess_m_s2.map(|excess| excess < FALLS_G * self.scales.gravity_m_s2);
        self.falls_for_s = if falls == Some(false) { 0.0 } else { self.falls_for_s + dt_s };
        if falls.is_some() && self.falls_for_s > FALLS_FOR_S {
            return Some(false);
        }
        match by_contact {
            Some(false) | None
                if falls == Some(false) && shortened_m.is_some_and(|m| m > surely_m) =>
            {
                Some(true)
            }
            by_contact => by_contact,
        }
    }

    /// Returns what the contact reading says.
    pub(super) fn loaded_by_contact(
        &self,
        contact: Contact,
        usable: Channels,
        rest_m: f32,
    ) -> Option<bool> {
        if !usable.has(Channels::CONTACT) {
            return None;
        }
        let tolerance_m = 3.0 * self.noise.leg_length_m;
        Some(match contact {
            Contact::Sensed(is_loaded) => is_loaded,
            Contact::LegLength(length_m) => length_m < rest_m - tolerance_m,
        })
    }

    pub(super) fn find_events(
        &mut self,
        t_ns: u64,
        is_loaded: Option<bool>,
        touchdown_y_m: f32,
        posture: Option<LegPosture>,
    ) -> Events {
        let (y_m, vy_m_s) = (self.vertical.position_m, self.vertical.velocity_m_s);
        let (vy_variance, y_variance) = (self.variances.z, self.variances.w);
        let was_in_stance = self.in_stance();
        let rest_length_m = self.scales.rest_length_m;
        let is_likely = || {
            let vy_may_be_zero = vy_m_s * vy_m_s < LIKELY * vy_variance;
            if was_in_stance {
                return vy_m_s >= 0.0 || vy_may_be_zero;
            }
            let margin_m = TOUCHDOWN_MARGIN * rest_length_m + TOUCHDOWN_MARGIN_S * vy_m_s.abs();
            let beyond_m = (y_m - touchdown_y_m).abs() - margin_m;
            (vy_m_s <= 0.0 || vy_may_be_zero)
                && (beyond_m < 0.0 || beyond_m * beyond_m < LIKELY * y_variance)
        };
        let edge = is_loaded.and_then(|is_loaded| self.contact.update(t_ns, is_loaded, is_likely));
        if let Some(edge) = edge {
            self.change_phase(edge, touchdown_y_m, posture);
        }
        self.density_is_known = self.density_is_known || self.variances.y < KNOWN_DENSITY_VARIANCE;
        let passed_apex = self.density_is_known
            && self.tracker.update([vy_m_s, vy_variance], edge.map(|edge| edge.in_stance));
        Events {
            edge,
            suspected: self.suspected_touchdown(),
            passed_apex,
            in_stance: self.in_stance(),
            density_is_known: self.density_is_known,
            touchdown_is_foreseen: self.touchdown_is_foreseen(),
            motion: self.motion(),
            ay_m_s2: self.ay_m_s2(),
        }
    }

    /// Begins a stance at the place that the encoders tell, or a flight.
    #[inline(never)]
    fn change_phase(&mut self, edge: Edge, touchdown_y_m: f32, posture: Option<LegPosture>) {
        self.first_pressure = None;
        self.last_felt = None;
        if !edge.in_stance {
            self.contradictions = if self.contradicts { self.contradictions + 1 } else { 0 };
            self.contradicts = false;
            return;
        }
        // Heights before and after are over different footholds.
        self.landed_ns = edge.until_ns;
        let stretch = posture.map(|posture| self.stretch(posture));
        let Self { horizontal, vertical, scale_error, .. } = self;
        let tilt = horizontal.parameter;
        scale_error.renew_position();
        if let Some(Stretch { x_m, y_m, x_variance, y_variance }) = stretch {
            horizontal.renew_position(x_m - tilt * y_m, -y_m, x_variance);
            vertical.renew_position(y_m + tilt * x_m, 0.0, y_variance);
        } else {
            vertical.renew_position(touchdown_y_m, 0.0, GROUND_M * GROUND_M);
        }
    }
}
