//! A learned controller for a spring leg, from the sea floor to dry land.
//!
//! A frozen network, the *actor*, brings the leg to a hop on the spot; a
//! velocity cascade around it makes it travel at a set speed. Data flows one
//! way, once a tick:
//!
//! [`wire::Sample`] → [`guard`] → [`gait`] → at an apex: [`medium`] →
//! [`velocity`] → [`actor`] → [`wire::Command`]
//!
//! [`control::Controller`] is all of it behind one call. Without features the
//! crate uses no std, no allocator and no unsafe code, and panics on no input.
//!
//! # In your own firmware
//! The policy is a file in flash; whatever moves your samples calls `tick` at a
//! fixed rate.
//!
//! ```
//! use leg_control::control::{Config, Controller};
//! use leg_control::policy::{self, Policy};
//! use leg_control::wire::{Header, Sample, WIRE_VERSION, flags};
//!
//! let policy = Policy::parse(policy::SHIPPED)?; // or a blob at a flash address
//! let mut controller = Controller::new(policy, Config::at_rate(1_000)?);
//!
//! // Every millisecond, from the leg's sensors:
//! let sample = Sample {
//!     header: Header {
//!         version: WIRE_VERSION,
//!         flags: flags::CONTACT_SENSED, // and IN_CONTACT while the foot is loaded
//!         run_id: 1,
//!         seq: 0,
//!         t_ns: 0,
//!     },
//!     set_point_m_s: 0.5,
//!     vx_m_s: 0.0,
//!     y_m: 2.0,
//!     vy_m_s: 0.0,
//!     ..Sample::default()
//! };
//! let command = controller.tick(Some(&sample)); // None when no sample came in time
//! # assert!(command.leg_angle_rad.is_finite());
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! `command` says the angle at which to hold the swinging leg, and the ramp of
//! the spring's rest length until the next tick; see [`wire::Command`].
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
pub mod control;
pub mod gait;
pub mod guard;
pub mod leg;
pub mod medium;
pub mod policy;
mod postcard_once;
pub mod serial;
mod trig;
pub mod velocity;
pub mod wire;
