//! Functions of one number, by the names that operations have.

use super::curve;
use super::proto::Node;
use super::walk::attribute;
use crate::bridge::activation::{ELU_SCALE, LEAKY_RELU_SLOPE};

/// The activations of a `FusedGemm`, for messages.
pub(super) const FUSED: &str = "Elu, LeakyRelu, Relu, Sigmoid, Tanh";

/// A function of one number.
pub(super) type Function = Box<dyn Fn(f64) -> f64>;

/// Returns the function of an operation with one input; `None` for any other operation.
pub(super) fn function(op: &str, node: &Node) -> Option<Result<Function, String>> {
    let number = |name: &str| attribute(node, name).and_then(|a| a.f);
    Some(Ok(match op {
        "Relu" => Box::new(|x: f64| x.max(0.0)),
        "LeakyRelu" => leaky_relu(number("alpha").unwrap_or(LEAKY_RELU_SLOPE)),
        "Elu" => elu(number("alpha").unwrap_or(ELU_SCALE)),
        "Tanh" => Box::new(f64::tanh),
        "Sigmoid" => Box::new(curve::sigmoid),
        "Swish" => {
            let alpha = f64::from(number("alpha").unwrap_or(1.0));
            Box::new(move |x| x * curve::sigmoid(alpha * x))
        }
        "Gelu" => match attribute(node, "approximate").and_then(|a| a.s.as_deref()) {
            Some(b"tanh") => Box::new(curve::gelu_tanh),
            None | Some(b"none") => Box::new(curve::gelu),
            Some(other) => {
                return Some(Err(format!("approximate \"{}\"", other.escape_ascii())));
            }
        },
        "Erf" => Box::new(libm::erf),
        "Exp" => Box::new(f64::exp),
        "Neg" => Box::new(|x: f64| -x),
        "Sqrt" => Box::new(f64::sqrt),
        "Reciprocal" => Box::new(f64::recip),
        _ => return None,
    }))
}

pub(super) fn leaky_relu(slope: f32) -> Function {
    Box::new(move |x| if x > 0.0 { x } else { f64::from(slope) * x })
}

pub(super) fn elu(scale: f32) -> Function {
    Box::new(move |x| if x > 0.0 { x } else { f64::from(scale) * x.exp_m1() })
}

/// Returns the parameter of the activation of a `FusedGemm`.
pub(super) fn fused_alpha(node: &Node) -> Option<f32> {
    attribute(node, "activation_alpha").and_then(|a| a.f)
}
