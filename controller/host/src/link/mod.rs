//! The link between a leg and its controller, independent of the transport.

mod error;
mod params;
mod peer;
mod silence;
mod wait;

use std::time::Duration;

use leg_control::wire::{Command, Sample};

pub use error::LinkError;
pub use params::{Role, SessionParams, TimeMode};
pub use peer::{Peer, PeerStatus};
pub use silence::{Silence, receive_reporting_silence};
pub(crate) use wait::Waiter;

/// One end of a link between a leg and its controller.
///
/// A link holds at most one message in each direction: a message that has not
/// been received yet is replaced by the next one, so a receiver always gets the
/// newest. Sending never waits for the peer.
///
/// Middleware implements this trait around another link: fault injection,
/// recording, timing.
pub trait Link {
    /// Type of the messages that this end sends.
    type Sends: Copy;
    /// Type of the messages that this end receives.
    type Receives: Copy;

    /// Sends a message. It replaces a message that the peer has not received yet.
    ///
    /// # Errors
    /// Returns [`LinkError`] when the transport fails. The loss of the peer is
    /// reported by [`Link::receive`], not here.
    fn send(&mut self, message: &Self::Sends) -> Result<(), LinkError>;

    /// Receives the newest message. Waits at most `timeout` for one; returns `None`
    /// when none arrived.
    ///
    /// # Errors
    /// Returns [`LinkError`] when the peer is gone and no message of it is left,
    /// when this process was asked to stop, or when the transport fails.
    fn receive(&mut self, timeout: Duration) -> Result<Option<Self::Receives>, LinkError>;

    /// Returns true if no reply to the last message will arrive in this tick,
    /// because middleware dropped or delayed it. A lock-step session then advances
    /// without a reply. Links without such middleware return false.
    fn expects_no_reply(&self) -> bool {
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

    fn expects_no_reply(&self) -> bool {
        (**self).expects_no_reply()
    }
}

/// The leg's end of a link: sends samples and receives commands.
pub trait LegLink: Link<Sends = Sample, Receives = Command> {}
impl<T: Link<Sends = Sample, Receives = Command>> LegLink for T {}

/// The controller's end of a link: receives samples and sends commands.
pub trait ControllerLink: Link<Sends = Command, Receives = Sample> {}
impl<T: Link<Sends = Command, Receives = Sample>> ControllerLink for T {}
