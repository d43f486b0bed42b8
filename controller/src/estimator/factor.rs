//! A covariance of four states, as `L D L'`.

use crate::math::sqrt;
use nalgebra::Vector4;

/// Innovations beyond so many standard deviations are left out.
const GATE: f32 = 5.0;

/// The covariance of the four states of an axis, in the order bias, parameter, velocity,
/// position: `L D L'` with a unit lower triangle `L` and a diagonal `D` (the factorisation of
/// Bierman, "Factorization Methods for Discrete Sequential Estimation", 1977).
///
/// So written, a covariance is symmetric, and positive as long as `D` is. A reading changes
/// `D` by products and quotients of positive terms alone, noise adds to it, and the motion
/// leaves it as it is: each state drives only those behind it, so that the motion's matrix
/// times `L` is again a unit lower triangle. No rounding makes the covariance indefinite,
/// however long a run is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Factor {
    /// Diagonal of `D`.
    d: Vector4<f32>,
    /// Rows of `L` left of the diagonal: of the parameter, the velocity and the position.
    parameter: f32,
    velocity: [f32; 2],
    position: [f32; 3],
}

/// What a reading says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Derivative of the reading by each state.
    pub(super) by_state: Vector4<f32>,
    /// The reading less what the states predict.
    pub(super) innovation: f32,
    /// Variance of its noise.
    pub(super) variance: f32,
}

/// What a reading changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Correction {
    /// Change of each state per unit of the innovation.
    pub(super) gain: Vector4<f32>,
    pub(super) innovation: Innovation,
}

/// An innovation, and one over its variance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Innovation {
    pub(super) value: f32,
    /// One over its variance.
    pub(super) inverse: f32,
}

impl Correction {
    /// Returns what is to be added to the states.
    #[inline]
    pub(super) fn by(&self) -> Vector4<f32> {
        self.gain * self.innovation.value
    }
}

impl Innovation {
    /// Returns the innovation in standard deviations.
    pub(super) fn deviations(self) -> f32 {
        self.value * sqrt(self.inverse)
    }
}

impl Factor {
    /// Returns the covariance of states that have nothing in common, with these variances.
    pub(super) fn new(variances: [f32; 4]) -> Self {
        Self { d: Vector4::from(variances), ..Self::default() }
    }

    /// Returns the variances of the states.
    pub(super) fn variances(&self) -> Vector4<f32> {
        let Self { d, parameter: p1, velocity: [v1, v2], position: [s1, s2, s3] } = *self;
        Vector4::new(
            d.x,
            p1 * p1 * d.x + d.y,
            v1 * v1 * d.x + v2 * v2 * d.y + d.z,
            s1 * s1 * d.x + s2 * s2 * d.y + s3 * s3 * d.z + d.w,
        )
    }

    /// Returns the variance of the velocity.
    pub(super) fn velocity_variance(&self) -> f32 {
        let Self { d, velocity: [v1, v2], .. } = *self;
        v1 * v1 * d.x + v2 * v2 * d.y + d.z
    }

    /// Propagates over `dt_s`: the velocity loses the bias times `dt_s` and gains the
    /// parameter times `gain_s`; the position gains the velocity times `dt_s`. Adds noise of
    /// these variances to velocity and position.
    pub(super) fn propagate(&mut self, dt_s: f32, gain: f32, noise: [f32; 2]) {
        let [velocity_noise, position_noise] = noise;
        let [v1, v2] = &mut self.velocity;
        *v1 += gain * self.parameter - dt_s;
        *v2 += gain;
        let [s1, s2, s3] = &mut self.position;
        *s1 += dt_s * *v1;
        *s2 += dt_s * *v2;
        *s3 += dt_s;
        // Noise of the velocity alone: a rank-one update of the last two rows.
        let before = self.d.z;
        self.d.z += velocity_noise;
        let kept = before / self.d.z;
        self.d.w += position_noise + velocity_noise * kept * *s3 * *s3;
        *s3 *= kept;
    }

    /// Adds noise of this variance to bias or parameter, along `w`, which is 1 in the state
    /// and 0 in all others (Gill et al., Mathematics of Computation 28, 1974, method C1).
    fn add_noise(&mut self, w: Vector4<f32>, variance: f32) {
        let before = self.d.x;
        self.d.x += variance * w.x * w.x;
        let beta = w.x * variance / self.d.x;
        let Self { parameter, velocity: [v1, _], position: [s1, ..], .. } = self;
        let rest = Vector4::new(
            0.0,
            pass_on(w.y, w.x, beta, parameter),
            pass_on(w.z, w.x, beta, v1),
            pass_on(w.w, w.x, beta, s1),
        );
        self.add_rest_noise(rest, variance * before / self.d.x);
    }

