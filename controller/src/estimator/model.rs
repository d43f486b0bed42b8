//! The free flight of the leg: weight, buoyancy, drag and added mass.
//!
//! The equations of "Learning to stop" (doi 10.5281/zenodo.4607469), those of `leg-plant`:
//!
//! ```text
//! ax = -cx rho vx |vx|             cx = Ax cdx 1000 / (2 mt)
//! ay = -w + b rho - cy rho vy |vy| cy = Ay cdy 1000 / (2 mt)
//! w = m g / mt    b = 1000 V g / mt    mt = m + M
//! ```

use crate::leg::{LegModel, WATER_DENSITY_KG_M3};

/// Longest integration step, s. The midpoint rule is then exact to f32 at the speeds of a
/// leg.
const LONGEST_STEP_S: f32 = 2.5e-3;
/// Most steps over a gap, which bounds the work of a tick.
const MOST_STEPS: u32 = 64;
/// Steps from a state in flight to its apex.
const STEPS_TO_APEX: u8 = 16;
/// Time to the farthest apex that is looked for, s, ahead or behind: a fall through water
/// soon has no trace left of where it began.
const FARTHEST_APEX_S: f32 = 1.0;

/// A state in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Flight {
    pub(super) vx_m_s: f32,
    pub(super) y_m: f32,
    pub(super) vy_m_s: f32,
    pub(super) density_ratio: f32,
}

/// The coefficients of the equations.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlightModel {
    /// `cx`, 1/m.
    drag_x_1_m: f32,
    /// `cy`, 1/m.
    drag_y_1_m: f32,
    /// `w`, m/s2.
    weight_m_s2: f32,
    /// `b`, m/s2 for a density ratio of 1.
    buoyancy_m_s2: f32,
}

impl FlightModel {
    pub(super) fn new(leg: &LegModel, gravity_m_s2: f32) -> Self {
        let per_mass = 1.0 / (leg.mass_kg + leg.added_mass_kg);
        Self {
            drag_x_1_m: 0.5 * WATER_DENSITY_KG_M3 * leg.area_x_m2 * leg.drag_x * per_mass,
            drag_y_1_m: 0.5 * WATER_DENSITY_KG_M3 * leg.area_y_m2 * leg.drag_y * per_mass,
            weight_m_s2: leg.mass_kg * gravity_m_s2 * per_mass,
            buoyancy_m_s2: WATER_DENSITY_KG_M3 * leg.volume_m3 * gravity_m_s2 * per_mass,
        }
    }

    /// Returns the vertical acceleration, m/s2.
    pub(super) fn ay_m_s2(&self, vy_m_s: f32, density_ratio: f32) -> f32 {
        density_ratio * self.ay_by_density(vy_m_s) - self.weight_m_s2
    }

    /// Returns the derivative of `ay` by the density ratio, m/s2.
    pub(super) fn ay_by_density(&self, vy_m_s: f32) -> f32 {
        self.buoyancy_m_s2 - self.drag_y_1_m * vy_m_s * vy_m_s.abs()
    }

    /// Returns the derivative of `ay` by `vy`, 1/s.
    pub(super) fn ay_by_vy(&self, vy_m_s: f32, density_ratio: f32) -> f32 {
        -2.0 * self.drag_y_1_m * density_ratio * vy_m_s.abs()
    }

    /// Returns `cx`, 1/m.
    pub(super) fn drag_x_1_m(&self) -> f32 {
        self.drag_x_1_m
    }

    /// Returns `cy`, 1/m.
    pub(super) fn drag_y_1_m(&self) -> f32 {
        self.drag_y_1_m
    }

    /// Returns the derivative of `ax` by the density ratio, m/s2.
    pub(super) fn ax_by_density(&self, vx_m_s: f32) -> f32 {
        -self.drag_x_1_m * vx_m_s * vx_m_s.abs()
    }

    /// Returns the derivative of `ax` by `vx`, 1/s.
    pub(super) fn ax_by_vx(&self, vx_m_s: f32, density_ratio: f32) -> f32 {
        -2.0 * self.drag_x_1_m * density_ratio * vx_m_s.abs()
    }

    fn ax_m_s2(&self, vx_m_s: f32, density_ratio: f32) -> f32 {
        -self.drag_x_1_m * density_ratio * vx_m_s * vx_m_s.abs()
    }

