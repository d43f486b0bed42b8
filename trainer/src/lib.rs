#![doc = include_str!("../README.md")]
// `println!` and `eprintln!` panic when the output is on a full disk; see `leg_process`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]
// Code that is generic over the instruction set must be inlined into the function that is
// compiled for it, else it uses the baseline.
#![allow(clippy::inline_always, reason = "see `simd`")]

pub mod bridge;
pub mod cli;
pub mod config;
pub mod curves;
pub mod ddpg;
pub mod environment;
pub mod evaluate;
pub mod explore;
pub mod failed_starts;
mod lines;
pub mod net;
pub mod policy;
pub mod preset;
pub mod replay;
pub mod trained;
pub mod world;

pub mod run;
pub mod simd;
pub mod study;
pub mod threads;
pub mod train;
