//! Flight: the motion between stances, in closed form.
//!
//! These are the paper's equations (2.1) with the spring left out; the paper calls the phase
//! swimming. With the drag per mass `c` and the net gravity `g` (weight less buoyancy, per moving
//! mass) each axis obeys `v' = -c v |v| - g`. Horizontally `g` is 0 and
//! `v = v0 / (1 + c |v0| t)`. Vertically the solution is a tangent against the net force and a
//! hyperbolic tangent along it.
//!
//! The textbook forms divide by `c` or by the reciprocal of the terminal speed and lose all
//! digits as `c` goes to 0. The forms below turn into the parabola without cancellation and
//! without a branch on `c`.

use libm::sqrt;

use crate::leg::{Leg, REFERENCE_DENSITY_KG_M3};
use crate::medium::Medium;

/// Computes `ln(1 + x) / x`, continued through 0.
fn ln_1p_over(x: f64) -> f64 {
    if x.abs() < 1e-16 { 1.0 } else { libm::log1p(x) / x }
}

/// Computes `atan(x) / x`, continued through 0.
fn atan_over(x: f64) -> f64 {
    if x.abs() < 1e-8 { 1.0 } else { libm::atan(x) / x }
}

/// The ballistic motion of a leg in a medium: gravity, buoyancy and quadratic drag.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight {
    /// Horizontal drag, per moving mass and squared speed.
    pub(crate) drag_x_per_m: f64,
    /// Vertical drag, per moving mass and squared speed.
    pub(crate) drag_y_per_m: f64,
    /// Weight less buoyancy, per moving mass; negative where the leg floats.
    pub(crate) net_gravity_m_s2: f64,
    /// Rate at which the terminal speed is approached, `sqrt(c |g|)`.
    rate_per_s: f64,
    /// Reciprocal of the terminal speed, `sqrt(c / |g|)`; 0 where `g` is 0.
    slowness_s_m: f64,
}

/// Duration of a descent through a given height, and the downward speed at its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Descent {
    pub(crate) t_s: f64,
    pub(crate) speed_m_s: f64,
}

impl Flight {
    pub(crate) fn new(leg: &Leg, medium: Medium) -> Self {
        let p = leg.parameters();
        let density_kg_m3 = REFERENCE_DENSITY_KG_M3 * medium.density_ratio();
        let moving_mass_kg = p.mass_kg + p.added_mass_kg;
        let drag = |area_m2: f64, coefficient: f64| {
            area_m2 * coefficient * density_kg_m3 / (2.0 * moving_mass_kg)
        };
        let drag_y_per_m = drag(p.area_y_m2, p.drag_y);
        let net_gravity_m_s2 =
            (p.mass_kg - density_kg_m3 * p.volume_m3) * medium.gravity_m_s2() / moving_mass_kg;
        let magnitude = net_gravity_m_s2.abs();
        Self {
            drag_x_per_m: drag(p.area_x_m2, p.drag_x),
            drag_y_per_m,
            net_gravity_m_s2,
            rate_per_s: sqrt(drag_y_per_m * magnitude),
            slowness_s_m: if magnitude > 0.0 { sqrt(drag_y_per_m / magnitude) } else { 0.0 },
        }
    }

    /// Returns the horizontal distance (m) and velocity (m/s) after `t_s`.
    pub(crate) fn horizontal(&self, vx_m_s: f64, t_s: f64) -> (f64, f64) {
        let z = self.drag_x_per_m * vx_m_s.abs() * t_s;
        (vx_m_s * t_s * ln_1p_over(z), vx_m_s / (1.0 + z))
    }

    /// Returns the time (s) and height (m) from a rising start to the apex; `None` if the leg
    /// rises for ever.
    pub(crate) fn ascend(&self, vy_m_s: f64) -> Option<(f64, f64)> {
        let g = self.net_gravity_m_s2;
        if g <= 0.0 {
            return None;
        }
        let z = vy_m_s * self.slowness_s_m;
        let t_s = vy_m_s / g * atan_over(z);
        let height_m = vy_m_s * vy_m_s / (2.0 * g) * ln_1p_over(z * z);
        Some((t_s, height_m))
    }

