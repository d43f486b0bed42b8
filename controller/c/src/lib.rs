//! The controller of a spring-legged robot, and the session with it over shared memory, for C
//! and C++. The header is `include/leg.h`.
//!
//! The functions are unsafe as those of C are: each pointer must be valid for what its
//! documentation states, or null where that is permitted.
#![allow(unsafe_code, reason = "it is the border to C")]

mod law;
pub mod messages;
mod session;

pub use law::{LegController, leg_controller_init, leg_controller_step};
pub use messages::{LegCommand, LegHeader, LegSample};
pub use session::{LegSession, leg_exchange, leg_join, leg_leave, leg_receive, leg_send};
