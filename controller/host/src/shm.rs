//! Links between two processes, over iceoryx2 shared memory.
//!
//! One publish-subscribe service each way: one publisher, buffer 1, no
//! history, safe overflow, so that the newest message wins and nobody waits
//! for a slow reader. Further subscribers (a recorder, a live view) may listen.
//!
//! A receiver polls: in lock-step the peer answers within microseconds, and
//! any blocking wait of the system costs thirty to forty. Of a slow peer it
//! learns to yield the core, and after a millisecond it sleeps.
//!
//! The peer may go and another come, while the link stays: its [`Keeper`]
//! looks after that. Sending, and receiving without a wait, only look at the
//! queues; what a port that comes or goes has to be mapped or given back,
//! iceoryx2 does there and then, once.

mod error;
mod keeper;
mod observer;
mod service;

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    LogLevel, NodeName, PortName, SignalHandlingMode, ipc, set_log_level_from_env_or,
};

use super::card::{self, Pace, Presence, Refusal, Role, Terms};
use super::domain::{Domain, other_users};
use super::link::{Link, LinkError};
use super::wait::Waiter;
use crate::payload::{Message, Shared};
use leg_control::wire::{Command, Sample};
use leg_process::signals::Stop;

pub use error::{ConnectError, Missing};
use keeper::Base;
pub use keeper::{Keeper, Peer, Turn};
pub use observer::{Observer, Players};
pub use service::config;
use service::{service, settle};

/// Between two looks for a peer that has not come yet.
const LOOK: Duration = Duration::from_millis(1);
/// A refused process stays this long, so that its peer reads its card and can say why too.
const LINGER: Duration = Duration::from_millis(100);

/// One end of a link, between processes.
///
/// Ports are dropped first, then what they stand on.
#[derive(Debug)]
pub struct ShmLink<Out: Message, In: Message> {
    publisher: Publisher<ipc::Service, Shared<Out>, ()>,
    subscriber: Subscriber<ipc::Service, Shared<In>, ()>,
    base: Arc<Base<Out, In>>,
    /// In real time nobody waits for a port that is in trouble: it is passed over.
    is_real_time: bool,
    stop: Stop,
    waiter: Waiter,
}

/// The leg's end.
pub type ShmLeg = ShmLink<Sample, Command>;
/// The controller's end.
pub type ShmController = ShmLink<Command, Sample>;

impl<Out: Message, In: Message> ShmLink<Out, In> {
    /// Takes this end's role in `domain` and waits, at most for `timeout`, for
    /// the peer.
    ///
    /// # Errors
    /// [`ConnectError`] when the role is taken, the peer does not come or does
    /// not fit, or the transport fails.
    pub fn connect(
        domain: &Arc<Domain>,
        terms: Terms,
        timeout: Duration,
        stop: &Stop,
    ) -> Result<Self, ConnectError> {
        Self::connect_watching(domain, terms, timeout, stop, |_| true)
    }

    /// As [`ShmLink::connect`]; while it waits it shows `watch`, every few
    /// milliseconds, what is missing, and gives up when that says `false`.
    ///
    /// # Errors
    /// As [`ShmLink::connect`].
    pub fn connect_watching(
        domain: &Arc<Domain>,
        terms: Terms,
        timeout: Duration,
        stop: &Stop,
        watch: impl FnMut(&Missing) -> bool,
    ) -> Result<Self, ConnectError> {
        let mut link = Self::open(domain, terms, stop)?;
        link.wait_for_peer(Some(timeout), watch)?;
        Ok(link)
    }

