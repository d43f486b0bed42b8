#![doc = include_str!("../README.md")]
// `println!` and `eprintln!` panic when the output is on a full disk; see `leg_process`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bridge;
pub mod cli;
pub mod config;
pub mod curves;
pub mod environment;
pub mod evaluate;
pub mod explore;
pub mod failed_starts;
mod lines;
pub mod policy;
pub mod preset;
pub mod trained;
pub mod world;

pub mod run;
pub mod study;
pub mod threads;
pub mod train;

pub use leg_ddpg::{Critic, Layer};
pub use leg_simd::Isa;
