//! Links between two processes, over iceoryx2 shared memory.
//!
//! One publish-subscribe service each way: one publisher, buffer 1, no
//! history, safe overflow, so that the newest message wins and nobody waits
//! for a slow reader. Further subscribers (a recorder, a live view) may listen.
//!
//! A receiver polls: in lock-step the peer answers within microseconds, and
//! any blocking wait of the system costs thirty to forty. Of a slow peer it
//! learns to yield the core, and after a millisecond it sleeps.

mod error;
mod service;

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::identifiers::{UniqueNodeId, UniquePublisherId};
use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    CallbackProgression, LogLevel, Node, NodeName, PortFactory as _, PortName, SignalHandlingMode,
    ipc, set_log_level_from_env_or,
};

use super::card::{self, Card, Held, Presence, Refusal, Role, Terms};
use super::domain::Domain;
use super::link::{Link, LinkError};
use super::payload::Message;
use super::stop::Stop;
use super::wait::Waiter;
use crate::wire::{Command, Sample};

pub use error::{ConnectError, Missing};
pub use service::config;
use service::{Service, service, settle};

/// Between two looks for a peer that has not come yet.
const LOOK: Duration = Duration::from_millis(1);
/// A refused process stays this long, so that its peer reads its card and can say why too.
const LINGER: Duration = Duration::from_millis(100);

/// Who this end is connected to: that process and no other, for its successor
/// knows nothing of the run.
#[derive(Clone, Copy, Debug, Default)]
struct Peer {
    pid: u32,
    leg: Option<u32>,
    publisher: Option<UniquePublisherId>,
}

