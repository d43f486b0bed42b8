//! A shared-memory link that waits for another peer after its peer is lost.
//!
//! In lock-step the leg waits for the answer to its sample, so the loss of a
//! controller need not end the run: simulated time stands still until another
//! controller has connected, which then receives the same sample again.

use std::fmt;
use std::time::{Duration, Instant};

use crate::link::{Link, LinkError, Peer, Silence, receive_reporting_silence};
use crate::shm::{ConnectError, Message, MissingPeer, ShmLink};

/// A change of the peer during a run.
#[derive(Debug)]
pub enum LinkEvent {
    /// The peer is gone; the link waits for another.
    Lost {
        /// How the peer was lost.
        cause: LinkError,
        /// How long the link waits for another peer.
        timeout: Duration,
    },
    /// A process took the peer's role but disagrees on the session parameters.
    Rejected(ConnectError),
    /// Another peer is connected, and the run continues.
    Reconnected {
        /// The new peer.
        peer: Peer,
        /// How long the link was without a peer.
        after: Duration,
    },
    /// The peer is alive but sends nothing, or sends again.
    Silence(Silence),
}

impl fmt::Display for LinkEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost { cause, timeout } => {
                write!(
                    f,
                    "{cause}; the run waits for another for up to {} s",
                    timeout.as_secs_f64()
                )
            }
            Self::Rejected(cause) => write!(f, "{cause}; still waiting"),
            Self::Reconnected { peer: Peer { role, pid, .. }, after } => write!(
                f,
                "the {role} is back (process {pid}) after {:.2} s; the run continues",
                after.as_secs_f64()
            ),
            Self::Silence(silence) => silence.fmt(f),
        }
    }
}

/// A shared-memory link that waits for another peer after its peer is lost.
///
/// The last unanswered message is sent again to the new peer. `on_event` is called
/// with each [`LinkEvent`]. While no peer is connected, `keep_waiting` is called every
/// millisecond; the wait ends when it returns false.
#[derive(Debug)]
pub struct ReconnectingLink<Out: Message, In: Message, E, W> {
    link: ShmLink<Out, In>,
    timeout: Duration,
    on_event: E,
    keep_waiting: W,
    unanswered: Option<Out>,
}

impl<Out: Message, In: Message, E, W> ReconnectingLink<Out, In, E, W>
where
    E: FnMut(&LinkEvent),
    W: FnMut(&MissingPeer) -> bool,
{
    /// Wraps `link`; waits up to `timeout` for another peer after each loss.
    pub fn new(link: ShmLink<Out, In>, timeout: Duration, on_event: E, keep_waiting: W) -> Self {
        Self { link, timeout, on_event, keep_waiting, unanswered: None }
    }

    /// Waits for another peer if `cause` is the loss of the last one.
    fn reconnect(&mut self, cause: LinkError) -> Result<(), LinkError> {
        if cause.lost_peer().is_none() {
            return Err(cause);
        }
        let lost = Instant::now();
        (self.on_event)(&LinkEvent::Lost { cause: cause.clone(), timeout: self.timeout });
        loop {
            let left = self.timeout.saturating_sub(lost.elapsed());
            match self.link.wait_for_peer(Some(left), &mut self.keep_waiting) {
                Ok(peer) => {
                    (self.on_event)(&LinkEvent::Reconnected { peer, after: lost.elapsed() });
                    return Ok(());
                }
                // `keep_waiting` has ended the wait.
                Err(ConnectError::PeerMissing(_)) if lost.elapsed() < self.timeout => {
                    return Err(cause);
                }
                Err(ConnectError::PeerMissing(_)) => {
                    return Err(LinkError::ReconnectTimeout {
                        cause: Box::new(cause),
                        waited_ms: lost.elapsed().as_millis() as u64,
                    });
                }
                Err(error) if error.is_disagreement() => {
                    (self.on_event)(&LinkEvent::Rejected(error));
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn send_unanswered(&mut self) -> Result<(), LinkError> {
        while let Some(message) = self.unanswered {
            match self.link.send(&message) {
                Ok(()) => break,
                Err(cause) => self.reconnect(cause)?,
            }
        }
        Ok(())
    }
}

impl<Out: Message, In: Message, E, W> Link for ReconnectingLink<Out, In, E, W>
where
    E: FnMut(&LinkEvent),
    W: FnMut(&MissingPeer) -> bool,
{
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        self.unanswered = Some(*message);
        self.send_unanswered()
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        loop {
            let report = |silence: &Silence| (self.on_event)(&LinkEvent::Silence(*silence));
            let (link, role) = (&mut self.link, In::SENDER);
            match receive_reporting_silence(link, role, Some(timeout), report) {
                Ok(message) => {
                    if message.is_some() {
                        self.unanswered = None;
                    }
                    return Ok(message);
                }
                Err(cause) => {
                    self.reconnect(cause)?;
                    self.send_unanswered()?;
                }
            }
        }
    }
}
