//! Plots a recording.

mod course;
pub mod picture;

pub use course::Course;
