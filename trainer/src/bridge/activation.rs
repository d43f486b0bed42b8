//! Activations by their names, as options, model cards and JSON files write them.

use leg_control::actor::{Activation, OutputActivation};

/// The names of the activations between layers, for messages.
pub(crate) const NAMES: &str =
    "relu, leaky_relu, leaky_relu(SLOPE), elu, elu(SCALE), tanh, silu (or swish), gelu_tanh";
/// The names of the activations after the last layer, for messages.
pub(crate) const OUTPUT_NAMES: &str = "tanh, linear (or none)";

/// Slope of a `leaky_relu` without a parameter, as in PyTorch and ONNX.
pub(crate) const LEAKY_RELU_SLOPE: f32 = 0.01;
/// Scale of an `elu` without a parameter, as in PyTorch and ONNX.
pub(crate) const ELU_SCALE: f32 = 1.0;

/// Reads the name of an activation between layers, in the form that [`Activation`] displays;
/// a parameter may be left out.
///
/// # Errors
/// Returns what was expected.
pub(crate) fn hidden(text: &str) -> Result<Activation, String> {
    let unknown = || format!("\"{}\" is none of {NAMES}", text.escape_debug());
    let (name, parameter) = match text.strip_suffix(')').and_then(|t| t.split_once('(')) {
        Some((name, number)) => (name, Some(number.parse::<f32>().map_err(|_| unknown())?)),
        None => (text, None),
    };
    let activation = match (name, parameter) {
        ("relu", None) => Activation::Relu,
        ("leaky_relu", slope) => Activation::LeakyRelu(slope.unwrap_or(LEAKY_RELU_SLOPE)),
        ("elu", scale) => Activation::Elu(scale.unwrap_or(ELU_SCALE)),
        ("tanh", None) => Activation::Tanh,
        ("silu" | "swish", None) => Activation::Silu,
        ("gelu_tanh", None) => Activation::GeluTanh,
        _ => return Err(unknown()),
    };
    if activation.is_valid() {
        Ok(activation)
    } else {
        Err(format!("\"{text}\": a slope is from 0 to 1, a scale of elu from 0 to 100"))
    }
}

/// Reads the name of an activation after the last layer.
///
/// # Errors
/// Returns what was expected.
pub(crate) fn output(text: &str) -> Result<OutputActivation, String> {
    match text {
        "tanh" => Ok(OutputActivation::Tanh),
        "linear" | "none" => Ok(OutputActivation::Linear),
        _ => Err(format!("\"{}\" is none of {OUTPUT_NAMES}", text.escape_debug())),
    }
}

#[cfg(test)]
mod tests {
    use super::{hidden, output};
    use leg_control::actor::{Activation, OutputActivation};

    #[test]
    fn reads_what_an_activation_displays() {
        for activation in [
            Activation::Relu,
            Activation::LeakyRelu(0.2),
            Activation::Elu(1.0),
            Activation::Tanh,
            Activation::Silu,
            Activation::GeluTanh,
        ] {
            assert_eq!(hidden(&activation.to_string()), Ok(activation));
        }
        for activation in [OutputActivation::Tanh, OutputActivation::Linear] {
            assert_eq!(output(&activation.to_string()), Ok(activation));
        }
        assert_eq!(hidden("leaky_relu"), Ok(Activation::LeakyRelu(0.01)));
        assert_eq!(hidden("swish"), Ok(Activation::Silu));
    }

    #[test]
    fn refuses_other_names_and_parameters_out_of_range() {
        for bad in ["", "gelu", "relu(1)", "elu(x)", "elu(1", "tanh()"] {
            assert!(hidden(bad).unwrap_err().contains("is none of relu, leaky_relu"), "{bad}");
        }
        assert!(hidden("leaky_relu(2)").unwrap_err().contains("a slope is from 0 to 1"));
        assert!(hidden("elu(NaN)").unwrap_err().contains("from 0 to 100"));
        assert!(output("softmax").unwrap_err().contains("is none of tanh, linear"));
    }
}
