//! Plots a recording.

mod data;
mod estimates;
pub mod picture;

pub use data::PlotData;
