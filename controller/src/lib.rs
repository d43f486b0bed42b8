//! A learned controller for a spring leg, from the sea floor to dry land.
//!
//! A frozen network, the *actor*, brings the leg to a hop on the spot; a
//! velocity cascade around it makes it travel at a set speed. Data flows one
//! way, once a tick:
//!
//! [`measurement::Measurement`] → [`guard`] → [`gait`] → at an apex: [`medium`] →
//! [`velocity`] → [`actor`] → [`command::LegCommand`]
//!
//! [`control::Controller`] is all of it behind one call. The crate uses no std, no
//! allocator and no unsafe code, and panics on no input.
//!
//! ```
//! use leg_control::config::Config;
//! use leg_control::control::Controller;
//! use leg_control::measurement::{Contact, Measurement};
//! use leg_control::policy::{self, Policy};
//!
//! let policy = Policy::parse(policy::SHIPPED)?; // or a blob at a flash address
//! let mut controller = Controller::new(policy, Config::at_rate(1_000)?);
//!
//! // Every millisecond, from the leg's sensors, and from whoever sets the speed:
//! let measurement = Measurement {
//!     t_ns: 0,
//!     vx_m_s: 0.0,
//!     y_m: 2.0,
//!     vy_m_s: 0.0,
//!     contact: Contact::Sensed(false),
//!     density_ratio: None,
//! };
//! let output = controller.step(Some(&measurement), 0.5); // None when no measurement came
//! assert!(output.status.is_safe(), "it has not estimated the density yet");
//! # assert!(output.command.is_valid());
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! [`command::LegCommand`] holds the angle of the swinging leg and the ramp of the
//! spring's rest length until the next tick. Where messages carry the measurements, use
//! [`wire_controller::WireController`]; at the end of a byte stream, use [`serial`].
//!
//! # Where the libraries serve
//!
//! | library | used for | not for |
//! |---|---|---|
//! | `heapless` | network widths, gain schedule, test vectors, the window of the density estimate | |
//! | `nalgebra` | vectors of leg and foot (`geometry`), the actor's input scaling | the network's layers: 15,021 instructions for a pass on a Cortex-M4F, against 5,849 of [`actor`] |
//! | `micromath` | the hip angle in stance (`atan2`, within 3 mrad) | sine and cosine of the leg angle, which need 2e-7 (`trig`); tanh, whose error of 1.8e-4 would show in the action |
//! | `libm` | square root, tanh | sine and cosine, which it computes in f64: 11 KiB of flash |
//! | `serde`, `postcard` | messages and the policy file | |
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
pub mod gait;
mod geometry;
pub mod guard;
pub mod leg;
pub mod measurement;
pub mod medium;
pub mod policy;
mod postcard_once;
pub mod serial;
mod trig;
pub mod velocity;
pub mod wire;
pub mod wire_controller;
