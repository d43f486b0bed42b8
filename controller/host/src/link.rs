//! What a leg and its controller see of each other: one trait, any transport.

use std::time::Duration;

use super::card::Role;
use leg_control::wire::{Command, Sample};

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
    /// The peer is gone, and its role has been taken by another before that was seen.
    #[error("the {role} (process {pid}) is gone, and process {by} has taken its place")]
    PeerReplaced {
        /// Whose role.
        role: Role,
        /// The process that is gone.
        pid: u32,
        /// The one that has come.
        by: u32,
    },
    /// The peer is gone, and none has come in its place.
    #[error(
        "{cause}; none has come for {:.1} s, --timeout sets the patience",
        *waited_ms as f64 * 1e-3
    )]
    NotBack {
        /// How it went.
        cause: Box<LinkError>,
        /// For how long another was waited for, ms.
        waited_ms: u64,
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

impl LinkError {
    /// The process of the peer that is gone, if that is what happened.
    #[must_use]
    pub fn lost(&self) -> Option<u32> {
        match self {
            Self::PeerDied { pid, .. }
            | Self::PeerLeft { pid, .. }
            | Self::PeerReplaced { pid, .. } => Some(*pid),
            Self::NotBack { .. } | Self::Stopped | Self::Transport { .. } => None,
        }
    }
}
