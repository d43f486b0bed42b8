//! ONNX: an actor as a graph, with scalings and clip.

mod arithmetic;
mod curve;
mod function;
mod proto;
mod read;
mod signal;
mod tensor;
#[cfg(test)]
mod tests;
mod walk;
mod write;

pub use read::{OnnxOptions, import};
pub use write::export;
