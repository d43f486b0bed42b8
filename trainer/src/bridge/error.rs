//! Why a file from elsewhere is not taken.

use super::json::TOLERANCE;
use leg_control::actor::ShapeError;
use leg_control::policy::WriteError;

/// Why a file holds no actor that can fly.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// It is no JSON.
    #[error("not JSON: {0}")]
    Syntax(#[from] serde_json::Error),
    /// It is no safetensors file.
    #[error("not a safetensors file: {0}; write it with safetensors.torch.save_file")]
    Safetensors(String),
    /// It is no ONNX file.
    #[error("not an ONNX file: {0}; write it with torch.onnx.export")]
    Protobuf(#[from] prost::DecodeError),
    /// A value is missing or of the wrong kind.
    #[error("{key}: {found}, expected {expected}")]
    Value {
        /// Where, such as `layers[1].bias`.
        key: String,
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// The layers are not those of an actor.
    #[error("layers: {0}")]
    Shape(#[from] ShapeError),
    /// A test vector comes out otherwise.
    #[error(
        "test_vectors[{index}].action: {expected:?}, but the layers give {found:?}, more than {TOLERANCE} off"
    )]
    TestVector {
        /// Which, from 0.
        index: usize,
        /// ImportOptions.
        expected: [f64; 2],
        /// Computed.
        found: [f64; 2],
    },
    /// No layers lead from an observation to an action.
    #[error(
        "no layers in a row lead from 3 inputs to 2 outputs; it holds {found}; name the layers in order, such as --layers fc1,fc2,mu"
    )]
    NoActor {
        /// The layers that are there.
        found: String,
    },
    /// More than one row of layers could be the actor.
    #[error("{} rows of layers could be the actor: {}; choose one", candidates.len(), candidates.join(" or "))]
    Ambiguous {
        /// Each as an option of the command line.
        candidates: Vec<String>,
    },
    /// A graph that is not an actor's.
    #[error("{0}")]
    Graph(String),
    /// A figure is given for what the file says itself.
    #[error("{option}: the file has its own; leave the option out")]
    Own {
        /// The option.
        option: &'static str,
    },
    /// The controller would refuse it.
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
