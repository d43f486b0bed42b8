//! The density ratio of the medium, estimated from the vertical acceleration.
//!
//! At an apex the vertical drag is zero, so the vertical acceleration depends on buoyancy
//! alone, and buoyancy on density (section 2.2.1 of "Learning to stop").
//! The acceleration is the slope of a least-squares line through the vertical
//! velocity of the last measurements in flight.

use crate::leg::LegModel;
use heapless::Deque;

/// Most measurements in the window: the noise of the slope falls with their number to the
/// power of 1.5.
const WINDOW: usize = 32;
/// Age of the oldest measurement in the window, ns. In a longer window, drag before the
/// apex would bias the estimate (see the tests).
const WINDOW_NS: u32 = 40_000_000;
/// Fewest measurements of an estimate.
const MIN_SAMPLES: usize = 3;

/// The vertical velocity of the last measurements in flight.
#[derive(Clone, Debug, Default)]
pub struct DensityEstimator {
    flight: Deque<(u64, f32), WINDOW>,
}

impl DensityEstimator {
    /// Returns an estimator with an empty window.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Empties the window: call it whenever the foot is on the ground.
    pub fn clear(&mut self) {
        self.flight.clear();
    }

    /// Adds a measurement in flight: its time, ns, and vertical velocity, m/s.
    pub fn push(&mut self, t_ns: u64, vy_m_s: f32) {
        if self.flight.is_full() {
            self.flight.pop_front();
        }
        // Cannot be full any more; and a full window would still be a window.
        let _ = self.flight.push_back((t_ns, vy_m_s));
    }

    /// Returns the number of measurements in the window.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.flight.len()
    }

    /// Returns the vertical acceleration over the window, m/s2; none with fewer than three
    /// measurements.
    #[must_use]
    pub fn vertical_acceleration_m_s2(&self) -> Option<f32> {
        let &(now, vy_now) = self.flight.back()?;
        // Relative to the newest: small numbers, exact in f32.
        let window = || {
            self.flight
                .iter()
                // In 32 bits: a Cortex-M converts 64 in software.
                .filter_map(|&(t, vy)| Some((u32::try_from(now.saturating_sub(t)).ok()?, vy)))
                .filter(|&(age_ns, _)| age_ns <= WINDOW_NS)
                .map(|(age_ns, vy)| (-1e-9 * age_ns as f32, vy - vy_now))
        };
        let (mut n, mut sum_t, mut sum_v) = (0_usize, 0.0_f32, 0.0_f32);
        for (t, v) in window() {
            n += 1;
            sum_t += t;
            sum_v += v;
        }
        if n < MIN_SAMPLES {
            return None;
        }
        let (mean_t, mean_v) = (sum_t / n as f32, sum_v / n as f32);
        let (mut tt, mut tv) = (0.0_f32, 0.0_f32);
        for (t, v) in window() {
            tt += (t - mean_t) * (t - mean_t);
            tv += (t - mean_t) * (v - mean_v);
        }
        (tt > 0.0).then(|| tv / tt)
    }

    /// Returns the density ratio, at an apex or near one, under gravity `gravity_m_s2`; not
    /// clamped to any range. None with fewer than three measurements.
    #[must_use]
    pub fn estimate(&self, leg: &LegModel, gravity_m_s2: f32) -> Option<f32> {
        let ay = self.vertical_acceleration_m_s2()?;
        Some(leg.density_ratio_at(ay, gravity_m_s2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::leg::WATER_DENSITY_KG_M3;

    /// Vertical velocity around an apex at time 0, drag included, by small Euler steps.
    fn vy_near_apex(rho: f32, g: f32, t: f32) -> f32 {
        let leg = LegModel::HUMAN;
        let mt = leg.mass_kg + leg.added_mass_kg;
        let fall = (leg.mass_kg - WATER_DENSITY_KG_M3 * rho * leg.volume_m3) * g / mt;
        let drag = leg.area_y_m2 * leg.drag_y * WATER_DENSITY_KG_M3 * rho / (2.0 * mt);
        let steps = 2_000;
        let h = f64::from(t) / f64::from(steps);
        let mut v = 0.0_f64;
        for _ in 0..steps {
            v += h * (-f64::from(fall) - f64::from(drag) * v * v.abs());
        }
        v as f32
    }

    #[test]
    fn estimates_the_density_within_a_hundredth_without_noise() {
        for g in [9.81, 3.71, 1.62] {
            for rho in [0.0, 0.05, 0.3, 0.5, 0.7, 0.9, 1.0] {
                for (rate_hz, apex_ns) in [(200_u64, 1_700_000_u64), (1_000, 300_000), (4_000, 0)] {
                    let tick_ns = 1_000_000_000 / rate_hz;
                    let mut estimator = DensityEstimator::new();
                    // Fifty ticks up to the first one after the apex.
                    for k in 0..=50_u64 {
                        let t = -1e-9 * ((50 - k) * tick_ns) as f32 + 1e-9 * apex_ns as f32;
                        estimator.push(k * tick_ns, vy_near_apex(rho, g, t));
                    }
                    let found = estimator.estimate(&LegModel::HUMAN, g).unwrap();
                    assert!((found - rho).abs() < 0.01, "{found} for {rho} at {rate_hz} Hz, g {g}");
                }
            }
        }
    }

    #[test]
    fn needs_three_measurements_and_starts_anew_after_contact() {
        let mut estimator = DensityEstimator::new();
        estimator.push(0, 0.01);
        estimator.push(1_000_000, 0.0);
        assert_eq!(estimator.vertical_acceleration_m_s2(), None);
        estimator.push(2_000_000, -0.01);
        let ay = estimator.vertical_acceleration_m_s2().unwrap();
        assert!((ay + 10.0).abs() < 1e-3);
        estimator.clear();
        assert_eq!(estimator.samples(), 0);
        assert_eq!(estimator.vertical_acceleration_m_s2(), None);
    }
}
