//! Detects the peer's arrival and loss, and cleans up after a peer that died.
//!
//! All of it reads files and takes locks, so it runs beside the control path: in
//! the idle moments of a waiting link, or on a supervisor's thread. The link itself
//! reads one atomic number that identifies the publisher whose messages it accepts.

use std::fmt;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::prelude::{CallbackProgression, Node, PortFactory as _, PortName, ipc};

use super::error::{ConnectError, disagreement, failed};
use super::payload::Message;
use super::service::Service;
use crate::discovery::{Domain, Presence, RoleFile, RoleLock, RoleRecord, Tenure, presence_in};
use crate::link::{LinkError, Peer, PeerStatus, Role, SessionParams};

/// Longest time that a rejected process keeps its role for its peer to read its record.
const REJECTION_TIMEOUT: Duration = Duration::from_secs(2);

/// Waits until the `rejected` holder of `role` has rejected this process too or is gone,
/// so that both report the reason. A process that leaves before would only be missing.
pub(super) fn await_rejection(domain: &Domain, role: Role, own: Tenure, rejected: Tenure) {
    let deadline = Instant::now() + REJECTION_TIMEOUT;
    while let Ok(Presence::Alive(Some(record))) = presence_in(domain.root(), role)
        && record.tenure == rejected
        && record.rejected != Some(own)
        && Instant::now() < deadline
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Returns the name of the ports of a process: by it they are found, whatever the process
/// id, which is not the same in another container.
pub(super) fn port_name(role: Role, tenure: Tenure) -> Result<PortName, String> {
    PortName::new(&format!("{role}-{tenure}", role = role.as_str())).map_err(|e| e.to_string())
}

/// A change of the peer that an update has detected.
#[derive(Debug)]
pub enum PeerEvent {
    /// A peer is connected: it agrees on the session parameters and receives this
    /// end's messages.
    Connected(Peer),
    /// The peer is gone; its shared memory has been cleaned up.
    Lost(LinkError),
    /// A process holds the peer's role but disagrees on the session parameters.
    /// Reported once for each process.
    Rejected(ConnectError),
}

impl fmt::Display for PeerEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connected(peer) => {
                write!(f, "the {} (process {}) is connected", peer.role, peer.pid)
            }
            Self::Lost(cause) => cause.fmt(f),
            Self::Rejected(cause) => cause.fmt(f),
        }
    }
}

/// Progress of the connection to the peer.
#[derive(Debug)]
enum PeerState {
    /// No process holds the peer's role, or it has not created its ports yet.
    Absent,
    /// This end has found the peer's ports and published so; the peer has not found
    /// this end's ports yet.
    Connecting(Candidate),
    /// Each end receives the other's messages.
    Connected(Candidate),
}

/// A process that holds the peer's role and has ports.
#[derive(Debug)]
struct Candidate {
    peer: Peer,
    tenure: Tenure,
    file: RoleFile,
}

/// The part of the monitor's state that the control path never accesses.
#[derive(Debug)]
struct MonitorState {
    peer: PeerState,
    /// How the last peer was lost, until another is connected.
    lost: Option<LinkError>,
    /// The last rejected process, which has been reported.
    rejected: Option<Tenure>,
    node: Node<ipc::Service>,
    role: RoleLock,
}

/// The services, the node and the role of this end, shared by a link and its
/// monitors.
// Dropped in this order, after the ports: the services before the node, the role after both,
// the domain last.
#[derive(Debug)]
pub(super) struct MonitorCore<Out: Message, In: Message> {
    outgoing: Service<Out>,
    incoming: Service<In>,
    state: Mutex<MonitorState>,
    /// [`key`] of the publisher whose messages are accepted; 0 if none.
    accepted: AtomicU64,
    connections: AtomicU64,
    losses: AtomicU64,
    params: SessionParams,
    domain: Arc<Domain>,
}

/// Folds a publisher's id (time of creation, process and counter) into a number
/// other than 0.
fn key(id: UniquePublisherId) -> u64 {
    let id = id.value();
    ((id >> 64) as u64 ^ id as u64).max(1)
}