    /// Adds noise along `w`, in which the bias has no part.
    #[inline]
    fn add_rest_noise(&mut self, w: Vector4<f32>, variance: f32) {
        let Self { d, velocity: [_, v2], position: [_, s2, s3], .. } = self;
        let (before, y) = (d.y, w.y);
        d.y += variance * y * y;
        let inverse = 1.0 / d.y;
        let beta = y * variance * inverse;
        let variance = variance * before * inverse;
        let (z, s) = (pass_on(w.z, y, beta, v2), pass_on(w.w, y, beta, s2));
        let before = d.z;
        d.z += variance * z * z;
        let inverse = 1.0 / d.z;
        let beta = z * variance * inverse;
        let variance = variance * before * inverse;
        let s = pass_on(s, z, beta, s3);
        d.w += variance * s * s;
    }

    /// Adds noise of this variance to the bias. Not inlined: no ordinary tick calls it.
    #[inline(never)]
    pub(super) fn add_bias_noise(&mut self, variance: f32) {
        self.add_noise(Vector4::new(1.0, 0.0, 0.0, 0.0), variance);
    }

    /// Adds noise of this variance to the parameter. Not inlined: no ordinary tick calls it.
    #[inline(never)]
    pub(super) fn add_parameter_noise(&mut self, variance: f32) {
        self.add_noise(Vector4::new(0.0, 1.0, 0.0, 0.0), variance);
    }

    /// Adds noise of this variance to the velocity. Not inlined: no ordinary tick calls it.
    #[inline(never)]
    pub(super) fn add_velocity_noise(&mut self, variance: f32) {
        self.propagate(0.0, 0.0, [variance, 0.0]);
    }

    /// Makes the position `by_parameter` times the parameter, with noise of this variance, and
    /// forgets what was known of it.
    pub(super) fn renew_position(&mut self, by_parameter: f32, variance: f32) {
        self.position = [by_parameter * self.parameter, by_parameter, 0.0];
        self.d.w = variance;
    }

    /// Takes a reading; returns what it changes, or none where the innovation is beyond the
    /// gate, or not a number.
    #[inline]
    pub(super) fn update(&mut self, reading: &Reading) -> Option<Correction> {
        let Reading { by_state: h, innovation, .. } = *reading;
        let p1 = self.parameter;
        let ([v1, _], [s1, ..]) = (self.velocity, self.position);
        let f1 = h.x + p1 * h.y + v1 * h.z + s1 * h.w;
        let g1 = self.d.x * f1;
        let (rest, of_bias) = (self.seen_by(reading), f1 * g1);
        let total = rest.total() + of_bias;
        let inverse = gated(innovation, total)?;
        let [b2, b3, b4] = self.downdate(reading, &rest);
        self.d.x *= rest.total() * inverse;
        let e1 = -f1 / rest.total();
        self.parameter = p1 + e1 * b2;
        self.velocity[0] = v1 + e1 * b3;
        self.position[0] = s1 + e1 * b4;
        let gain = Vector4::new(g1, b2 + p1 * g1, b3 + v1 * g1, b4 + s1 * g1) * inverse;
        Some(Correction { gain, innovation: Innovation { value: innovation, inverse } })
    }

    /// Takes a reading as [`Self::update`] does, but leaves the bias as it is: what the reading
    /// says of it goes to nothing, and its uncertainty counts in the reading (Schmidt,
    /// "Application of State-Space Methods to Navigation Problems", 1966).
    #[inline]
    pub(super) fn update_all_but_bias(&mut self, reading: &Reading) -> Option<Correction> {
        let Reading { by_state: h, innovation, .. } = *reading;
        let p1 = self.parameter;
        let ([v1, _], [s1, ..]) = (self.velocity, self.position);
        let f1 = h.x + p1 * h.y + v1 * h.z + s1 * h.w;
        let g1 = self.d.x * f1;
        let (rest, of_bias) = (self.seen_by(reading), f1 * g1);
        let of_rest = rest.total();
        let inverse = gated(innovation, of_rest + of_bias)?;
        let [b2, b3, b4] = self.downdate(reading, &rest);
        // The gain for all states but the bias, and by how much it differs from the one that is
        // best for a known bias: that difference costs certainty.
        let gain = [b2 + p1 * g1, b3 + v1 * g1, b4 + s1 * g1].map(|k| k * inverse);
        let [k2, k3, k4] = gain;
        self.parameter = p1 - k2 * f1;
        self.velocity[0] = v1 - k3 * f1;
        self.position[0] = s1 - k4 * f1;
        let by_rest = 1.0 / of_rest;
        let off = Vector4::new(0.0, k2 - b2 * by_rest, k3 - b3 * by_rest, k4 - b4 * by_rest);
        self.add_rest_noise(off, of_rest);
        let gain = Vector4::new(0.0, k2, k3, k4);
        Some(Correction { gain, innovation: Innovation { value: innovation, inverse } })
    }

