//! Export of actors to the formats of other tools, and import from them.
//!
//! | format | export | import |
//! |---|---|---|
//! | safetensors | the layers of a PyTorch `nn.Sequential` | any row of linear layers; every other tensor is applied, refused or named |
//! | ONNX | a graph from `observation` to `action` | graphs of one such network, however its activations are written |
//! | C99 | the actor as one source file, with the controller's bits | |
//! | JSON | | the layout of the published actors |
//!
//! A file that is read becomes an [`imported::ImportedActor`]: its layers, and the scalings
//! that it states. [`imported::ImportOptions`] complete it to an actor that the controller can
//! run. Exports of this crate carry a [`model_card::ModelCard`], by which an import restores
//! the same policy.

pub(crate) mod activation;
pub mod c;

mod error;
mod half;
pub mod imported;
pub mod json;
pub mod model_card;
pub mod onnx;
pub mod safetensors;
mod state_dict;
mod unique_json;

pub use error::ImportError;
