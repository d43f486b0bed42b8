//! The main job: out of the sea, over the shore, onto land.

pub mod picture;
pub mod report;
pub mod track;
