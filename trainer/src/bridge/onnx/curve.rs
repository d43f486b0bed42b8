//! What a graph does with each sum of a layer, as the values of a function at fixed sums.
//!
//! Exporters write one activation in many ways: `SiLU` as a product with a sigmoid, ReLU as a
//! maximum, GELU as a polynomial within a tanh. Here every operation is applied to the values
//! of all sums, and the result is compared with the activations of an actor: two ways to write
//! the same function are the same curve.

use std::sync::Arc;

use leg_control::actor::{Activation, OutputActivation};

/// Steps on each side of 0 where an activation bends, and their width.
const STEPS: i32 = 260;
const STEP: f64 = 0.046_875;
/// Sums beyond, up to where exp leaves the range of f32.
const FAR: [f64; 4] = [16.0, 24.0, 40.0, 80.0];
/// Largest difference from an activation, as a share of the sum or of 1.
const TOLERANCE: f64 = 2e-6;

/// A function of the sums, by its values at [`sums`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Curve(Arc<[f64]>);

fn sums() -> impl Iterator<Item = f64> {
    let far = FAR.iter().flat_map(|&x| [x, -x]);
    (-STEPS..=STEPS).map(|k| f64::from(k) * STEP).chain(far)
}

impl Curve {
    /// Returns the sums themselves.
    pub(super) fn identity() -> Self {
        Self(sums().collect())
    }

    /// Applies a function to every value.
    pub(super) fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Self(self.0.iter().map(|&x| f(x)).collect())
    }

    /// Combines the values of two curves.
    pub(super) fn with(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(self.0.iter().zip(&*other.0).map(|(&a, &b)| f(a, b)).collect())
    }

    /// Takes the values of `yes` where this curve is not 0, else those of `no`.
    pub(super) fn choose(&self, yes: &Self, no: &Self) -> Self {
        let values = self.0.iter().zip(yes.0.iter().zip(&*no.0));
        Self(values.map(|(&condition, (&a, &b))| if condition == 0.0 { b } else { a }).collect())
    }

    /// Returns the activation after the last layer that this is.
    pub(super) fn output(&self) -> Option<OutputActivation> {
        let is = |f: fn(f64) -> f64| self.difference(f) <= TOLERANCE;
        if is(|x| x) {
            Some(OutputActivation::Linear)
        } else if is(f64::tanh) {
            Some(OutputActivation::Tanh)
        } else {
            None
        }
    }

    /// Returns the activation between layers that this is.
    ///
    /// # Errors
    /// Returns the one that comes nearest, and how far it is.
    pub(super) fn activation(&self) -> Result<Activation, String> {
        let near = self.candidates().map(|a| (a, self.difference(|x| exact(a, x))));
        let (nearest, difference) = near
            .into_iter()
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
            .unwrap_or((Activation::Relu, f64::INFINITY));
        if difference <= TOLERANCE {
            return Ok(nearest);
        }
        let hint = match nearest {
            Activation::GeluTanh if difference < 1e-3 => {
                "; export GELU with approximate=\"tanh\", as the actor computes it"
            }
            _ => "",
        };
        Err(format!(
            "what lies between two layers is none of an actor's activations; the nearest is \
             {nearest}, which differs by up to {difference:.1e}{hint}"
        ))
    }

    /// Returns each activation with the parameters that this curve has at -1.
    fn candidates(&self) -> [Activation; 6] {
        let at = sums()
            .zip(&*self.0)
            .min_by(|(a, _), (b, _)| (a + 1.0).abs().total_cmp(&(b + 1.0).abs()));
        let (x, value) = at.map_or((-1.0, 0.0), |(x, &value)| (x, value));
        [
            Activation::Relu,
            Activation::LeakyRelu((value / x) as f32),
            Activation::Elu((value / x.exp_m1()) as f32),
            Activation::Tanh,
            Activation::Silu,
            Activation::GeluTanh,
        ]
    }

    /// Returns the largest difference from a function, as a share of the sum or of 1; infinite
    /// where a value is not finite.
    fn difference(&self, f: impl Fn(f64) -> f64) -> f64 {
        let each = sums().zip(&*self.0).map(|(x, &value)| {
            let difference = (value - f(x)).abs() / x.abs().max(1.0);
            if difference.is_nan() { f64::INFINITY } else { difference }
        });
        each.fold(0.0, f64::max)
    }
}

/// Returns the value of an activation in double precision.
fn exact(activation: Activation, x: f64) -> f64 {
    match activation {
        Activation::LeakyRelu(slope) if x <= 0.0 => f64::from(slope) * x,
        Activation::Elu(scale) if x <= 0.0 => f64::from(scale) * x.exp_m1(),
        Activation::Relu | Activation::LeakyRelu(_) | Activation::Elu(_) => x.max(0.0),
        Activation::Tanh => x.tanh(),
        Activation::Silu => x * sigmoid(x),
        Activation::GeluTanh => gelu_tanh(x),
        // A newer activation is recognised once it is written here.
        _ => f64::NAN,
    }
}

pub(super) fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The approximation of GELU by tanh.
pub(super) fn gelu_tanh(x: f64) -> f64 {
    let slope = (2.0 / std::f64::consts::PI).sqrt();
    0.5 * x * (1.0 + (slope * (x + 0.044_715 * x.powi(3))).tanh())
}

/// GELU itself.
pub(super) fn gelu(x: f64) -> f64 {
    0.5 * x * (1.0 + libm::erf(x / std::f64::consts::SQRT_2))
}
