//! The sizes of network that an actor can have.

use heapless::Vec;

/// Most layers of weights in an actor.
pub const MAX_LAYERS: usize = 4;
/// Widest layer, inputs included. An actor's outputs lie on the stack, so that a target allows
/// less than a computer: 1,024 with the feature `wide`.
pub const MAX_WIDTH: usize = if cfg!(feature = "wide") { 1024 } else { 128 };
/// Most floats in an actor: 1 MiB of weights and biases.
pub const MAX_WEIGHTS: usize = (1 << 20) / size_of::<f32>();
/// Inputs: apex velocity, apex height, density ratio.
pub const INPUTS: usize = 3;
/// Outputs: touchdown angle, elongation speed.
pub const OUTPUTS: usize = 2;

/// Widths from the inputs to the outputs, such as 3, 50, 50, 2.
pub type Widths = Vec<u16, { MAX_LAYERS + 1 }>;

/// Why an architecture or its weights are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ShapeError {
    /// Not 1 to [`MAX_LAYERS`] layers.
    Layers(usize),
    /// A width of 0 or above [`MAX_WIDTH`].
    Width(u16),
    /// Not [`INPUTS`] inputs.
    Inputs(u16),
    /// Not [`OUTPUTS`] outputs.
    Outputs(u16),
    /// More than [`MAX_WEIGHTS`] floats.
    TooManyWeights(usize),
    /// A parameter of the activation that is out of range.
    Activation,
    /// Another number of weights than the widths need.
    Weights {
        /// Floats that the widths need.
        expected: usize,
        /// Floats found.
        found: usize,
    },
}

impl core::fmt::Display for ShapeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Layers(n) => write!(f, "{n} layers of weights, allowed are 1 to {MAX_LAYERS}"),
            Self::Width(w) => write!(f, "a layer {w} wide, allowed are 1 to {MAX_WIDTH}"),
            Self::Inputs(n) => write!(f, "{n} inputs, an actor has {INPUTS}"),
            Self::Outputs(n) => write!(f, "{n} outputs, an actor has {OUTPUTS}"),
            Self::TooManyWeights(n) => {
                write!(f, "{n} weights and biases, allowed are {MAX_WEIGHTS}, that is 1 MiB")
            }
            Self::Activation => {
                write!(f, "the slope of leaky_relu is from 0 to 1, the scale of elu from 0 to 100")
            }
            Self::Weights { expected, found } => {
                write!(f, "{found} weights and biases, the widths need {expected}")
            }
        }
    }
}

impl core::error::Error for ShapeError {}

/// Checks the widths; returns the number of floats in the packed weights.
///
/// # Errors
/// [`ShapeError`] when the widths are not those of an actor.
pub fn packed_len(widths: &[u16]) -> Result<usize, ShapeError> {
    let layers = widths.len().saturating_sub(1);
    if layers == 0 || layers > MAX_LAYERS {
        return Err(ShapeError::Layers(layers));
    }
    if let Some(&width) = widths.iter().find(|&&w| w == 0 || usize::from(w) > MAX_WIDTH) {
        return Err(ShapeError::Width(width));
    }
    match (widths.first(), widths.last()) {
        (Some(&n), _) if usize::from(n) != INPUTS => return Err(ShapeError::Inputs(n)),
        (_, Some(&n)) if usize::from(n) != OUTPUTS => return Err(ShapeError::Outputs(n)),
        _ => {}
    }
    let pairs = widths.iter().zip(widths.iter().skip(1));
    let len = pairs.map(|(&i, &o)| (usize::from(i) + 1) * usize::from(o)).sum();
    if len > MAX_WEIGHTS {
        return Err(ShapeError::TooManyWeights(len));
    }
    Ok(len)
}