    /// Returns how a reading sees the states behind the bias, for a known bias.
    #[inline]
    fn seen_by(&self, reading: &Reading) -> Seen {
        let Reading { by_state: h, variance, .. } = *reading;
        let Self { d, velocity: [_, v2], position: [_, s2, s3], .. } = *self;
        let f4 = h.w;
        let f3 = h.z + s3 * h.w;
        let f2 = h.y + v2 * h.z + s2 * h.w;
        let g = [d.y * f2, d.z * f3, d.w * f4];
        let [g2, g3, g4] = g;
        let a4 = variance + f4 * g4;
        let a3 = a4 + f3 * g3;
        let a2 = a3 + f2 * g2;
        Seen { f: [f2, f3, f4], g, a: [a2, a3, a4] }
    }

    /// Takes a reading for a known bias; returns the covariance of the states behind the bias
    /// with it.
    #[inline]
    fn downdate(&mut self, reading: &Reading, seen: &Seen) -> [f32; 3] {
        let Seen { f: [f2, f3, _], g: [g2, g3, g4], a: [a2, a3, a4] } = *seen;
        let (by_a4, by_a3, by_a2) = (1.0 / a4, 1.0 / a3, 1.0 / a2);
        self.d.w *= reading.variance * by_a4;
        self.d.z *= a4 * by_a3;
        self.d.y *= a3 * by_a2;
        let Self { velocity: [_, v2], position: [_, s2, s3], .. } = self;
        let e3 = -f3 * by_a4;
        let before_s3 = *s3;
        *s3 += e3 * g4;
        let b4 = g4 + before_s3 * g3;
        let e2 = -f2 * by_a3;
        let (before_v2, before_s2) = (*v2, *s2);
        *v2 += e2 * g3;
        *s2 += e2 * b4;
        [g2, g3 + before_v2 * g2, b4 + before_s2 * g2]
    }
}

/// Takes the part of a row in noise along a pivot, and returns what is left of it for the next
/// pivot.
#[inline]
fn pass_on(w: f32, pivot: f32, beta: f32, l: &mut f32) -> f32 {
    let rest = w - pivot * *l;
    *l += beta * rest;
    rest
}

/// How a reading sees the states behind the bias: `f = L' h`, `g = D f`, and the variance of
/// the innovation by the states from each one on.
#[derive(Clone, Copy, Debug)]
struct Seen {
    f: [f32; 3],
    g: [f32; 3],
    a: [f32; 3],
}

impl Seen {
    /// Returns the variance of the innovation for a known bias.
    fn total(&self) -> f32 {
        self.a[0]
    }
}

