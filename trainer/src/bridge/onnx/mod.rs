//! ONNX: an actor as a graph, with scalings and clip.

mod proto;
mod read;
mod signal;
mod tensor;
#[cfg(test)]
mod tests;
mod write;

pub use read::import;
pub use write::export;
