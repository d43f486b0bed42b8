//! A recording as a picture.

mod course;
pub mod picture;

pub use course::Course;
