//! A link in lock-step whose peer may go and come back.
//!
//! In lock-step the leg waits for an answer to its sample, so a controller that
//! dies need not be the end of the run: time stands still until another has
//! come, which is asked the same tick again.

use std::fmt;
use std::time::{Duration, Instant};

use super::card::Role;
use super::link::{Link, LinkError};
use super::payload::Message;
use super::shm::{ConnectError, Missing, Peer, ShmLink};

/// A peer that is silent for so long is worth a word.
const SAY_AFTER: Duration = Duration::from_secs(1);

/// What happens to the peer while a run goes on.
#[derive(Debug)]
pub enum Notice {
    /// It is gone; another is waited for.
    Lost {
        /// How.
        cause: LinkError,
        /// For how long another is waited for.
        patience: Duration,
    },
    /// A process has come that does not fit.
    Refused(ConnectError),
    /// One is there again, and the run goes on.
    Back {
        /// Who.
        peer: Peer,
        /// After so long.
        after: Duration,
    },
    /// It lives and says nothing.
    Silent {
        /// Who.
        role: Role,
        /// For so long, until now.
        waited: Duration,
        /// At most for so long.
        patience: Duration,
    },
    /// It speaks again.
    Heard {
        /// Who.
        role: Role,
        /// After so long.
        after: Duration,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost { cause, patience } => {
                write!(f, "{cause}; the run waits for up to {} s", patience.as_secs_f64())
            }
            Self::Refused(cause) => write!(f, "{cause}; still waiting"),
            Self::Back { peer: Peer { role, pid, .. }, after } => write!(
                f,
                "the {role} is back (process {pid}) after {:.2} s; the run goes on",
                after.as_secs_f64()
            ),
            Self::Silent { role, waited, patience } => write!(
                f,
                "the {role} lives but has said nothing for {:.0} s; is it stopped? The run waits \
                 for up to {} s",
                waited.as_secs_f64(),
                patience.as_secs_f64()
            ),
            Self::Heard { role, after } => {
                write!(f, "the {role} answers again, after {:.2} s", after.as_secs_f64())
            }
        }
    }
}

/// A link that waits for its peer to come back.
///
/// A message that was sent and not answered is sent again to whoever comes.
/// `tell` hears what happens; while a peer is missing, `wanted` is asked every
/// few milliseconds whether to wait on.
#[derive(Debug)]
pub struct Patient<Out: Message, In: Message, T, W> {
    link: ShmLink<Out, In>,
    patience: Duration,
    tell: T,
    wanted: W,
    unanswered: Option<Out>,
}

impl<Out: Message, In: Message, T, W> Patient<Out, In, T, W>
where
    T: FnMut(&Notice),
    W: FnMut(&Missing) -> bool,
{
    /// Waits up to `patience` for each peer that is lost.
    pub fn new(link: ShmLink<Out, In>, patience: Duration, tell: T, wanted: W) -> Self {
        Self { link, patience, tell, wanted, unanswered: None }
    }

    /// After the peer was lost: until the next is there.
    fn wait_for_next(&mut self, cause: LinkError) -> Result<(), LinkError> {
        if cause.lost().is_none() {
            return Err(cause);
        }
        let lost = Instant::now();
        (self.tell)(&Notice::Lost { cause: cause.clone(), patience: self.patience });
        loop {
            let left = self.patience.saturating_sub(lost.elapsed());
            match self.link.wait_for_peer(Some(left), &mut self.wanted) {
                Ok(peer) => {
                    (self.tell)(&Notice::Back { peer, after: lost.elapsed() });
                    return Ok(());
                }
                Err(ConnectError::Stopped(_)) => return Err(LinkError::Stopped),
                // Not wanted any more.
                Err(ConnectError::PeerMissing(_)) if lost.elapsed() < self.patience => {
                    return Err(cause);
                }
                Err(ConnectError::PeerMissing(_)) => {
                    return Err(LinkError::NotBack {
                        cause: Box::new(cause),
                        waited_ms: lost.elapsed().as_millis() as u64,
                    });
                }
                Err(ConnectError::Transport { action, cause, .. }) => {
                    return Err(LinkError::Transport { action, cause });
                }
                Err(misfit) => (self.tell)(&Notice::Refused(misfit)),
            }
        }
    }

    fn send_unanswered(&mut self) -> Result<(), LinkError> {
        while let Some(message) = self.unanswered {
            match self.link.send(&message) {
                Ok(()) => break,
                Err(cause) => self.wait_for_next(cause)?,
            }
        }
        Ok(())
    }
}

impl<Out: Message, In: Message, T, W> Link for Patient<Out, In, T, W>
where
    T: FnMut(&Notice),
    W: FnMut(&Missing) -> bool,
{
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        self.unanswered = Some(*message);
        self.send_unanswered()
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        let role = In::SENDER;
        // The clock is looked at when the first wait is over: most answers come at once.
        let mut begun: Option<Instant> = None;
        let mut wait = timeout.min(SAY_AFTER);
        loop {
            match self.link.receive(wait) {
                Ok(Some(message)) => {
                    if let Some(begun) = begun {
                        (self.tell)(&Notice::Heard { role, after: begun.elapsed() });
                    }
                    self.unanswered = None;
                    return Ok(Some(message));
                }
                Ok(None) => {
                    let is_first = begun.is_none();
                    let now = Instant::now();
                    let begun = *begun.get_or_insert(now.checked_sub(wait).unwrap_or(now));
                    let waited = begun.elapsed();
                    if waited >= timeout {
                        return Ok(None);
                    }
                    if is_first {
                        (self.tell)(&Notice::Silent { role, waited, patience: timeout });
                    }
                    wait = timeout.saturating_sub(waited);
                }
                Err(cause) => {
                    self.wait_for_next(cause)?;
                    self.send_unanswered()?;
                    (begun, wait) = (None, timeout.min(SAY_AFTER));
                }
            }
        }
    }
}
