//! What a leg and its controller see of each other: one trait, any transport.

use std::time::Duration;

use super::card::Role;
use crate::wire::{Command, Sample};

/// One end of a link between a leg and its controller.
///
/// A link holds at most one message each way: a message not yet taken is
/// replaced by the next, so the receiver always sees the newest. Sending never
/// waits for the peer. The trait is the place for middleware: whatever wraps a
/// link (faults, recording, timing) is again a link.
pub trait Link {
    /// What this end sends.
    type Sends: Copy;
    /// What this end receives.
    type Receives: Copy;

    /// Hands a message to the peer, in place of one that it has not taken.
    ///
    /// # Errors
    /// [`LinkError`] when the transport fails. A peer that is gone is found by
    /// [`Link::receive`], not here.
    fn send(&mut self, message: &Self::Sends) -> Result<(), LinkError>;

    /// Takes the newest message, waiting for one at most `timeout`; `None` when
    /// none came.
    ///
    /// # Errors
    /// [`LinkError`] when the peer is gone and left nothing to take, when the
    /// process was told to stop, or when the transport fails.
    fn receive(&mut self, timeout: Duration) -> Result<Option<Self::Receives>, LinkError>;

    /// Whether a session in lock-step is to go on with what it has, and not wait
    /// for the answer to what it sent last: never on a plain link, whose answer
    /// comes; middleware that loses or delays messages says so after a receive.
    fn is_settled(&self) -> bool {
        false
    }
}

impl<L: Link + ?Sized> Link for &mut L {
    type Sends = L::Sends;
    type Receives = L::Receives;

    fn send(&mut self, message: &L::Sends) -> Result<(), LinkError> {
        (**self).send(message)
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<L::Receives>, LinkError> {
        (**self).receive(timeout)
    }

    fn is_settled(&self) -> bool {
        (**self).is_settled()
    }
}

/// The leg's end: sends samples, receives commands.
pub trait LegLink: Link<Sends = Sample, Receives = Command> {}
impl<T: Link<Sends = Sample, Receives = Command>> LegLink for T {}

/// The controller's end: receives samples, sends commands.
pub trait ControllerLink: Link<Sends = Command, Receives = Sample> {}
impl<T: Link<Sends = Command, Receives = Sample>> ControllerLink for T {}

/// Why a link that worked no longer does.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The peer's process ended without taking its leave (killed, or crashed).
    #[error("the {role} (process {pid}) died; start it again with `{}`", role.start_hint())]
    PeerDied {
        /// Who died.
        role: Role,
        /// Its process.
        pid: u32,
    },
    /// The peer closed its end.
    #[error("the {role} (process {pid}) left before the run was over; its own output says why")]
    PeerLeft {
        /// Who left.
        role: Role,
        /// Its process.
        pid: u32,
    },
    /// This process was told to stop, by a signal.
    #[error("stopped by a signal")]
    Stopped,
    /// The transport failed.
    #[error("cannot {action}: {cause}")]
    Transport {
        /// What was being done.
        action: &'static str,
        /// What the transport says.
        cause: String,
    },
}
