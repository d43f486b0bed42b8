//! The errors of importing an actor.

use leg_control::actor::ShapeError;
use leg_control::policy::WriteError;

/// The reason why a file holds no actor that the controller can run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The file is not JSON.
    #[error("not JSON: {0}")]
    Syntax(#[from] serde_json::Error),
    /// The file is not a safetensors file.
    #[error("not a safetensors file: {0}; write it with safetensors.torch.save_file")]
    Safetensors(String),
    /// The file is not an ONNX file.
    #[error("not an ONNX file: {0}; write it with torch.onnx.export")]
    Protobuf(#[from] prost::DecodeError),
    /// A value is missing or wrong.
    #[error("{key}: {found}, expected {expected}")]
    Value {
        /// Path of the value, such as `layers[1].bias`.
        key: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The layers do not form an actor.
    #[error("layers: {0}")]
    Shape(#[from] ShapeError),
    /// The actor does not reproduce a test vector.
    #[error(
        "test_vectors[{index}].action: {expected:?}, but the layers give {found:?}, more than {tolerance} apart"
    )]
    TestVector {
        /// Index of the test vector, from 0.
        index: usize,
        /// Action of the test vector.
        expected: [f64; 2],
        /// Action of the layers.
        found: [f64; 2],
        /// Largest difference that is allowed, rad and m/s.
        tolerance: f64,
    },
    /// No row of layers leads from an observation to an action.
    #[error("no layers in a row lead from 3 inputs to 2 outputs; it holds {found}")]
    NoActor {
        /// Layers in the file.
        found: String,
    },
    /// More than one row of layers could be the actor.
    #[error("{} rows of layers could be the actor: {}", candidates.len(), candidates.join(" or "))]
    Ambiguous {
        /// Rows of layers, each as a list of names.
        candidates: Vec<String>,
    },
    /// Tensors beside the layers could change the actions.
    #[error("{tensors}: beside the layers {layers}, not used by the policy ({kind})")]
    Unused {
        /// Names and shapes of the tensors.
        tensors: String,
        /// Layers of the actor, in order.
        layers: String,
        /// What the tensors may be.
        kind: &'static str,
    },
    /// The actions have a fixed standard deviation, so their mean may not end in tanh.
    #[error(
        "{tensor:?}: a standard deviation beside the layers, as in actors of PPO, whose mean is \
         not squashed by tanh; the controller's actor ends in tanh"
    )]
    Gaussian {
        /// Name of the tensor.
        tensor: String,
    },
    /// The first output of a graph is not an action, another one is.
    #[error("{reason}; {other:?} could be read, if it is the action")]
    OtherOutput {
        /// Why the first output cannot be read.
        reason: String,
        /// Name of another output.
        other: String,
    },
    /// More than one output of a graph is an action.
    #[error("{} outputs are actions, expected one: {}", names.len(), names.join(", "))]
    Outputs {
        /// Names of the outputs.
        names: Vec<String>,
    },
    /// The graph is not that of an actor.
    #[error("{0}")]
    Graph(String),
    /// A value is given that the file also states.
    #[error("{name}: the file states its own")]
    Stated {
        /// Name of the value.
        name: &'static str,
    },
    /// The controller would refuse the policy.
    #[error(transparent)]
    Refused(#[from] WriteError),
}

impl ImportError {
    pub(super) fn value(
        key: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Value { key: key.into(), found: found.into(), expected: expected.into() }
    }
}
