//! What the main loop and the tick share: the pilot, and the way out.

use crate::ceiling::Ceiling;
use crate::line::Sender;
use controller::serial::pilot::{Pilot, SharedPilot};

/// Pilot and way out, as one: a command goes out before the next can come about.
#[derive(Debug)]
pub struct Shared {
    /// Runs the control law.
    pub pilot: Pilot<'static>,
    /// Takes frames.
    pub sender: Sender,
}

/// The one.
pub static SHARED: Ceiling<Shared> =
    Ceiling::new(Shared { pilot: Pilot::new(), sender: Sender::new() });

impl SharedPilot for Ceiling<Shared> {
    fn with<R>(&self, f: impl FnOnce(&mut Pilot<'static>) -> R) -> R {
        Ceiling::with(self, |shared| f(&mut shared.pilot))
    }
}