    /// Takes this end's role in `domain` and makes its ports; the peer need not
    /// be there.
    ///
    /// # Errors
    /// [`ConnectError`] when the role is taken, the peer is there and does not
    /// fit, or the transport fails.
    pub fn open(domain: &Arc<Domain>, terms: Terms, stop: &Stop) -> Result<Self, ConnectError> {
        let role = card::take(domain, Out::SENDER, terms).map_err(|refusal| match refusal {
            Refusal::Taken(pid) => {
                ConnectError::RoleTaken { role: Out::SENDER, pid, domain: domain.name().to_owned() }
            }
            Refusal::Io(cause) => failed(domain, "take the role", &cause),
        })?;
        // Before touching a service: the reason is clearer from the card.
        Self::agree(domain, terms)?;

        // iceoryx2 writes to stderr what it returns as an error anyway.
        set_log_level_from_env_or(LogLevel::Fatal);
        let node_name =
            NodeName::new(Out::SENDER.as_str()).map_err(|e| failed(domain, "name the node", &e))?;
        let config = config(domain).map_err(|cause| failed(domain, "name the services", &cause))?;
        let node = settle(|| {
            NodeBuilder::new()
                .config(&config)
                .name(&node_name)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>()
        })
        .map_err(|cause| failed(domain, "start iceoryx2", &cause))?;
        // Of a predecessor in this role, killed with its ports open.
        node.try_cleanup_dead_nodes();

        let outgoing = service::<Out>(&node, domain, terms)?;
        let incoming = service::<In>(&node, domain, terms)?;
        let name = PortName::new(Out::SENDER.as_str())
            .map_err(|e| failed(domain, "name the ports", &e))?;
        let subscriber =
            settle(|| incoming.subscriber_builder().name(&name).buffer_size(1).create())
                .map_err(|cause| failed(domain, "subscribe", &cause))?;
        let publisher = settle(|| {
            let made = outgoing.publisher_builder().name(&name).create();
            if let Err(PublisherCreateError::ExceedsMaxSupportedPublishers) = made {
                node.try_cleanup_dead_nodes();
            }
            made
        })
        .map_err(|cause| failed(domain, "publish", &cause))?;

        Ok(Self {
            publisher,
            subscriber,
            base: Arc::new(Base::new((outgoing, incoming), node, role, terms, domain)),
            is_real_time: terms.pace == Some(Pace::RealTime),
            stop: stop.clone(),
            waiter: Waiter::new(),
        })
    }

    /// Waits for a peer, at most for `timeout`: the first, or the next after
    /// one is lost. Every few milliseconds `watch` is shown what is missing;
    /// when that says `false`, the wait is over.
    ///
    /// # Errors
    /// [`ConnectError`] when none comes or one does not fit, when this process
    /// is told to stop, or the transport fails. The link may wait again.
    pub fn wait_for_peer(
        &mut self,
        timeout: Option<Duration>,
        mut watch: impl FnMut(&Missing) -> bool,
    ) -> Result<Peer, ConnectError> {
        let start = Instant::now();
        let Terms { rate_hz, gravity_m_s2, pace, .. } = self.base.terms();
        let mut missing = Missing {
            peer: In::SENDER,
            domain: self.base.domain().name().to_owned(),
            waited: Duration::ZERO,
            rate_hz,
            gravity_m_s2,
            pace,
            other_users: other_users(),
        };
        loop {
            match self.look()? {
                Some(Turn::Met(peer)) => return Ok(peer),
                Some(Turn::Refused(cause)) => {
                    std::thread::sleep(LINGER);
                    return Err(cause);
                }
                Some(Turn::Lost(_)) | None => (),
            }
            if let Some(peer) = self.base.peer() {
                return Ok(peer);
            }
            if self.stop.is_raised() {
                return Err(ConnectError::Stopped(In::SENDER));
            }
            missing.waited = start.elapsed();
            let left = timeout.map_or(LOOK, |timeout| timeout.saturating_sub(missing.waited));
            if left.is_zero() || !watch(&missing) {
                return Err(ConnectError::PeerMissing(missing));
            }
            std::thread::sleep(LOOK.min(left));
        }
    }

    /// The peer's card, if it is there; an error if it does not fit.
    fn agree(domain: &Arc<Domain>, ours: Terms) -> Result<(), ConnectError> {
        let seen = card::presence(domain, In::SENDER)
            .map_err(|cause| failed(domain, "look for the peer", &cause))?;
        if let Presence::Alive(Some(card)) = seen
            && let Some(refusal) = disagreement(In::SENDER, card.terms, ours)
        {
            std::thread::sleep(LINGER);
            return Err(refusal);
        }
        Ok(())
    }

    /// Who looks after the other end, from another thread.
    #[must_use]
    pub fn keeper(&self) -> Keeper<Out, In> {
        Keeper(Arc::clone(&self.base))
    }

