//! Sessions: the plant and a controller stepped together.

pub mod child;
mod command_hold;
mod hash;
pub mod hooks;
pub mod leg;
pub mod lock_step;
mod outcome;
pub mod real_time;
pub mod replica;
pub mod stepped;
mod timing;
pub mod two_processes;

pub use child::ControllerChild;
pub use hash::StateHash;
pub use hooks::Hooks;
pub use leg::{Leg, TickRecord};
pub use lock_step::{Options, SessionError};
pub use outcome::{Ending, Outcome, RunReport};
pub use timing::{RoundTripUs, RoundTrips};