impl<Out: Message, In: Message> MonitorCore<Out, In> {
    pub(super) fn new(
        services: (Service<Out>, Service<In>),
        node: Node<ipc::Service>,
        role: RoleLock,
        params: SessionParams,
        domain: &Arc<Domain>,
    ) -> Self {
        let (outgoing, incoming) = services;
        let (peer, lost, rejected) = (PeerState::Absent, None, None);
        Self {
            outgoing,
            incoming,
            state: Mutex::new(MonitorState { peer, lost, rejected, node, role }),
            accepted: AtomicU64::new(0),
            connections: AtomicU64::new(0),
            losses: AtomicU64::new(0),
            params,
            domain: Arc::clone(domain),
        }
    }

    pub(super) fn params(&self) -> SessionParams {
        self.params
    }

    pub(super) fn domain(&self) -> &Arc<Domain> {
        &self.domain
    }

    /// Returns whether messages of `publisher` are accepted. Wait-free.
    pub(super) fn accepts(&self, publisher: UniquePublisherId) -> bool {
        // Relaxed: no other memory is published along with the number.
        self.accepted.load(Ordering::Relaxed) == key(publisher)
    }

    fn state(&self) -> MutexGuard<'_, MonitorState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the connected peer.
    pub(super) fn peer(&self) -> Option<Peer> {
        match &self.state().peer {
            PeerState::Connected(Candidate { peer, .. }) => Some(*peer),
            PeerState::Absent | PeerState::Connecting(_) => None,
        }
    }

    /// Waits until the peer that was rejected last has rejected this process too.
    pub(super) fn await_rejection(&self) {
        let (own, rejected) = {
            let state = self.state();
            (state.role.tenure(), state.rejected)
        };
        if let Some(rejected) = rejected {
            await_rejection(&self.domain, In::SENDER, own, rejected);
        }
    }

    fn record_error(&self, cause: &dyn fmt::Display) -> ConnectError {
        failed(&self.domain, "write the role's record", cause)
    }

    /// Returns how the last peer was lost, until another is connected.
    pub(super) fn lost(&self) -> Option<LinkError> {
        self.state().lost.clone()
    }

    /// Reads the peer's record and advances the connection. Before this end publishes
    /// that it receives the peer's messages, `map_port` must make that true.
    pub(super) fn update(
        &self,
        map_port: impl FnOnce() -> bool,
    ) -> Result<Option<PeerEvent>, ConnectError> {
        let state = &mut *self.state();
        if let PeerState::Connected(connected) = &state.peer {
            let lost = Self::check_connected(connected)
                .map_err(|cause| failed(&self.domain, "check the peer", &cause))?;
            let Some(lost) = lost else { return Ok(None) };
            self.losses.fetch_add(1, Ordering::Relaxed);
            if !matches!(lost, LinkError::PeerLeft { .. }) {
                state.node.try_cleanup_dead_nodes();
            }
            // The peer's last message still counts, so its publisher stays accepted until the
            // next peer's is.
            state.peer = PeerState::Absent;
            state.lost = Some(lost.clone());
            return Ok(Some(PeerEvent::Lost(lost)));
        }
        // Nobody can connect any more without the folder; a connected peer needs it no longer.
        self.domain.check()?;
        self.connect(state, map_port)
    }

    /// Returns how the connected peer was lost, if it was.
    fn check_connected(connected: &Candidate) -> io::Result<Option<LinkError>> {
        let &Candidate { peer: Peer { role, pid, .. }, tenure, .. } = connected;
        Ok(match connected.file.presence()? {
            Presence::Alive(Some(record)) if record.tenure == tenure => None,
            Presence::Absent => Some(LinkError::PeerLeft { role, pid }),
            // A successor has not written its record yet.
            Presence::Alive(None) => None,
            Presence::Alive(Some(record)) => {
                Some(LinkError::PeerReplaced { role, pid, by: record.pid })
            }
            Presence::Dead => Some(LinkError::PeerDied { role, pid }),
        })
    }

