//! Plots a recording.

mod data;
pub mod picture;

pub use data::PlotData;
