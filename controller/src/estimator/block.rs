//! The blocks of the filter: a scalar, and vertical velocity with density.

use crate::math::{clamp, sqrt};

/// Density ratio before the first flight, and its variance.
pub(super) const FIRST_DENSITY: [f32; 2] = [0.5, 0.25];
/// Bounds of the density ratio: beyond any medium, so that they cut off no noise.
const DENSITY_BOUNDS: [f32; 2] = [-1.0, 3.0];

/// Innovations beyond so many standard deviations are left out.
const GATE: f32 = 6.0;
/// So many left out in a row, and the state is taken from the reading: then the state is
/// wrong, not the reading.
const GATED_IN_A_ROW: u8 = 10;

/// Counts the readings in a row that were too far off.
#[derive(Clone, Copy, Debug, Default)]
struct Gate {
    in_a_row: u8,
}

impl Gate {
    /// Returns whether an innovation of this variance is used.
    #[inline]
    fn passes(&mut self, innovation: f32, variance: f32) -> bool {
        // False for a NaN.
        let passes = innovation * innovation <= GATE * GATE * variance;
        if passes {
            self.in_a_row = 0;
        }
        passes
    }

    /// Counts a reading that did not pass; returns whether it is one too many.
    fn is_one_too_many(&mut self) -> bool {
        self.in_a_row += 1;
        if self.in_a_row == GATED_IN_A_ROW {
            self.in_a_row = 0;
        }
        self.in_a_row == 0
    }
}

/// One state and its variance.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Scalar {
    pub(super) value: f32,
    pub(super) variance: f32,
    gate: Gate,
}

impl Scalar {
    pub(super) fn new(value: f32, variance: f32) -> Self {
        Self { value, variance, gate: Gate::default() }
    }

    /// Takes a reading of the state with this variance; returns whether it was used.
    pub(super) fn update(&mut self, reading: f32, variance: f32) -> bool {
        let innovation = reading - self.value;
        let total = self.variance + variance;
        if !self.gate.passes(innovation, total) {
            if self.gate.is_one_too_many() {
                *self = Self::new(reading, variance);
            }
            return false;
        }
        let gain = self.variance / total;
        self.value += gain * innovation;
        // (1 - gain) P, as a product of positive factors.
        self.variance = gain * variance;
        true
    }
}

/// Vertical velocity and density ratio, with their covariance as `L D L'`:
///
/// ```text
/// P = | 1 0 | | p 0 | | 1 l |
///     | l 1 | | 0 d | | 0 1 |
/// ```
///
/// (the factorisation of Bierman, "Factorization Methods for Discrete Sequential
/// Estimation", 1977). So written, a covariance is symmetric, and positive as long as `p`
/// and `d` are. Both are computed by sums, products and quotients of positive terms alone:
/// no rounding makes the covariance indefinite, however long a run is. A reading of the
/// velocity changes `p` alone, for `l = cov / p` and `d` are what the velocity says of the
/// density, and what it leaves open.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertical {
    pub(super) vy_m_s: f32,
    pub(super) density_ratio: f32,
    /// `p`: variance of the velocity, m2/s2.
    pub(super) vy_variance: f32,
    /// `l`: covariance over `p`, s/m.
    slope: f32,
    /// `d`: variance of the density ratio at a known velocity.
    rest: f32,
    gate: Gate,
}

impl Vertical {
    pub(super) fn new(vy: [f32; 2], density: [f32; 2]) -> Self {
        let ([vy_m_s, vy_variance], [density_ratio, rest]) = (vy, density);
        Self { vy_m_s, density_ratio, vy_variance, slope: 0.0, rest, gate: Gate::default() }
    }

    /// Returns the variance of the density ratio.
    pub(super) fn density_variance(&self) -> f32 {
        self.slope * self.slope * self.vy_variance + self.rest
    }

    /// Propagates the covariance by `F = | a b; 0 1 |`, with process noise of these
    /// variances. With `u = a + b l`:
    ///
    /// ```text
    /// p' = u^2 p + b^2 d + qv
    /// l' = (l u p + b d) / p'
    /// d' = qd + (a^2 p d + qv (l^2 p + d)) / p'
    /// ```
    pub(super) fn propagate(&mut self, [a, b]: [f32; 2], vy_noise: f32, density_noise: f32) {
        let Self { vy_variance: p, slope: l, rest: d, .. } = *self;
        let u = a + b * l;
        let up = u * p;
        let bd = b * d;
        let new_p = u * up + b * bd + vy_noise;
        let inverse = 1.0 / new_p;
        self.vy_variance = new_p;
        self.slope = (l * up + bd) * inverse;
        self.rest = density_noise + (a * a * p * d + vy_noise * (l * l * p + d)) * inverse;
    }

    /// Propagates the covariance with the velocity as a random walk, which leaves nothing
    /// of what velocity and density have in common.
    pub(super) fn walk(&mut self, vy_noise: f32, density_noise: f32) {
        self.rest = self.density_variance() + density_noise;
        self.slope = 0.0;
        self.vy_variance += vy_noise;
    }

    /// Takes a reading of the velocity with this variance; returns the innovation in
    /// standard deviations, or none where the reading was not used.
    pub(super) fn update(&mut self, reading: f32, variance: f32) -> Option<f32> {
        let innovation = reading - self.vy_m_s;
        let total = self.vy_variance + variance;
        if !self.gate.passes(innovation, total) {
            if self.gate.is_one_too_many() {
                self.restart(reading, variance);
            }
            return None;
        }
        let inverse = 1.0 / total;
        let gain = self.vy_variance * inverse;
        let correction = gain * innovation;
        self.vy_m_s += correction;
        self.density_ratio = clamp(self.density_ratio + self.slope * correction, DENSITY_BOUNDS);
        self.vy_variance = gain * variance;
        Some(innovation * sqrt(inverse))
    }

