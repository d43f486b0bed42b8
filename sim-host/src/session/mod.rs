//! Sessions: the plant played to a controller.

pub mod child;
mod hash;
pub mod lock_step;
mod timing;
pub mod two_processes;

pub use child::ControllerChild;
pub use hash::StateHash;
pub use lock_step::{Ending, Options, Outcome, Report, SessionError, TickRecord};
pub use timing::{RoundTripUs, RoundTrips};