    /// The peer that has been met and not been lost.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.base.peer()
    }

    /// The leg that the peer plays, or has a policy for, as
    /// [`fingerprint`](leg_control::leg::LegModel::fingerprint) has it; `None` when it
    /// does not say.
    #[must_use]
    pub fn peer_leg(&self) -> Option<u32> {
        self.base.peer().and_then(|peer| peer.leg)
    }

    fn look(&self) -> Result<Option<Turn>, ConnectError> {
        // A publisher is mapped only by a look at its queue. Look now: what a peer sends
        // before it is mapped is lost if it leaves before the first receive.
        self.base.look(|| self.subscriber.has_samples().is_ok())
    }

    /// Off the control path: whether a peer is there, the one that was met last
    /// or one that has come in its place since it was lost.
    ///
    /// # Errors
    /// [`LinkError`] when it is not, or this process was told to stop.
    pub fn check_peer(&self) -> Result<(), LinkError> {
        if self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        if self.base.peer().is_some() {
            self.look().map_err(|cause| broken("look whether the peer lives", &cause))?;
        }
        self.base.lost().map_or(Ok(()), Err)
    }

    fn poll(&self) -> Result<Option<In>, LinkError> {
        match self.subscriber.receive() {
            // A stranger's is not for us: of a peer that was lost, or has not been met.
            Ok(message) => {
                Ok(message.filter(|message| self.base.hears(message.origin())).map(|m| m.0))
            }
            // A peer that dies while it connects shows as a failure here.
            Err(_) if self.is_real_time => Ok(None),
            Err(cause) => {
                self.check_peer()?;
                Err(broken("receive", &cause))
            }
        }
    }
}

impl<Out: Message, In: Message> Link for ShmLink<Out, In> {
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        // Here, because a peer that always answers at once leaves no idle moment to look.
        // (A loop in real time looks by itself, and has a farewell to say after that.)
        if !self.is_real_time && self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        match self.publisher.send_copy(Shared(*message)) {
            Ok(_) => Ok(()),
            // As if it were lost on the way: there is the next.
            Err(_) if self.is_real_time => Ok(()),
            Err(cause) => {
                self.check_peer()?;
                Err(broken("send", &cause))
            }
        }
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        if timeout.is_zero() {
            return self.poll();
        }
        self.waiter.wait_for(
            timeout,
            || self.poll(),
            || match self.check_peer() {
                // What it sent last still counts, also when it is gone by now.
                Err(LinkError::PeerLeft { .. } | LinkError::PeerReplaced { .. })
                    if self.subscriber.has_samples() == Ok(true) =>
                {
                    Ok(())
                }
                verdict => verdict,
            },
        )
    }
}

/// The first point on which the two sides differ.
fn disagreement(peer: Role, theirs: Terms, ours: Terms) -> Option<ConnectError> {
    if theirs.wire_version != ours.wire_version {
        let (theirs, ours) = (theirs.wire_version, ours.wire_version);
        Some(ConnectError::WireVersion { peer, theirs, ours })
    } else if theirs.rate_hz != ours.rate_hz {
        let (theirs, ours) = (theirs.rate_hz, ours.rate_hz);
        Some(ConnectError::Rate { peer, theirs, ours })
    } else if theirs.gravity_m_s2.to_bits() != ours.gravity_m_s2.to_bits() {
        let (theirs, ours) = (theirs.gravity_m_s2, ours.gravity_m_s2);
        Some(ConnectError::Gravity { peer, theirs, ours })
    } else if let (Some(theirs), Some(ours)) = (theirs.pace, ours.pace)
        && theirs != ours
    {
        Some(ConnectError::Pace { peer, theirs, ours })
    } else {
        None
    }
}

fn broken(action: &'static str, cause: &dyn Display) -> LinkError {
    LinkError::Transport { action, cause: cause.to_string() }
}

fn failed(domain: &Domain, action: &'static str, cause: &dyn Display) -> ConnectError {
    ConnectError::Transport { action, domain: domain.name().to_owned(), cause: cause.to_string() }
}

#[cfg(test)]
mod tests;
