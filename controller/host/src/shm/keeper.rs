//! Who is at the other end: met, lost, cleaned up after, and met again.
//!
//! All of it reads files and takes locks, so it happens beside the control
//! path: in the idle moments of a link that waits, or on a supervisor's thread.
//! The link itself is told by one atomic number whose messages count.

use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use iceoryx2::identifiers::{UniqueNodeId, UniquePublisherId};
use iceoryx2::prelude::{CallbackProgression, Node, PortFactory as _, ipc};

use super::service::Service;
use super::{ConnectError, disagreement, failed};
use crate::card::{self, Card, Held, Presence, Role, Terms};
use crate::desk::requests::PeerStatus;
use crate::domain::Domain;
use crate::link::LinkError;
use crate::payload::Message;

/// A peer that is there and agrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Its role.
    pub role: Role,
    /// Its process.
    pub pid: u32,
    /// The leg that it plays, or has a policy for, as
    /// [`fingerprint`](leg_control::leg::LegModel::fingerprint) has it; `None` when it
    /// does not say.
    pub leg: Option<u32>,
}

/// What a look at the peer has found to be new.
#[derive(Debug)]
pub enum Turn {
    /// A peer is there, agrees, and hears us.
    Met(Peer),
    /// The peer is gone; what it left in shared memory is cleaned up.
    Lost(LinkError),
    /// A process plays the peer's role that does not fit; said once of each.
    Refused(ConnectError),
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Met(peer) => write!(f, "the {} (process {}) is there", peer.role, peer.pid),
            Self::Lost(cause) => cause.fmt(f),
            Self::Refused(cause) => cause.fmt(f),
        }
    }
}

/// How far we are with the peer.
#[derive(Debug)]
enum Standing {
    /// Nobody is there, or not with its ports.
    Alone,
    /// We have its ports and said so; it has not found ours yet.
    Greeted(Peer),
    /// Both hear each other.
    Met(Peer),
}

/// What the control path never touches.
#[derive(Debug)]
struct Ground {
    standing: Standing,
    /// Of the last peer, until the next is met.
    lost: Option<LinkError>,
    /// The process that does not fit and has been told of.
    refused: Option<u32>,
    node: Node<ipc::Service>,
    role: Held,
}

/// What a link and its keepers share: services, node and role of this end.
///
/// Dropped in this order, after the ports: services before the node, the role
/// after both, the domain last.
#[derive(Debug)]
pub(super) struct Base<Out: Message, In: Message> {
    outgoing: Service<Out>,
    incoming: Service<In>,
    ground: Mutex<Ground>,
    /// [`key`] of the publisher whose messages count.
    heard: AtomicU64,
    /// Peers met, and lost again.
    met: AtomicU64,
    gone: AtomicU64,
    terms: Terms,
    domain: Arc<Domain>,
}

/// Stands for a publisher: its time of birth, process and counter, folded. Never 0.
pub(super) fn key(id: UniquePublisherId) -> u64 {
    let id = id.value();
    ((id >> 64) as u64 ^ id as u64).max(1)
}

impl<Out: Message, In: Message> Base<Out, In> {
    pub(super) fn new(
        services: (Service<Out>, Service<In>),
        node: Node<ipc::Service>,
        role: Held,
        terms: Terms,
        domain: &Arc<Domain>,
    ) -> Self {
        let (outgoing, incoming) = services;
        let (standing, lost, refused) = (Standing::Alone, None, None);
        Self {
            outgoing,
            incoming,
            ground: Mutex::new(Ground { standing, lost, refused, node, role }),
            heard: AtomicU64::new(0),
            met: AtomicU64::new(0),
            gone: AtomicU64::new(0),
            terms,
            domain: Arc::clone(domain),
        }
    }

    pub(super) fn terms(&self) -> Terms {
        self.terms
    }

    pub(super) fn domain(&self) -> &Arc<Domain> {
        &self.domain
    }

    /// Whether this publisher's messages count. Wait-free.
    pub(super) fn hears(&self, publisher: UniquePublisherId) -> bool {
        // Alone, and about nothing else in memory.
        self.heard.load(Ordering::Relaxed) == key(publisher)
    }

    fn ground(&self) -> MutexGuard<'_, Ground> {
        self.ground.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The peer that has been met and not been lost.
    pub(super) fn peer(&self) -> Option<Peer> {
        match self.ground().standing {
            Standing::Met(peer) => Some(peer),
            _ => None,
        }
    }

    /// How the last peer was lost, until the next is met.
    pub(super) fn lost(&self) -> Option<LinkError> {
        self.ground().lost.clone()
    }

