//! Adam with a clipped gradient norm. The soft update of the target network happens in the same
//! pass over the weights.

use super::Row;
use leg_simd::{Lanes, Simd, Sum, Vector};

/// Decay rate of the mean gradient.
const BETA_1: f32 = 0.9;
/// Decay rate of the mean squared gradient.
const BETA_2: f32 = 0.999;
/// Keeps the quotient of Adam finite.
const EPSILON: f32 = 1e-8;
/// Added and subtracted again, this flushes decayed means to zero before they become subnormal,
/// which slows some CPUs down. The means of unused units halve every seven updates.
const FLUSH: f32 = 1e-25;

/// Adam's state for the weights of one network.
#[derive(Clone, Debug)]
pub(crate) struct Adam<const P: usize> {
    pub(crate) mean: Box<[Row<P>]>,
    pub(crate) mean_square: Box<[Row<P>]>,
    /// `BETA_1` and `BETA_2` to the power of the updates done.
    pub(crate) decayed: [f64; 2],
}

/// The parameters of one step of [`Adam`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    pub(crate) learning_rate: f32,
    pub(crate) max_gradient_norm: f32,
    /// Rate of the soft update of the target network.
    pub(crate) target_smoothing: f32,
}

impl<const P: usize> Adam<P> {
    /// Creates the state for a network of `rows` rows of weights.
    pub(crate) fn new(rows: usize) -> Self {
        Self {
            mean: vec![Row::ZERO; rows].into(),
            mean_square: vec![Row::ZERO; rows].into(),
            decayed: [1.0; 2],
        }
    }

    /// Moves `weights` against `gradient`, and `target` towards `weights`. Returns the
    /// gradient's norm before clipping.
    #[inline(always)]
    pub(crate) fn step<S: Simd>(
        &mut self,
        simd: S,
        step: Step,
        gradient: &[Row<P>],
        weights: &mut [Row<P>],
        target: &mut [Row<P>],
    ) -> f32 {
        let norm = norm(simd, gradient);
        self.decayed[0] *= f64::from(BETA_1);
        self.decayed[1] *= f64::from(BETA_2);
        let rule = Rule {
            clip: if norm > step.max_gradient_norm { step.max_gradient_norm / norm } else { 1.0 },
            rate: (f64::from(step.learning_rate) / (1.0 - self.decayed[0])) as f32,
            unbias_square: (1.0 / (1.0 - self.decayed[1])) as f32,
            smoothing: step.target_smoothing,
        };
        let memory = self.mean.iter_mut().zip(&mut self.mean_square);
        for (((w, t), g), (m, v)) in weights.iter_mut().zip(target).zip(gradient).zip(memory) {
            let mut c = 0;
            while c + 16 <= P {
                rule.apply::<S::V16, P>(simd, c, g, m, v, w, t);
                c += 16;
            }
            if c < P {
                rule.apply::<S::V8, P>(simd, c, g, m, v, w, t);
            }
        }
        norm
    }
}

/// The coefficients of one step, the same for all weights.
#[derive(Clone, Copy)]
struct Rule {
    clip: f32,
    rate: f32,
    unbias_square: f32,
    smoothing: f32,
}

impl Rule {
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "five rows side by side")]
    fn apply<V: Vector, const P: usize>(
        self,
        token: V::Token,
        c: usize,
        g: &Row<P>,
        m: &mut Row<P>,
        v: &mut Row<P>,
        w: &mut Row<P>,
        t: &mut Row<P>,
    ) {
        let g = V::load(token, &g[c..]).mul(V::splat(token, self.clip));
        let flush = V::splat(token, FLUSH);
        let mean = V::load(token, &m[c..])
            .mul(V::splat(token, BETA_1))
            .add(g.mul(V::splat(token, 1.0 - BETA_1)));
        let mean = mean.add(flush).sub(flush);
        let square = V::load(token, &v[c..])
            .mul(V::splat(token, BETA_2))
            .add(g.mul(g).mul(V::splat(token, 1.0 - BETA_2)));
        let square = square.add(flush).sub(flush);
        mean.store(&mut m[c..]);
        square.store(&mut v[c..]);
        let deviation = square.mul(V::splat(token, self.unbias_square)).sqrt();
        let change =
            mean.mul(V::splat(token, self.rate)).div(deviation.add(V::splat(token, EPSILON)));
        let moved = V::load(token, &w[c..]).sub(change);
        moved.store(&mut w[c..]);
        let old = V::load(token, &t[c..]);
        old.add(moved.sub(old).mul(V::splat(token, self.smoothing))).store(&mut t[c..]);
    }
}

/// Returns the Euclidean norm over all rows.
#[inline(always)]
fn norm<S: Simd, const P: usize>(simd: S, rows: &[Row<P>]) -> f32 {
    let mut wide = S::V16::splat(simd, 0.0);
    let mut narrow = S::V8::splat(simd, 0.0);
    for row in rows {
        let mut c = 0;
        while c + 16 <= P {
            let x = S::V16::load(simd, &row[c..]);
            wide = wide.add(x.mul(x));
            c += 16;
        }
        if c < P {
            let x = S::V8::load(simd, &row[c..]);
            narrow = narrow.add(x.mul(x));
        }
    }
    (wide.sum() + narrow.sum()).sqrt()
}

/// Moves `target` towards `weights` by `rate` of the way.
#[inline(always)]
pub(crate) fn soft_update<S: Simd, const P: usize>(
    simd: S,
    rate: f32,
    weights: &[Row<P>],
    target: &mut [Row<P>],
) {
    let rate = S::V8::splat(simd, rate);
    for (w, t) in weights.iter().zip(target) {
        for c in (0..P).step_by(8) {
            let old = S::V8::load(simd, &t[c..]);
            let new = S::V8::load(simd, &w[c..]);
            old.add(new.sub(old).mul(rate)).store(&mut t[c..]);
        }
    }
}
