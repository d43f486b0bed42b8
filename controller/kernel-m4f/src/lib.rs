//! A layer with ReLU, ten rows at a time, in assembly for a Cortex-M4F: the only
//! unsafe code on the way of the control law, in a crate of its own so that
//! `controller` can forbid it.
//!
//! `push_outputs` exists on Arm targets with the hard-float ABI
//! alone; elsewhere this crate is empty and `controller` runs its portable kernel.
//! That one is also the oracle that this one is compared with, bit for bit, by the
//! bench image of `controller/firmware` on every `cargo xtask budget`.
#![no_std]

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
mod layer;

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
pub use layer::push_outputs;

/// Rows that are computed side by side, as many as leave registers for a column.
pub const ROWS: usize = 10;