    /// Advances the connection to a peer that is present and not connected yet.
    fn connect(
        &self,
        state: &mut MonitorState,
        map_port: impl FnOnce() -> bool,
    ) -> Result<Option<PeerEvent>, ConnectError> {
        let last = std::mem::replace(&mut state.peer, PeerState::Absent);
        let failed = |cause: io::Error| failed(&self.domain, "check for the peer", &cause);
        let file = RoleFile::open(self.domain.root(), In::SENDER).map_err(failed)?;
        let Some(file) = file else { return Ok(None) };
        let Presence::Alive(Some(record)) = file.presence().map_err(failed)? else {
            return Ok(None);
        };
        if let Some(error) = disagreement(In::SENDER, record.params, self.params) {
            if state.rejected.replace(record.tenure) == Some(record.tenure) {
                return Ok(None);
            }
            state
                .role
                .publish_rejection(record.tenure)
                .map_err(|cause| self.record_error(&cause))?;
            return Ok(Some(PeerEvent::Rejected(error)));
        }
        let candidate = match last {
            PeerState::Connecting(candidate) if candidate.tenure == record.tenure => candidate,
            _ if self.accept(state, &record, map_port)? => {
                let peer = Peer { role: In::SENDER, pid: record.pid, leg: record.params.leg };
                Candidate { peer, tenure: record.tenure, file }
            }
            _ => return Ok(None),
        };
        // Both directions must be ready, so that neither end starts without the other.
        if record.connected_to != Some(state.role.tenure()) {
            state.peer = PeerState::Connecting(candidate);
            return Ok(None);
        }
        self.domain.reserve()?;
        let peer = candidate.peer;
        state.peer = PeerState::Connected(candidate);
        (state.lost, state.rejected) = (None, None);
        self.connections.fetch_add(1, Ordering::Relaxed);
        Ok(Some(PeerEvent::Connected(peer)))
    }

    /// Accepts the messages of the process with this record, once it has created its
    /// ports, and publishes so.
    fn accept(
        &self,
        state: &MonitorState,
        record: &RoleRecord,
        map_port: impl FnOnce() -> bool,
    ) -> Result<bool, ConnectError> {
        let name = port_name(In::SENDER, record.tenure)
            .map_err(|cause| failed(&self.domain, "name the ports", &cause))?;
        let Some(publisher) = self.publisher_of(&name).filter(|_| map_port()) else {
            return Ok(false);
        };
        self.accepted.store(key(publisher), Ordering::Relaxed);
        state.role.publish_connection(record.tenure).map_err(|cause| self.record_error(&cause))?;
        Ok(true)
    }

    /// Returns the publisher of the process whose ports have this name, once both exist.
    fn publisher_of(&self, name: &PortName) -> Option<UniquePublisherId> {
        let mut subscribes = false;
        self.outgoing.dynamic_config().list_subscribers(|port| {
            subscribes |= port.subscriber_name == *name;
            CallbackProgression::Continue
        });
        let mut publisher = None;
        self.incoming.dynamic_config().list_publishers(|port| {
            if port.publisher_name == *name {
                publisher = Some(port.publisher_id);
            }
            CallbackProgression::Continue
        });
        publisher.filter(|_| subscribes)
    }
}

/// Monitors the peer of a link whose loop must not block: call
/// [`PeerMonitor::update`] every 10 to 20 ms from another thread.
#[derive(Debug)]
pub struct PeerMonitor<Out: Message, In: Message>(pub(super) Arc<MonitorCore<Out, In>>);

impl<Out: Message, In: Message> Clone for PeerMonitor<Out, In> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<Out: Message, In: Message> PeerMonitor<Out, In> {
    /// Checks the peer, cleans up after one that died, connects to a new one, and
    /// returns the change. A peer that is stopped (SIGSTOP) stays connected.
    ///
    /// # Errors
    /// Returns [`ConnectError`] when the system fails; a later call may succeed.
    pub fn update(&self) -> Result<Option<PeerEvent>, ConnectError> {
        // The loop maps the peer's port by itself, in its next receive.
        self.0.update(|| true)
    }

    /// Returns the connected peer.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.0.peer()
    }

    /// Returns the connected peer's process and how often peers connected and were
    /// lost.
    #[must_use]
    pub fn status(&self) -> PeerStatus {
        PeerStatus {
            pid: self.peer().map(|peer| peer.pid),
            connections: self.0.connections.load(Ordering::Relaxed),
            losses: self.0.losses.load(Ordering::Relaxed),
        }
    }
}