    /// Computes the descent through `height_m >= 0` that starts with the downward speed
    /// `speed_m_s >= 0`; `None` if the body never gets down that far.
    ///
    /// The squared speed relaxes exponentially with the height. The time follows from
    /// `atanh a - atanh b = atanh((a - b) / (1 - a b))`, in which the difference to the
    /// terminal speed cancels analytically.
    pub(crate) fn descend(&self, speed_m_s: f64, height_m: f64) -> Option<Descent> {
        let (c, g) = (self.drag_y_per_m, self.net_gravity_m_s2);
        let exponent = 2.0 * c * height_m;
        let lost = -libm::expm1(-exponent);
        // `lost` and `kept` sum to 1; each is computed to full precision.
        let kept = if exponent < 1.0 { 1.0 - lost } else { libm::exp(-exponent) };
        // (1 - exp(-2 c h)) / c, continued to 2 h at c = 0.
        let twice_height_m = if exponent < 1e-16 { 2.0 * height_m } else { lost / c };
        let squared = speed_m_s * speed_m_s * kept + g * twice_height_m;
        if squared < 0.0 || (squared == 0.0 && height_m > 0.0) {
            return None;
        }
        let end_m_s = sqrt(squared);
        if height_m == 0.0 {
            return Some(Descent { t_s: 0.0, speed_m_s });
        }
        let t_s = if g > 0.0 {
            let mean_s = twice_height_m / (speed_m_s + end_m_s);
            let beta = self.slowness_s_m;
            let scaled_s = mean_s * (1.0 + beta * end_m_s) / (1.0 + beta * speed_m_s);
            if exponent < 40.0 {
                let scaled_s = scaled_s / kept;
                scaled_s * ln_1p_over(2.0 * self.rate_per_s * scaled_s)
            } else {
                // The same expression in a form that does not need `kept`, which underflows.
                let twice_rate_per_s = 2.0 * self.rate_per_s;
                (exponent + libm::log(twice_rate_per_s * scaled_s + kept)) / twice_rate_per_s
            }
        } else {
            let scaled_s = twice_height_m / (end_m_s + kept * speed_m_s);
            scaled_s * atan_over(self.rate_per_s * scaled_s)
        };
        Some(Descent { t_s, speed_m_s: end_m_s })
    }

    /// Returns the time until the vertical velocity passes 0, s; `None` if it does not.
    pub(crate) fn time_to_turn_s(&self, vy_m_s: f64) -> Option<f64> {
        let t_s = vy_m_s / self.net_gravity_m_s2 * atan_over(vy_m_s * self.slowness_s_m);
        (t_s > 0.0 && t_s.is_finite()).then_some(t_s)
    }

    /// Returns the vertical distance (m) and velocity (m/s), both upwards, after `t_s`.
    pub(crate) fn vertical(&self, vy_m_s: f64, t_s: f64) -> (f64, f64) {
        // Seen along the net force, every motion is a rise followed by a descent.
        let up = if self.net_gravity_m_s2 < 0.0 { -1.0 } else { 1.0 };
        let (g, v) = (self.net_gravity_m_s2.abs(), up * vy_m_s);
        let (distance_m, velocity_m_s) = if v <= 0.0 {
            self.along_net_force(g, v, t_s)
        } else {
            let ascent_s =
                if g > 0.0 { v / g * atan_over(v * self.slowness_s_m) } else { f64::INFINITY };
            if t_s <= ascent_s {
                self.against_net_force(g, v, t_s)
            } else {
                let z = v * self.slowness_s_m;
                let (descent_m, velocity_m_s) = self.along_net_force(g, 0.0, t_s - ascent_s);
                (v * v / (2.0 * g) * ln_1p_over(z * z) + descent_m, velocity_m_s)
            }
        };
        (up * distance_m, up * velocity_m_s)
    }

    /// Returns distance and velocity of a motion against the net force, at most up to its
    /// turning point.
    fn against_net_force(&self, g: f64, v: f64, t_s: f64) -> (f64, f64) {
        let c = self.drag_y_per_m;
        let angle = self.rate_per_s * t_s;
        let tan_s = if angle < 1e-8 { t_s } else { libm::tan(angle) / self.rate_per_s };
        let distance_m = v * tan_s * ln_1p_over(c * v * tan_s)
            - 0.5 * g * tan_s * tan_s * ln_1p_over(c * g * tan_s * tan_s);
        (distance_m, (v - g * tan_s) / (1.0 + c * v * tan_s))
    }

