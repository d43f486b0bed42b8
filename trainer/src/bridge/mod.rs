//! Actors out to, and in from, the tools that others use.
//!
//! | file | out | in |
//! |---|---|---|
//! | safetensors | the layers of a PyTorch `nn.Sequential` | any row of linear layers |
//! | ONNX | a graph from `observation` to `action` | graphs of one such network |
//! | C99 | the actor as one source file, to the last bit | |
//! | JSON | | the layout of the published actors |
//!
//! A file that is read becomes a [imported::ImportedActor`]: layers, and the scalings that the
//! file has. With what the user gives for the rest it becomes an actor that can fly.
//! Our own exports carry a [`model_card::ModelCard`], by which they come back as the very policy.

pub mod c;

mod error;
pub mod imported;
pub mod json;
pub mod model_card;
pub mod onnx;
pub mod safetensors;
mod state_dict;

pub use error::ImportError;