    /// Advances a flight by one midpoint step of `dt_s`; back where that is below 0.
    fn step(&self, flight: &mut Flight, dt_s: f32) {
        let half_s = 0.5 * dt_s;
        let rho = flight.density_ratio;
        let vx_m_s = flight.vx_m_s + half_s * self.ax_m_s2(flight.vx_m_s, rho);
        let vy_m_s = flight.vy_m_s + half_s * self.ay_m_s2(flight.vy_m_s, rho);
        flight.vx_m_s += dt_s * self.ax_m_s2(vx_m_s, rho);
        flight.vy_m_s += dt_s * self.ay_m_s2(vy_m_s, rho);
        flight.y_m += dt_s * vy_m_s;
    }

    /// Advances a flight by `dt_s`, 0 or more, in steps that are short enough.
    pub(super) fn advance(&self, flight: &mut Flight, dt_s: f32) {
        if dt_s <= LONGEST_STEP_S {
            return self.step(flight, dt_s);
        }
        let steps = ((dt_s / LONGEST_STEP_S) as u32 + 1).min(MOST_STEPS);
        let step_s = dt_s / steps as f32;
        for _ in 0..steps {
            self.step(flight, step_s);
        }
    }

    /// Returns the state at the apex of a flight, ahead or behind; none where that is more
    /// than a second away, or where the medium carries the leg. Not inlined: no ordinary
    /// tick calls it.
    #[inline(never)]
    pub(super) fn at_apex(&self, mut flight: Flight) -> Option<Flight> {
        for steps_left in (1..=STEPS_TO_APEX).rev() {
            if flight.vy_m_s == 0.0 {
                break;
            }
            let ay_m_s2 = self.ay_m_s2(flight.vy_m_s, flight.density_ratio);
            let time_s = -flight.vy_m_s / ay_m_s2;
            // A NaN is neither.
            if !(ay_m_s2 < 0.0 && time_s.abs() <= FARTHEST_APEX_S) {
                return None;
            }
            self.step(&mut flight, time_s / f32::from(steps_left));
        }
        let Flight { vx_m_s, y_m, .. } = flight;
        (vx_m_s.is_finite() && y_m.is_finite()).then_some(flight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn human() -> FlightModel {
        FlightModel::new(&LegModel::HUMAN, 9.81)
    }

    fn at(vx_m_s: f32, vy_m_s: f32, density_ratio: f32) -> Flight {
        Flight { vx_m_s, y_m: 2.0, vy_m_s, density_ratio }
    }

    #[test]
    fn a_flight_without_drag_is_a_parabola() {
        let mut flight = at(1.0, 3.0, 0.0);
        human().advance(&mut flight, 0.5);
        let ay = -80.0 / 88.0 * 9.81;
        assert!((flight.vy_m_s - (3.0 + 0.5 * ay)).abs() < 1e-5);
        assert!((flight.y_m - (2.0 + 1.5 + 0.125 * ay)).abs() < 1e-5);
        assert_eq!(flight.vx_m_s, 1.0);
    }

    #[test]
    fn drag_and_buoyancy_of_water_follow_their_closed_form() {
        // v0 / (1 + c v0 t) along x; at rest, the weight less buoyancy along y.
        let mut flight = at(2.0, 0.0, 1.0);
        let model = human();
        assert!((model.ay_m_s2(0.0, 1.0) + (80.0 - 62.4) * 9.81 / 88.0).abs() < 1e-5);
        model.advance(&mut flight, 0.4);
        let c = 0.1925 * 1.05 * 1000.0 / (2.0 * 88.0);
        assert!((flight.vx_m_s - 2.0 / (1.0 + c * 2.0 * 0.4)).abs() < 1e-4, "{flight:?}");
    }

    #[test]
    fn the_apex_is_the_same_from_before_and_from_behind() {
        let model = human();
        for density_ratio in [0.0, 0.3, 1.0] {
            let apex = at(1.0, 0.0, density_ratio);
            for time_s in [-0.4, -0.1, 0.1, 0.4_f32] {
                let mut flight = apex;
                for _ in 0..1_000 {
                    model.step(&mut flight, 1e-3 * time_s);
                }
                let found = model.at_apex(flight).unwrap();
                let off = (found.vx_m_s - apex.vx_m_s).abs().max((found.y_m - apex.y_m).abs());
                assert!(off < 2e-3, "{found:?} at {time_s} s, density {density_ratio}");
            }
        }
    }

    #[test]
    fn no_apex_is_found_where_the_medium_carries_the_leg_or_the_fall_is_long() {
        let model = human();
        assert_eq!(model.at_apex(at(0.0, 1.0, 2.0)), None, "it floats");
        assert_eq!(model.at_apex(at(0.0, -20.0, 0.0)), None, "2 s of fall");
        assert_eq!(model.at_apex(at(0.0, f32::NAN, 0.5)), None);
    }
}