    /// One look at the other end. Before a peer is told that we hear it,
    /// `map` has to see to it that we do.
    pub(super) fn look(&self, map: impl FnOnce() -> bool) -> Result<Option<Turn>, ConnectError> {
        let ground = &mut *self.ground();
        let seen = card::presence(&self.domain, In::SENDER)
            .map_err(|cause| failed(&self.domain, "look for the peer", &cause))?;
        match ground.standing {
            Standing::Met(peer) => {
                let lost = Self::check(ground, seen, peer);
                self.gone.fetch_add(u64::from(lost.is_some()), Ordering::Relaxed);
                Ok(lost)
            }
            Standing::Alone | Standing::Greeted(_) => self.approach(ground, seen, map),
        }
    }

    /// Whether the peer that was met is still there.
    fn check(ground: &mut Ground, seen: Presence, peer: Peer) -> Option<Turn> {
        let Peer { role, pid, .. } = peer;
        let lost = match seen {
            Presence::Alive(Some(card)) if card.pid == pid => return None,
            Presence::Absent => LinkError::PeerLeft { role, pid },
            // Another is about to write its card.
            Presence::Alive(None) => return None,
            Presence::Alive(Some(card)) => LinkError::PeerReplaced { role, pid, by: card.pid },
            Presence::Dead => LinkError::PeerDied { role, pid },
        };
        if !matches!(lost, LinkError::PeerLeft { .. }) {
            ground.node.try_cleanup_dead_nodes();
        }
        // What it sent last still counts: the key stays until the next is greeted.
        ground.standing = Standing::Alone;
        ground.lost = Some(lost.clone());
        Some(Turn::Lost(lost))
    }

    /// A step towards a peer that is there and has not been met.
    fn approach(
        &self,
        ground: &mut Ground,
        seen: Presence,
        map: impl FnOnce() -> bool,
    ) -> Result<Option<Turn>, ConnectError> {
        let Presence::Alive(Some(card)) = seen else {
            ground.standing = Standing::Alone;
            return Ok(None);
        };
        if let Some(refusal) = disagreement(In::SENDER, card.terms, self.terms) {
            ground.standing = Standing::Alone;
            let is_new = ground.refused.replace(card.pid) != Some(card.pid);
            return Ok(is_new.then_some(Turn::Refused(refusal)));
        }
        let greeted = match ground.standing {
            Standing::Greeted(peer) if peer.pid == card.pid => Some(peer),
            _ => self.greet(ground, &card, map)?,
        };
        ground.standing = greeted.map_or(Standing::Alone, Standing::Greeted);
        // Both ways, so that neither begins with a peer that is not there yet.
        let Some(peer) = greeted.filter(|_| card.met == Some(std::process::id())) else {
            return Ok(None);
        };
        ground.standing = Standing::Met(peer);
        (ground.lost, ground.refused) = (None, None);
        self.met.fetch_add(1, Ordering::Relaxed);
        Ok(Some(Turn::Met(peer)))
    }

    /// Gets ready to hear the process with this card, if it has its ports, and says so.
    fn greet(
        &self,
        ground: &mut Ground,
        &Card { pid, terms, .. }: &Card,
        map: impl FnOnce() -> bool,
    ) -> Result<Option<Peer>, ConnectError> {
        let Some(publisher) = self.publisher_of(pid).filter(|_| map()) else { return Ok(None) };
        self.heard.store(key(publisher), Ordering::Relaxed);
        let written = ground.role.meet(pid);
        written.map_err(|cause| failed(&self.domain, "write the role's card", &cause))?;
        Ok(Some(Peer { role: In::SENDER, pid, leg: terms.leg }))
    }

    /// What the peer publishes by, once both its ports are there. (A killed
    /// predecessor's may be, too.)
    fn publisher_of(&self, pid: u32) -> Option<UniquePublisherId> {
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
        publisher.filter(|_| reads)
    }
}

/// Looks after the other end of a link whose loop has no time for it: call
/// [`Keeper::look`] every 10 to 20 ms from a thread that has.
#[derive(Debug)]
pub struct Keeper<Out: Message, In: Message>(pub(super) Arc<Base<Out, In>>);

impl<Out: Message, In: Message> Clone for Keeper<Out, In> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<Out: Message, In: Message> Keeper<Out, In> {
    /// Looks at the other end, cleans up after the dead, meets whoever comes;
    /// says what is new. A peer that is stopped is silent, and not gone.
    ///
    /// # Errors
    /// [`ConnectError`] when the system refuses the look; the next may succeed.
    pub fn look(&self) -> Result<Option<Turn>, ConnectError> {
        // The loop maps the peer's port by itself, when it next listens.
        self.0.look(|| true)
    }

    /// The peer that has been met and not been lost.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.0.peer()
    }

    /// The same for a status, with the times that one was met and lost.
    #[must_use]
    pub fn status(&self) -> PeerStatus {
        PeerStatus {
            pid: self.peer().map(|peer| peer.pid),
            met: self.0.met.load(Ordering::Relaxed),
            lost: self.0.gone.load(Ordering::Relaxed),
        }
    }
}
