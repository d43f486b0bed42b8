//! A learned controller for a spring leg, from the sea floor to dry land.
//!
//! Data flows one way, once a tick: [`wire::Sample`] → guard → gait → density
//! estimate → velocity cascade → actor → [`wire::Command`].
#![cfg_attr(not(feature = "host"), no_std)]
#![cfg_attr(not(feature = "host"), forbid(unsafe_code))]

pub mod actor;
pub mod control;
pub mod gait;
pub mod guard;
#[cfg(feature = "host")]
pub mod host;
pub mod leg;
pub mod medium;
pub mod policy;
pub mod velocity;
pub mod wire;
