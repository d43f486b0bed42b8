#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
// Without std nobody catches a panic: what could raise one does not pass.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::unreachable
    )
)]

pub mod actor;
pub mod checksum;
pub mod command;
pub mod config;
pub mod control;
#[cfg(feature = "estimator")]
pub mod estimator;
pub mod gait;
mod geometry;
pub mod guard;
pub mod leg;
mod math;
pub mod measurement;
pub mod medium;
pub mod policy;
mod postcard_once;
pub mod serial;
mod trig;
pub mod velocity;
pub mod wire;
pub mod wire_controller;