/// One end of a link, between processes.
///
/// Fields are dropped in this order: ports before services, services before
/// the node, the role after all of them, the domain last.
#[derive(Debug)]
pub struct ShmLink<Out: Message, In: Message> {
    publisher: Publisher<ipc::Service, Out, ()>,
    subscriber: Subscriber<ipc::Service, In, ()>,
    outgoing: Service<Out>,
    incoming: Service<In>,
    node: Node<ipc::Service>,
    role: Held,
    domain: Arc<Domain>,
    terms: Terms,
    peer: Peer,
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
        Self::open(domain, terms, stop)?.wait_for_peer(timeout, watch)
    }

    /// Takes the role and makes the ports.
    fn open(domain: &Arc<Domain>, terms: Terms, stop: &Stop) -> Result<Self, ConnectError> {
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
        let node = NodeBuilder::new()
            .config(&config(domain).map_err(|cause| failed(domain, "name the services", &cause))?)
            .name(
                &NodeName::new(Out::SENDER.as_str())
                    .map_err(|e| failed(domain, "name the node", &e))?,
            )
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|cause| failed(domain, "start iceoryx2", &cause))?;
        // Of a predecessor in this role, killed with its ports open.
        node.try_cleanup_dead_nodes();

        let outgoing = service::<Out>(&node, domain, terms)?;
        let incoming = service::<In>(&node, domain, terms)?;
        let name = PortName::new(Out::SENDER.as_str())
            .map_err(|e| failed(domain, "name the ports", &e))?;
        let subscriber = incoming
            .subscriber_builder()
            .name(&name)
            .buffer_size(1)
            .create()
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
            outgoing,
            incoming,
            node,
            role,
            domain: Arc::clone(domain),
            terms,
            peer: Peer::default(),
            stop: stop.clone(),
            waiter: Waiter::new(),
        })
    }

    fn wait_for_peer(
        mut self,
        timeout: Duration,
        mut watch: impl FnMut(&Missing) -> bool,
    ) -> Result<Self, ConnectError> {
        let start = Instant::now();
        loop {
            if let Some(card) = Self::agree(&self.domain, self.terms)? {
                if self.peer.pid != card.pid {
                    self.meet(&card)?;
                }
                // Both ways, so that neither begins with a peer that is not there yet.
                if self.peer.pid == card.pid && card.met == Some(std::process::id()) {
                    return Ok(self);
                }
            }
            if self.stop.is_raised() {
                return Err(ConnectError::Stopped(In::SENDER));
            }
            let waited = start.elapsed();
            let missing = Missing {
                peer: In::SENDER,
                domain: self.domain.name().to_owned(),
                waited,
                rate_hz: self.terms.rate_hz,
                gravity_m_s2: self.terms.gravity_m_s2,
                pace: self.terms.pace,
            };
            if waited >= timeout || !watch(&missing) {
                return Err(ConnectError::PeerMissing(missing));
            }
            std::thread::sleep(LOOK.min(timeout.saturating_sub(waited)));
        }
    }

    /// Gets ready to hear the process with this card, if it has its ports, and says so.
    fn meet(&mut self, &Card { pid, terms, .. }: &Card) -> Result<(), ConnectError> {
        // A publisher is mapped only by a look at its queue. Look now: what a peer sends
        // before it is mapped is lost if it leaves before the first receive.
        if let Some(peer) = self.ports_of(pid)
            && self.subscriber.has_samples().is_ok()
        {
            self.role.meet(pid).map_err(|e| failed(&self.domain, "write the role's card", &e))?;
            self.peer = Peer { leg: terms.leg, ..peer };
        }
        Ok(())
    }

    /// The peer's card, if it is there; an error if it does not fit.
    fn agree(domain: &Arc<Domain>, ours: Terms) -> Result<Option<Card>, ConnectError> {
        let seen = card::presence(domain, In::SENDER)
            .map_err(|cause| failed(domain, "look for the peer", &cause))?;
        let Presence::Alive(Some(card)) = seen else {
            return Ok(None);
        };
        let refusal = disagreement(In::SENDER, card.terms, ours);
        if refusal.is_some() {
            std::thread::sleep(LINGER);
        }
        refusal.map_or(Ok(Some(card)), Err)
    }

    /// The peer, once both its ports are there. (A killed predecessor's may be, too.)
    fn ports_of(&self, pid: u32) -> Option<Peer> {
        let is_peer = |node: UniqueNodeId| {
            node.pid::<ipc::Service>().is_ok_and(|id| u32::try_from(id.value()) == Ok(pid))
        };
        let mut reads = false;
        self.outgoing.dynamic_config().list_subscribers(|port| {
            reads |= port.subscriber_name == In::SENDER.as_str() && is_peer(port.node_id);
            CallbackProgression::Continue
        });
        let mut publisher = None;
        self.incoming.dynamic_config().list_publishers(|port| {
            if is_peer(port.node_id) {
                publisher = Some(port.publisher_id);
            }
            CallbackProgression::Continue
        });
        (reads && publisher.is_some()).then_some(Peer { pid, leg: None, publisher })
    }

    /// The peer's process.
    #[must_use]
    pub fn peer_pid(&self) -> u32 {
        self.peer.pid
    }

    /// The leg that the peer plays, or has a policy for, as
    /// [`fingerprint`](crate::leg::LegModel::fingerprint) has it; `None` when it
    /// does not say.
    #[must_use]
    pub fn peer_leg(&self) -> Option<u32> {
        self.peer.leg
    }

    /// Off the control path: whether the peer this end is connected to is still there.
    ///
    /// # Errors
    /// [`LinkError`] when it is not, or this process was told to stop.
    pub fn check_peer(&self) -> Result<(), LinkError> {
        if self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        let (role, pid) = (In::SENDER, self.peer.pid);
        let seen = card::presence(&self.domain, role)
            .map_err(|cause| broken("look whether the peer lives", &cause))?;
        match seen {
            Presence::Alive(Some(card)) if card.pid == pid => Ok(()),
            Presence::Absent => Err(LinkError::PeerLeft { role, pid }),
            // Dead, or so long dead that another has taken its place.
            Presence::Dead | Presence::Alive(_) => {
                self.node.try_cleanup_dead_nodes();
                Err(LinkError::PeerDied { role, pid })
            }
        }
    }

    fn poll(&self) -> Result<Option<In>, LinkError> {
        match self.subscriber.receive() {
            Ok(None) => Ok(None),
            Ok(Some(message)) if Some(message.origin()) == self.peer.publisher => {
                Ok(Some(*message))
            }
            // The peer's successor: what it says is not about this run.
            Ok(Some(_)) => self.check_peer().map(|()| None),
            // A peer that dies while it connects shows as a failure here.
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
        if self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        match self.publisher.send_copy(*message) {
            Ok(_) => Ok(()),
            Err(cause) => {
                self.check_peer()?;
                Err(broken("send", &cause))
            }
        }
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        self.waiter.wait_for(
            timeout,
            || self.poll(),
            || match self.check_peer() {
                // What it sent last still counts, also when it is gone by now.
                Err(LinkError::PeerLeft { .. }) if self.subscriber.has_samples() == Ok(true) => {
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
