//! Sessions: the plant played to a controller.

pub mod child;
mod hash;
mod held;
pub mod hooks;
pub mod leg;
pub mod lock_step;
mod outcome;
pub mod real_time;
pub mod stepped;
mod timing;
pub mod two_processes;

pub use child::ControllerChild;
pub use hash::StateHash;
pub use held::SAFE_AFTER_TICKS;
pub use hooks::Hooks;
pub use leg::{Leg, TickRecord};
pub use lock_step::{Options, SessionError};
pub use outcome::{Ending, Outcome, Report};
pub use timing::{RoundTripUs, RoundTrips};
