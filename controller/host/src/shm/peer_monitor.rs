//! Detects the peer's arrival and loss, and creates the shared memory of each session.
//!
//! All of it makes system calls, so it runs beside the control path: in the idle moments of
//! a waiting link, or on a supervisor's thread. The link itself reads one flag, which is set
//! when the ports of another session are ready.

use std::error::Error;
use std::fmt::Display;
use std::fs;
use std::io::ErrorKind;
use std::os::unix::net::UnixListener;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::error::{ConnectError, Half, disagreement, failed};
use super::hello::{Channel, Hello, Line, SESSION_VERSION, SOCKET};
use super::payload::Message;
use super::recorder::wait_for_recorders;
use super::service::Ports;
use crate::discovery::{Domain, DomainError, RoleLock, Session, holder};
use crate::link::{LinkError, Peer, PeerStatus, Role, SessionParams};
use crate::socket::{SocketFile, connect};

/// Time after which the same rejection or failure is reported again.
const REPEAT_AFTER: Duration = Duration::from_secs(1);

/// Connections that one update takes from the queue of the socket, at most.
const QUEUE: u32 = 256;

/// A change of the peer that an update has detected.
#[derive(Debug)]
pub enum PeerEvent {
    /// A peer is connected: it agrees on the session parameters and receives this
    /// end's messages.
    Connected(Peer),
    /// The peer is gone.
    Lost(LinkError),
    /// A process has connected but disagrees on the session parameters. Reported once for
    /// each process.
    Rejected(ConnectError),
    /// A connection failed, for example because the peer ended meanwhile or memory ran out;
    /// the next updates try again.
    Failed(ConnectError),
}

/// What is known about the peer.
#[derive(Debug)]
enum PeerState<Out: Message, In: Message> {
    Absent,
    /// A process has connected; its hello is awaited.
    Greeted(Channel),
    /// Both ends agree; that the peer is ready is awaited.
    Preparing(Channel, Peer, Session, Ports<Out, In>),
    Connected(Channel, Peer),
    /// The peer disagrees. It is kept until it leaves, so that it is reported once.
    Rejected(Channel),
}

/// The part of the monitor's state that the control path never accesses.
#[derive(Debug)]
struct MonitorState<Out: Message, In: Message> {
    peer: PeerState<Out, In>,
    /// How the last peer was lost, until another is connected.
    lost: Option<LinkError>,
    /// The last rejection or failure, and when it was reported.
    reported: Option<(String, Instant)>,
}