/// Returns one over the variance of an innovation; none where that is beyond the gate, or not
/// a number.
#[inline]
fn gated(innovation: f32, variance: f32) -> Option<f32> {
    let inverse = 1.0 / variance;
    // False for a NaN.
    (innovation * innovation * inverse <= GATE * GATE).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::random::Random;
    use nalgebra::{Matrix4, Vector4 as V64};

    /// The same in f64, by the textbook.
    struct Reference(Matrix4<f64>);

    fn dense(factor: &Factor) -> Matrix4<f64> {
        let Factor { d, parameter: p1, velocity: [v1, v2], position: [s1, s2, s3] } = *factor;
        #[rustfmt::skip]
        let l = Matrix4::new(
            1.0, 0.0, 0.0, 0.0,
            p1, 1.0, 0.0, 0.0,
            v1, v2, 1.0, 0.0,
            s1, s2, s3, 1.0,
        ).map(f64::from);
        l * Matrix4::from_diagonal(&d.map(f64::from)) * l.transpose()
    }

    impl Reference {
        fn propagate(&mut self, dt_s: f64, gain: f64, [qv, qs]: [f64; 2]) {
            #[rustfmt::skip]
            let f = Matrix4::new(
                1.0, 0.0, 0.0, 0.0,
                0.0, 1.0, 0.0, 0.0,
                -dt_s, gain, 1.0, 0.0,
                -dt_s * dt_s, gain * dt_s, dt_s, 1.0,
            );
            self.0 = f * self.0 * f.transpose();
            self.0[(2, 2)] += qv;
            self.0[(3, 3)] += qs;
        }

        fn update(
            &mut self,
            h: V64<f64>,
            innovation: f64,
            variance: f64,
            spares_bias: bool,
        ) -> V64<f64> {
            let ph = self.0 * h;
            let mut gain = ph / (h.dot(&ph) + variance);
            if spares_bias {
                gain[0] = 0.0;
            }
            let left = Matrix4::identity() - gain * h.transpose();
            self.0 = left * self.0 * left.transpose() + gain * gain.transpose() * variance;
            gain * innovation
        }
    }

    fn assert_close(factor: &Factor, reference: &Reference, what: &str) {
        let (found, expected) = (dense(factor), reference.0);
        for row in 0..4 {
            for column in 0..4 {
                let scale = (expected[(row, row)] * expected[(column, column)]).sqrt();
                let off = (found[(row, column)] - expected[(row, column)]).abs() / scale;
                assert!(off < 2e-3, "{what}: ({row}, {column}) off by {off:.1e}");
            }
        }
    }

    #[test]
    fn agrees_with_the_textbook_in_f64() {
        let mut random = Random::new();
        let mut next = || random.normal();
        let first = [0.04, 0.25, 1.0, 1.0_f32];
        let mut factor = Factor::new(first);
        let mut reference = Reference(Matrix4::from_diagonal(&V64::from(first.map(f64::from))));
        for tick in 0..3_000 {
            let gain = 0.007 + 0.001 * next();
            let noise = [1e-6, 1e-8_f32];
            factor.propagate(1e-3, gain, noise);
            reference.propagate(1e-3, gain.into(), noise.map(f64::from));
            if tick % 16 == 0 {
                factor.add_bias_noise(1e-6);
                factor.add_parameter_noise(1e-5);
                reference.0[(0, 0)] += 1e-6;
                reference.0[(1, 1)] += 1e-5;
            }
            let h = if tick % 500 < 100 {
                Vector4::new(0.0, 0.9, 0.0, 1.0)
            } else {
                Vector4::new(1.0, 7.0, -0.5 * next(), 0.0)
            };
            let (innovation, variance) = (0.02 * next(), 3e-3);
            let reading = Reading { by_state: h, innovation, variance };
            let spares_bias = tick % 500 >= 250;
            let correction = if spares_bias {
                factor.update_all_but_bias(&reading)
            } else {
                factor.update(&reading)
            };
            let Some(correction) = correction else { continue };
            let by = correction.by();
            let (innovation, variance) = (f64::from(innovation), f64::from(variance));
            let expected = reference.update(h.map(f64::from), innovation, variance, spares_bias);
            let off = (by.map(f64::from) - expected).amax() / (expected.amax() + 1e-9);
            assert!(off < 5e-3, "tick {tick}: {by} for {expected}");
            assert_close(&factor, &reference, "after a reading");
        }
        let found = factor.variances().map(f64::from);
        let expected = reference.0.diagonal();
        assert!(((found - expected).amax() / expected.amax()) < 1e-3, "{found} for {expected}");
        assert_eq!(factor.velocity_variance(), factor.variances().z);
        factor.renew_position(-0.9, 0.5);
        let by_parameter = -0.9 * reference.0.column(1);
        reference.0.set_column(3, &by_parameter);
        reference.0.set_row(3, &by_parameter.transpose());
        reference.0[(3, 3)] = 0.81 * reference.0[(1, 1)] + 0.5;
        assert_close(&factor, &reference, "after a renewed position");
    }

    #[test]
    fn stays_positive_over_hours_with_a_thousand_readings_a_second() {
        let mut random = Random::new();
        let mut factor = Factor::new([0.04, 0.25, 1.0, 1.0]);
        for tick in 0..3_000_000_u32 {
            factor.propagate(1e-3, 7e-3, [1e-9, 1e-9]);
            if tick.is_multiple_of(256) {
                factor.add_bias_noise(1e-9);
                factor.add_parameter_noise(1e-9);
            }
            let variance = if tick % 1_000 < 500 { 1e-6 } else { 1e6 };
            let h = Vector4::new(1.0, 7.0, random.normal(), random.normal());
            let reading = Reading { by_state: h, innovation: 0.0, variance };
            if tick % 3_000 < 1_500 {
                factor.update(&reading);
            } else {
                factor.update_all_but_bias(&reading);
            }
            assert!(factor.d.iter().all(|&d| d > 0.0 && d < 10.0), "{factor:?} in {tick}");
        }
    }

    #[test]
    fn leaves_out_a_reading_far_off_and_one_that_is_not_a_number() {
        let mut factor = Factor::new([0.01; 4]);
        let before = dense(&factor);
        for innovation in [1.0, f32::NAN, f32::INFINITY] {
            let by_state = Vector4::new(0.0, 0.0, 0.0, 1.0);
            let reading = Reading { by_state, innovation, variance: 0.01 };
            assert!(factor.update(&reading).is_none());
            assert!(factor.update_all_but_bias(&reading).is_none());
            assert_eq!(dense(&factor), before);
        }
    }
}