    /// Begins anew at a reading; what is known of the density stays, if it is finite.
    #[inline(never)]
    fn restart(&mut self, reading: f32, variance: f32) {
        let density_variance = self.density_variance();
        let known = density_variance.is_finite() && self.density_ratio.is_finite();
        let density = if known { [self.density_ratio, density_variance] } else { FIRST_DENSITY };
        *self = Self::new([reading, variance], density);
    }

    /// Sets the density ratio and its variance.
    pub(super) fn set_density(&mut self, density_ratio: f32, variance: f32) {
        self.density_ratio = density_ratio;
        self.slope = 0.0;
        self.rest = variance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::random::Random;
    use nalgebra::{Matrix2, RowVector2, Vector2};

    #[test]
    fn the_factors_are_those_of_a_dense_kalman_filter() {
        let mut random = Random::new();
        let mut next = || random.uniform() as f32;
        let mut block = Vertical::new([1.0, 0.5], [0.5, 0.25]);
        let mut x = Vector2::new(1.0_f64, 0.5);
        let mut p = Matrix2::new(0.5_f64, 0.0, 0.0, 0.25);
        let h = RowVector2::new(1.0, 0.0);
        for tick in 0..2_000 {
            let (a, b) = (1.0 - 2e-3 * next(), 7e-3 * (next() - 0.2));
            let (qv, qd, r) = (1e-5 * next(), 1e-5 * next(), 0.01 + next());
            if tick % 500 == 499 {
                block.walk(qv, qd);
                (p[(0, 1)], p[(1, 0)]) = (0.0, 0.0);
                p += Matrix2::from_diagonal(&Vector2::new(qv.into(), qd.into()));
            } else {
                block.propagate([a, b], qv, qd);
                let f = Matrix2::new(a.into(), b.into(), 0.0, 1.0);
                let q = Matrix2::from_diagonal(&Vector2::new(qv.into(), qd.into()));
                p = f * p * f.transpose() + q;
            }
            let reading = block.vy_m_s + r.sqrt() * (2.0 * next() - 1.0);
            block.update(reading, r);
            let innovation = f64::from(reading) - x[0];
            let s = (h * p * h.transpose())[0] + f64::from(r);
            let k = p * h.transpose() / s;
            x += k * innovation;
            p = (Matrix2::identity() - k * h) * p;
            let near = |ours: f32, dense: f64| {
                assert!((f64::from(ours) - dense).abs() < 1e-3 * dense.abs() + 1e-4, "tick {tick}");
            };
            near(block.vy_m_s, x[0]);
            near(block.density_ratio, x[1]);
            near(block.vy_variance, p[(0, 0)]);
            near(block.slope * block.vy_variance, p[(0, 1)]);
            near(block.density_variance(), p[(1, 1)]);
        }
    }

    #[test]
    fn the_covariance_stays_positive_over_long_runs_of_any_scale() {
        let mut random = Random::new();
        let mut next = || random.uniform() as f32;
        for scale in [1e-12_f32, 1e-6, 1.0, 1e6] {
            let mut block = Vertical::new([0.0, scale], [0.5, 0.25]);
            for tick in 0..300_000 {
                if tick % 1_000 < 200 {
                    block.walk(scale, 1e-9);
                } else {
                    block.propagate([1.0 - 1e-3 * next(), 7e-3 * next()], 1e-9, 1e-9);
                }
                block.update(block.vy_m_s, scale * next() + 1e-12);
                let (p, d) = (block.vy_variance, block.rest);
                assert!(p > 0.0 && d > 0.0 && block.density_variance() < 1e9, "{block:?}");
            }
        }
    }

    #[test]
    fn a_reading_far_off_is_left_out_and_the_tenth_in_a_row_is_taken() {
        let mut scalar = Scalar::new(0.0, 0.01);
        for _ in 1..GATED_IN_A_ROW {
            assert!(!scalar.update(40.0, 0.01));
            assert_eq!(scalar.value, 0.0);
        }
        assert!(!scalar.update(40.0, 0.01));
        assert_eq!(scalar.value, 40.0);
        assert!(scalar.update(40.1, 0.01));
        let mut block = Vertical::new([0.0, 0.01], [0.3, 0.25]);
        for _ in 1..GATED_IN_A_ROW {
            assert_eq!(block.update(9.0, 0.01), None);
        }
        assert!(block.update(0.1, 0.01).is_some());
        for _ in 0..GATED_IN_A_ROW {
            assert_eq!(block.update(-9.0, 0.01), None, "counted anew");
        }
        assert_eq!((block.vy_m_s, block.density_ratio), (-9.0, 0.3));
    }

    #[test]
    fn a_block_that_is_not_finite_begins_anew_at_the_readings() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut block = Vertical::new([bad, 0.01], [bad, bad]);
            let mut scalar = Scalar::new(bad, bad);
            for _ in 0..2 * GATED_IN_A_ROW {
                block.update(1.0, 0.01);
                scalar.update(1.0, 0.01);
            }
            assert!((block.vy_m_s - 1.0).abs() < 1e-6 && block.density_variance() < 1.0);
            assert!((scalar.value - 1.0).abs() < 1e-6 && scalar.variance < 1.0);
        }
    }
}
