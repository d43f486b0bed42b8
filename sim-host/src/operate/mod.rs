//! A run operated from beside it: asked how it goes, given another set-point,
//! paused, ended.
//!
//! The leg's desk answers in JSON over a socket, from a thread of its own; the
//! loop and it share a [`Board`] of atomic numbers, so neither waits for the
//! other.

mod board;
mod desk;

pub use board::{BUCKETS, Board};
pub use desk::{LegRequest, LegStatus, open};
