//! Simulates the spring-legged hopper for a controller: scenarios, sessions in
//! lock-step and in real time, faults, recordings, a live view, and the bridge to a
//! flashed controller. The README of the package describes the program.
// `println!` and `eprintln!` panic when the output is on a full disk; see `leg_process`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod bench;
pub mod bridge;
pub mod cli;
pub mod estimation;
pub mod export;
pub mod faults;
pub mod operate;
pub mod plot;
pub mod record;
pub mod replay;
pub mod robustness;
pub mod scenario;
pub mod sensors;
pub mod session;
pub mod shore;
pub mod statistics;
pub mod watch;
