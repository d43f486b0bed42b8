//! A layer, with ReLU or without, ten rows at a time, and the square root, in assembly for a
//! Cortex-M4F: the only unsafe code on the way of the control law, in a crate of its
//! own so that `controller` can forbid it.
//!
//! `push_outputs`, `push_sums` and `sqrt` exist on Arm targets with the hard-float ABI
//! alone; elsewhere this crate is empty and `controller` runs its portable kernel and
//! the square root of libm. Those are also the oracles that these are compared with,
//! bit for bit, by the bench image of `controller/firmware` on every `cargo xtask budget`.
#![no_std]

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
mod layer;
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
mod root;

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
pub use layer::{push_outputs, push_sums};
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
pub use root::sqrt;

/// Rows that are computed side by side, as many as leave registers for a column.
pub const ROWS: usize = 10;