    /// Returns distance and velocity of a motion along the net force, `v <= 0`.
    fn along_net_force(&self, g: f64, v: f64, t_s: f64) -> (f64, f64) {
        let c = self.drag_y_per_m;
        let angle = self.rate_per_s * t_s;
        let tanh_s = if angle < 1e-8 { t_s } else { libm::tanh(angle) / self.rate_per_s };
        // This is ln(cosh(angle)) / c; beyond 1 the first form would lose digits in 1 - tanh^2.
        let from_rest_m = if angle < 1.0 {
            0.5 * g * tanh_s * tanh_s * ln_1p_over(-c * g * tanh_s * tanh_s)
        } else {
            (angle + libm::log1p(libm::exp(-2.0 * angle)) - core::f64::consts::LN_2) / c
        };
        let distance_m = v * tanh_s * ln_1p_over(-c * v * tanh_s) - from_rest_m;
        (distance_m, (v - g * tanh_s) / (1.0 - c * v * tanh_s))
    }
}

#[cfg(test)]
mod tests {
    use std::format;

    use super::*;

    /// Creates a flight from the drag `c` and the net gravity `g`.
    fn flight(c: f64, g: f64) -> Flight {
        let slowness = if g == 0.0 { 0.0 } else { sqrt(c / g.abs()) };
        Flight {
            drag_x_per_m: c,
            drag_y_per_m: c,
            net_gravity_m_s2: g,
            rate_per_s: sqrt(c * g.abs()),
            slowness_s_m: slowness,
        }
    }

    /// Integrates the same motion by many small Runge-Kutta steps.
    fn integrate(c: f64, g: f64, v: f64, t_s: f64) -> (f64, f64) {
        const STEPS: u32 = 20_000;
        let h = t_s / f64::from(STEPS);
        let a = |v: f64| -c * v * v.abs() - g;
        let (mut y, mut v) = (0.0, v);
        for _ in 0..STEPS {
            let k1 = a(v);
            let k2 = a(v + 0.5 * h * k1);
            let k3 = a(v + 0.5 * h * k2);
            let k4 = a(v + h * k3);
            y += h * v + h * h / 6.0 * (k1 + k2 + k3);
            v += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        (y, v)
    }

    #[test]
    fn closed_form_solves_the_equation() {
        for c in [0.0, 1e-300, 1e-9, 0.01, 0.6, 5.0] {
            for g in [-3.0, -1e-6, 0.0, 1e-6, 1.6, 9.0] {
                for v in [-8.0, -1.0, 0.0, 0.5, 7.0] {
                    for t_s in [1e-3, 0.2, 3.0] {
                        let (y, vy) = flight(c, g).vertical(v, t_s);
                        let (y_by_steps, vy_by_steps) = integrate(c, g, v, t_s);
                        let near = |a: f64, b: f64| (a - b).abs() < 1e-7 * b.abs().max(1.0);
                        assert!(
                            near(y, y_by_steps),
                            "c {c} g {g} v {v} t {t_s}: y {y} {y_by_steps}"
                        );
                        assert!(near(vy, vy_by_steps), "c {c} g {g} v {v} t {t_s}: vy {vy}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_descent_ends_where_the_motion_is_at_that_time() {
        for c in [0.0, 1e-300, 1e-17, 1e-9, 0.01, 0.6, 5.0] {
            for g in [-3.0, -1e-6, 0.0, 1e-6, 1.6, 9.0] {
                for speed in [0.0, 0.3, 1.5, 20.0] {
                    for height in [1e-9, 0.1, 4.0, 60.0] {
                        let flight = flight(c, g);
                        let Some(descent) = flight.descend(speed, height) else {
                            assert!(g <= 0.0, "c {c} g {g} speed {speed} height {height}");
                            continue;
                        };
                        let (distance, vy) = flight.vertical(-speed, descent.t_s);
                        let case = format!("c {c} g {g} speed {speed} height {height} {descent:?}");
                        assert!(
                            (distance + height).abs() < 1e-10 * height.max(1e-3),
                            "{case}: {distance}"
                        );
                        assert!((vy + descent.speed_m_s).abs() < 1e-8, "{case}: {vy}");
                    }
                }
            }
        }
    }

    #[test]
    fn an_ascent_ends_at_rest() {
        for c in [0.0, 1e-300, 1e-9, 0.6, 5.0] {
            let flight = flight(c, 9.0);
            let (t_s, height) = flight.ascend(6.0).unwrap();
            let (distance, vy) = flight.vertical(6.0, t_s);
            assert!((distance - height).abs() < 1e-13 && vy.abs() < 1e-13);
            assert_eq!(flight.time_to_turn_s(6.0), Some(t_s));
        }
        assert!(flight(0.6, 0.0).ascend(1.0).is_none());
    }
}