/// Monitors the peer of a link: for a link whose loop must not block, call
/// [`PeerMonitor::update`] every 10 to 20 ms from another thread.
// Dropped in this order: the peer receives that this end leaves, then the role is free, the
// domain last.
#[derive(Debug)]
pub struct PeerMonitor<Out: Message, In: Message> {
    state: Mutex<MonitorState<Out, In>>,
    /// The ports of a session that the link has not taken yet, or of the one before.
    ports: Mutex<Option<Ports<Out, In>>>,
    /// Whether `ports` are those of a new session.
    has_new_ports: AtomicBool,
    connections: AtomicU64,
    losses: AtomicU64,
    params: SessionParams,
    /// Where the controller listens; `None` at the leg's end, which connects.
    listener: Option<(SocketFile, UnixListener)>,
    _role: RoleLock,
    domain: Arc<Domain>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<Out: Message, In: Message> PeerMonitor<Out, In> {
    /// Acquires this end's role and, as a controller, listens for legs.
    pub(super) fn open(domain: &Arc<Domain>, params: SessionParams) -> Result<Self, ConnectError> {
        let own = Out::SENDER;
        let io = |cause| failed(domain, "acquire the role", &cause);
        let Some(role) = RoleLock::acquire(domain, own).map_err(io)? else {
            let pid = holder(domain.root(), own).map_err(io)?.and_then(|holder| holder.pid);
            return Err(ConnectError::RoleTaken { role: own, pid, domain: domain.name().into() });
        };
        let listen = || {
            let path = domain.root().join(SOCKET);
            // This process has the role, so whatever is there is a predecessor's.
            let _ = fs::remove_file(&path);
            let (file, listener) = SocketFile::bind(&path)?;
            listener.set_nonblocking(true)?;
            Ok::<_, Box<dyn Error>>((file, listener))
        };
        let listener = (own == Role::Controller)
            .then(listen)
            .transpose()
            .map_err(|cause| failed(domain, "listen for a leg", &cause))?;
        Ok(Self {
            state: Mutex::new(MonitorState { peer: PeerState::Absent, lost: None, reported: None }),
            ports: Mutex::new(None),
            has_new_ports: AtomicBool::new(false),
            connections: AtomicU64::new(0),
            losses: AtomicU64::new(0),
            params,
            listener,
            _role: role,
            domain: Arc::clone(domain),
        })
    }

    pub(super) fn params(&self) -> SessionParams {
        self.params
    }

    pub(super) fn domain(&self) -> &Arc<Domain> {
        &self.domain
    }

    /// Returns the connected peer.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        match &lock(&self.state).peer {
            PeerState::Connected(_, peer) => Some(*peer),
            _ => None,
        }
    }

    /// Returns whether a process has connected that was rejected.
    pub(super) fn is_rejecting(&self) -> bool {
        matches!(lock(&self.state).peer, PeerState::Rejected(_))
    }

    /// Returns the connected peer's process and how often peers connected and were
    /// lost.
    #[must_use]
    pub fn status(&self) -> PeerStatus {
        PeerStatus {
            pid: self.peer().map(|peer| peer.pid),
            connections: self.connections.load(Ordering::Relaxed),
            losses: self.losses.load(Ordering::Relaxed),
        }
    }

    /// Returns how the last peer was lost, until another is connected.
    pub(super) fn lost(&self) -> Option<LinkError> {
        lock(&self.state).lost.clone()
    }

    /// Exchanges `ports` for those of a new session, if there is one. Never waits, and
    /// neither allocates nor frees.
    pub(super) fn take_ports(&self, ports: &mut Option<Ports<Out, In>>) {
        if self.has_new_ports.load(Ordering::Relaxed)
            && let Ok(mut new) = self.ports.try_lock()
        {
            std::mem::swap(ports, &mut *new);
            self.has_new_ports.store(false, Ordering::Relaxed);
        }
    }

    /// Checks the peer, connects to a new one after a loss, and returns the change. A peer
    /// that is stopped (SIGSTOP) stays connected.
    ///
    /// # Errors
    /// Returns [`DomainError::Removed`] when no peer is connected and none can connect any more.
    pub fn update(&self) -> Result<Option<PeerEvent>, DomainError> {
        let mut state = lock(&self.state);
        if let Some(channel) = self.call(&state.peer)? {
            state.peer = PeerState::Greeted(channel);
        }
        let step = match std::mem::replace(&mut state.peer, PeerState::Absent) {
            PeerState::Greeted(channel) => self.greet(channel),
            PeerState::Preparing(channel, peer, session, ports) => {
                self.prepare(channel, peer, session, ports)
            }
            PeerState::Connected(channel, peer) => Ok(self.watch(channel, peer)),
            PeerState::Rejected(mut channel) => match channel.next() {
                Ok(None) => Ok((PeerState::Rejected(channel), None)),
                _ => Ok((PeerState::Absent, None)),
            },
            PeerState::Absent => Ok((PeerState::Absent, None)),
        };
        let (next, event) = step.unwrap_or_else(|cause| {
            // iceoryx2 names no cause that helps if there is no room.
            let cause = self.domain.check_room().map_or_else(ConnectError::from, |()| cause);
            (PeerState::Absent, Some(PeerEvent::Failed(cause)))
        });
        state.peer = next;
        match &event {
            Some(PeerEvent::Connected(_)) => (state.lost, state.reported) = (None, None),
            Some(PeerEvent::Lost(cause)) => state.lost = Some(cause.clone()),
            Some(PeerEvent::Rejected(cause) | PeerEvent::Failed(cause)) => {
                let (text, now) = (cause.to_string(), Instant::now());
                let is_repeated = |(last, at): &(String, Instant)| {
                    *last == text && now.duration_since(*at) < REPEAT_AFTER
                };
                if state.reported.as_ref().is_some_and(is_repeated) {
                    return Ok(None);
                }
                state.reported = Some((text, now));
            }
            None => (),
        }
        Ok(event)
    }

    /// Connects to a controller, or accepts a leg, if there is one.
    fn call(&self, last: &PeerState<Out, In>) -> Result<Option<Channel>, DomainError> {
        // A leg that has the role replaces a process that is silent or was rejected.
        let may_connect = match last {
            PeerState::Absent => true,
            PeerState::Connected(..) => false,
            _ => self.listener.is_some(),
        };
        if !may_connect {
            return Ok(None);
        }
        // Nobody can connect any more without the folder; a connected peer needs it no longer.
        self.domain.check()?;
        let socket = match &self.listener {
            // The newest counts: those before it may be of processes that are gone.
            Some((_, listener)) => (0..QUEUE)
                .map_while(|_| listener.accept().ok())
                .last()
                .map(|(socket, _)| socket)
                .ok_or_else(|| ErrorKind::WouldBlock.into()),
            None => connect(&self.domain.root().join(SOCKET)),
        };
        // Whatever failed, the next update tries again.
        let Ok(channel) = socket.and_then(Channel::new) else { return Ok(None) };
        if self.listener.is_none() {
            channel.send(&Line::Hello(Hello::of(self.params)));
        }
        Ok(Some(channel))
    }

    /// Refuses a session, for a reason that the user of the peer can read.
    fn refuse(&self, channel: &Channel, reason: String) {
        channel.send(&match &self.listener {
            Some(_) => Line::Hello(Hello { refused: Some(reason), ..Hello::of(self.params) }),
            None => Line::Refused(reason),
        });
    }

    /// Refuses a leg that connects while another is connected.
    fn refuse_another(&self, connected: Peer) {
        let next = self.listener.as_ref().and_then(|(_, listener)| listener.accept().ok());
        if let Some(channel) = next.and_then(|(socket, _)| Channel::new(socket).ok()) {
            let Peer { role, pid, .. } = connected;
            self.refuse(&channel, format!("another {role} is connected (process {pid})"));
        }
    }

    /// Compares the session parameters of a process that has connected.
    fn greet(&self, mut channel: Channel) -> Result<Step<Out, In>, ConnectError> {
        let reject =
            |channel, error| (PeerState::Rejected(channel), Some(PeerEvent::Rejected(error)));
        let not_understood = |cause: &dyn Display| ConnectError::NotUnderstood {
            peer: In::SENDER,
            cause: cause.to_string(),
        };
        let hello = match channel.next() {
            Ok(Some(Line::Hello(hello))) => hello,
            Ok(None) => {
                let event = channel.is_overdue().then(|| Self::half_met(None, Half::Hello));
                return Ok((PeerState::Greeted(channel), event));
            }
            Err(cause) if cause.kind() == ErrorKind::InvalidData => {
                self.refuse(&channel, format!("the first line is not understood: {cause}"));
                return Ok(reject(channel, not_understood(&cause)));
            }
            Ok(Some(_)) | Err(_) => return Ok((PeerState::Absent, None)),
        };
        let ours = (SESSION_VERSION, self.params);
        let theirs = (hello.version, hello.params);
        if let Some(error) = disagreement(In::SENDER, theirs, ours) {
            // As the peer would state it.
            let reason = disagreement(Out::SENDER, ours, theirs);
            self.refuse(&channel, reason.map(|reason| reason.to_string()).unwrap_or_default());
            return Ok(reject(channel, error));
        }
        if let [name, ..] = &hello.unknown[..] {
            let cause = format!("`{name}` is no parameter of this version");
            self.refuse(&channel, cause.clone());
            return Ok(reject(channel, not_understood(&cause)));
        }
        if let Some(reason) = hello.refused {
            let refused = ConnectError::Refused { peer: In::SENDER, pid: hello.pid, reason };
            return Ok(reject(channel, refused));
        }
        let session = match &self.listener {
            Some(_) => Some(Session::begin(&self.domain)?),
            None => hello.session,
        };
        let Some(session) = session.filter(|session| session.is_in(&self.domain)) else {
            let cause = format!(
                "it names no session of this domain: the folder must lie in {} and the prefix begin with {}",
                self.domain.root().display(),
                self.domain.prefix()
            );
            self.refuse(&channel, cause.clone());
            return Ok(reject(channel, not_understood(&cause)));
        };
        let mut ports = Ports::create(&session).map_err(|cause| {
            self.refuse(&channel, format!("the shared memory cannot be opened: {cause}"));
            self.failed("create the shared memory", &cause)
        })?;
        if self.listener.is_some() {
            wait_for_recorders(self.domain.root(), || ports.recorders());
            let session = Some(session.clone());
            channel.send(&Line::Hello(Hello { session, ..Hello::of(self.params) }));
        } else {
            self.check_ports(&channel, hello.pid, session.clone(), &ports)?;
            self.map_peer(&session, &mut ports)?;
            channel.send(&Line::Ready);
        }
        let SessionParams { leg, estimator, .. } = hello.params;
        let peer = Peer { role: In::SENDER, pid: hello.pid, leg, estimator };
        Ok((PeerState::Preparing(channel, peer, session, ports), None))
    }

    /// Refuses a peer without ports in the session.
    fn check_ports(
        &self,
        channel: &Channel,
        pid: u32,
        session: Session,
        ports: &Ports<Out, In>,
    ) -> Result<(), ConnectError> {
        let Some(missing) = ports.missing_of_peer() else { return Ok(()) };
        let Session { prefix, folder } = session;
        let half = Half::Ports { missing, prefix, folder };
        let error = ConnectError::HalfMet { peer: In::SENDER, pid: Some(pid), half };
        self.refuse(channel, error.to_string());
        Err(error)
    }

    fn half_met(pid: Option<u32>, half: Half) -> PeerEvent {
        PeerEvent::Failed(ConnectError::HalfMet { peer: In::SENDER, pid, half })
    }

    /// Passes the ports to the link, once those of the peer exist.
    fn prepare(
        &self,
        mut channel: Channel,
        peer: Peer,
        session: Session,
        mut ports: Ports<Out, In>,
    ) -> Result<Step<Out, In>, ConnectError> {
        let Peer { pid, .. } = peer;
        match channel.next() {
            Ok(Some(Line::Ready)) => (),
            Ok(None) => {
                let event = channel.is_overdue().then(|| {
                    let Session { prefix, folder } = session.clone();
                    Self::half_met(Some(pid), Half::Ready { prefix, folder })
                });
                return Ok((PeerState::Preparing(channel, peer, session, ports), event));
            }
            Ok(Some(Line::Refused(reason))) => {
                let refused = ConnectError::Refused { peer: In::SENDER, pid, reason };
                return Ok((PeerState::Rejected(channel), Some(PeerEvent::Rejected(refused))));
            }
            Ok(Some(_)) | Err(_) => {
                return Ok((PeerState::Absent, Some(Self::half_met(Some(pid), Half::Left))));
            }
        }
        self.check_ports(&channel, pid, session.clone(), &ports)?;
        if self.listener.is_some() {
            self.map_peer(&session, &mut ports)?;
            channel.send(&Line::Ready);
        }
        {
            let mut handover = lock(&self.ports);
            *handover = Some(ports);
            self.has_new_ports.store(true, Ordering::Relaxed);
        }
        self.connections.fetch_add(1, Ordering::Relaxed);
        Ok((PeerState::Connected(channel, peer), Some(PeerEvent::Connected(peer))))
    }

    fn map_peer(&self, session: &Session, ports: &mut Ports<Out, In>) -> Result<(), ConnectError> {
        ports.map_peer().map_err(|cause| self.failed("connect the ports", &cause))?;
        ports.connect_wake(session).map_err(|cause| self.failed("connect the wake-ups", &cause))?;
        Ok(self.domain.reserve()?)
    }

    /// Notices the loss of the connected peer. Its last message still counts, so the link
    /// keeps its ports until there are others.
    fn watch(&self, mut channel: Channel, peer: Peer) -> Step<Out, In> {
        let Peer { role, pid, .. } = peer;
        let lost = match channel.next() {
            Ok(None) => {
                self.refuse_another(peer);
                return (PeerState::Connected(channel, peer), None);
            }
            Ok(Some(Line::Left)) => LinkError::PeerLeft { role, pid },
            Ok(Some(_)) | Err(_) => LinkError::PeerDied { role, pid },
        };
        self.losses.fetch_add(1, Ordering::Relaxed);
        (PeerState::Absent, Some(PeerEvent::Lost(lost)))
    }

    fn failed(&self, action: &'static str, cause: &str) -> ConnectError {
        failed(&self.domain, action, &cause)
    }
}

/// The next state of the peer, and the change that it means.
type Step<Out, In> = (PeerState<Out, In>, Option<PeerEvent>);
