//! The functions between the layers and at the end of the network.
//!
//! All are computed in f32 by the same software on every target, from `libm`'s `tanhf` and
//! `expm1f` alone, so that an actor has the same bits everywhere. Sigmoid is that of tanh.

use serde::{Deserialize, Serialize};

use super::kernel::relu;

/// The square root of 2 / pi, of the approximation of GELU by tanh (Hendrycks and Gimpel,
/// arXiv:1606.08415).
pub const GELU_SLOPE: f32 = 0.797_884_6;
/// The weight of the cube in it.
pub const GELU_CUBE: f32 = 0.044_715;

/// The functions of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Activations {
    /// Behind every layer but the last.
    pub hidden: Activation,
    /// Behind the last layer, before the action's scaling.
    pub output: OutputActivation,
}

/// A function behind a hidden layer, for each of its sums x.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Activation {
    /// x above 0, else 0.
    #[default]
    Relu,
    /// x above 0, else this slope times x; the slope is from 0 to 1.
    LeakyRelu(f32),
    /// x above 0, else this times (exp(x) - 1); it is from 0 to 100.
    Elu(f32),
    /// The hyperbolic tangent.
    Tanh,
    /// x times the sigmoid of x, also called swish.
    Silu,
    /// The approximation of GELU by tanh.
    GeluTanh,
}

/// What becomes of a sum of the last layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum OutputActivation {
    /// Its hyperbolic tangent.
    #[default]
    Tanh,
    /// The sum itself, as the mean of a Gaussian policy that is not squashed.
    Linear,
}

/// The hyperbolic tangent. Not inlined, to save flash: it is called in several places.
#[inline(never)]
fn tanhf(x: f32) -> f32 {
    libm::tanhf(x)
}

impl Activation {
    /// Replaces each sum by its value.
    #[inline(never)]
    pub fn apply(self, sums: &mut [f32]) {
        for x in sums {
            *x = self.of(*x);
        }
    }

    /// Returns the value for one sum. Every finite sum has a finite value.
    #[must_use]
    pub fn of(self, x: f32) -> f32 {
        match self {
            Self::Relu => relu(x),
            Self::LeakyRelu(slope) => {
                if x > 0.0 {
                    x
                } else {
                    slope * x
                }
            }
            Self::Elu(scale) => {
                if x > 0.0 {
                    x
                } else {
                    scale * libm::expm1f(x)
                }
            }
            Self::Tanh => tanhf(x),
            // The factor lies between 0 and 1, so a large sum stays finite.
            Self::Silu => x * (0.5 + 0.5 * tanhf(0.5 * x)),
            Self::GeluTanh => x * (0.5 + 0.5 * tanhf(GELU_SLOPE * (x + GELU_CUBE * (x * x * x)))),
        }
    }

    /// Returns whether the parameter is one that is allowed.
    #[must_use]
    pub fn is_valid(self) -> bool {
        match self {
            Self::LeakyRelu(slope) => (0.0..=1.0).contains(&slope),
            Self::Elu(scale) => (0.0..=100.0).contains(&scale),
            Self::Relu | Self::Tanh | Self::Silu | Self::GeluTanh => true,
        }
    }
}

impl OutputActivation {
    /// Returns the value for one sum.
    #[must_use]
    pub fn of(self, x: f32) -> f32 {
        match self {
            Self::Tanh => tanhf(x),
            Self::Linear => x,
        }
    }
}

impl core::fmt::Display for Activation {
    /// Writes the name that ONNX and PyTorch use, in lower case, and the parameter.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Relu => f.write_str("relu"),
            Self::LeakyRelu(slope) => write!(f, "leaky_relu({slope})"),
            Self::Elu(scale) => write!(f, "elu({scale})"),
            Self::Tanh => f.write_str("tanh"),
            Self::Silu => f.write_str("silu"),
            Self::GeluTanh => f.write_str("gelu_tanh"),
        }
    }
}

impl core::fmt::Display for OutputActivation {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Tanh => "tanh",
            Self::Linear => "linear",
        })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    /// Sums from far below to far above, close to each other around 0.
    fn sums() -> impl Iterator<Item = f32> {
        let around = (-32_000..=32_000_i16).map(|k| f32::from(k) * 6e-4);
        let far = [-1e30, -1e9, -200.0, -90.0, 90.0, 200.0, 1e9, 1e30];
        around.chain(far)
    }

    #[test]
    fn each_function_is_within_3e_7_of_its_definition_and_of_the_sum() {
        let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
        let gelu = |x: f64| {
            0.5 * x
                * (1.0 + ((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x.powi(3))).tanh())
        };
        let cases: [(Activation, &dyn Fn(f64) -> f64); 6] = [
            (Activation::Relu, &|x| x.max(0.0)),
            (Activation::LeakyRelu(0.01), &|x| if x > 0.0 { x } else { f64::from(0.01_f32) * x }),
            (Activation::Elu(1.5), &|x| if x > 0.0 { x } else { 1.5 * x.exp_m1() }),
            (Activation::Tanh, &f64::tanh),
            (Activation::Silu, &|x| x * sigmoid(x)),
            (Activation::GeluTanh, &gelu),
        ];
        for (activation, exact) in cases {
            for x in sums() {
                let (found, expected) = (f64::from(activation.of(x)), exact(f64::from(x)));
                let allowed = 3e-7 * f64::from(x).abs().max(1.0);
                assert!((found - expected).abs() <= allowed, "{activation} of {x}: {found}");
            }
        }
    }

    #[test]
    fn a_finite_sum_has_a_finite_value() {
        let all = [
            Activation::Relu,
            Activation::LeakyRelu(1.0),
            Activation::Elu(100.0),
            Activation::Tanh,
            Activation::Silu,
            Activation::GeluTanh,
        ];
        for activation in all {
            for x in [f32::MAX, f32::MIN, f32::MIN_POSITIVE, 0.0, -0.0] {
                assert!(activation.of(x).is_finite(), "{activation} of {x}");
            }
        }
    }

    #[test]
    fn parameters_outside_their_range_are_not_valid() {
        let bad = [f32::NAN, -0.1, f32::INFINITY];
        assert!(bad.iter().all(|&x| !Activation::LeakyRelu(x).is_valid()));
        assert!(bad.iter().all(|&x| !Activation::Elu(x).is_valid()));
        assert!(!Activation::LeakyRelu(1.1).is_valid() && Activation::LeakyRelu(0.01).is_valid());
        assert!(!Activation::Elu(101.0).is_valid() && Activation::Elu(1.0).is_valid());
    }
}
