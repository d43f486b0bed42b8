//! Links between two processes, over iceoryx2 shared memory.
//!
//! One publish-subscribe service each way: one publisher, buffer 1, no
//! history, safe overflow, so that the newest message wins and nobody waits
//! for a slow reader. Further subscribers (a recorder, a live view) may listen.
//!
//! A receiver polls: in lock-step the peer answers within microseconds, and
//! any blocking wait of the system costs thirty to forty. See [`super::wait`]
//! for what it does when the peer is slow.

use std::cell::Cell;
use std::fmt::{self, Display};
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, Config, FileName, LogLevel, Node, NodeName, Path,
    PortFactory as _, PortName, SemanticString, SignalHandlingMode, ipc, set_log_level_from_env_or,
};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::card::{self, Held, Presence, Refusal, Role, Terms};
use super::domain::{Domain, DomainError};
use super::link::{Link, LinkError};
use super::payload::Message;
use super::stop::Stop;
use super::wait::Waiter;
use crate::wire::{Command, Sample};

/// Readers of each service: the peer, a recorder, a live view, and one to spare.
const MAX_READERS: usize = 4;
/// Processes at a service: two players, the readers, and some that are being cleaned up.
const MAX_NODES: usize = 16;
/// Between two looks for a peer that has not come yet.
const LOOK: Duration = Duration::from_millis(5);
/// A refused process stays this long, so that its peer reads its card and can say why too.
const LINGER: Duration = Duration::from_millis(100);
/// For how long to try to make a service or a port while a dead process is cleaned up.
const SETTLE: Duration = Duration::from_secs(2);

const WIRE_VERSION_KEY: &str = "wire-version";
const RATE_KEY: &str = "rate-hz";

/// The peer that has not come, and how to start it.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Who.
    pub peer: Role,
    /// Where.
    pub domain: String,
    /// Waited for until now.
    pub waited: Duration,
    /// The rate that it has to have, Hz.
    pub rate_hz: u32,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { peer, domain, waited, rate_hz } = self;
        write!(
            f,
            "no {peer} in domain `{domain}` after {:.1} s; start one with `{} --domain {domain} --rate {rate_hz}`",
            waited.as_secs_f64(),
            peer.start_hint()
        )
    }
}

/// Why two processes did not come together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// No peer in time.
    #[error("{0}; --timeout sets how long to wait")]
    PeerMissing(Missing),
    /// The role is taken.
    #[error(
        "a {role} is already running in domain `{domain}`{}; end it, or choose another --domain for both sides",
        by(*pid)
    )]
    RoleTaken {
        /// Which role.
        role: Role,
        /// By which process, if it says.
        pid: Option<u32>,
        /// Where.
        domain: String,
    },
    /// The peer's messages are of another version.
    #[error(
        "the {peer} speaks version {theirs} of the messages, this program version {ours}; build both from the same release"
    )]
    WireVersion {
        /// Who.
        peer: Role,
        /// The peer's version.
        theirs: u16,
        /// This program's.
        ours: u16,
    },
    /// The peer ticks at another rate.
    #[error("the {peer} runs at {theirs} Hz, this program at {ours} Hz; give both the same --rate")]
    Rate {
        /// Who.
        peer: Role,
        /// The peer's rate, Hz.
        theirs: u32,
        /// This program's, Hz.
        ours: u32,
    },
    /// The domain cannot be joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// This process was told to stop, by a signal.
    #[error("stopped by a signal while waiting for the {0}")]
    Stopped(Role),
    /// iceoryx2 or the system refused.
    #[error("cannot {action} in domain `{domain}`: {cause}")]
    Transport {
        /// What was being done.
        action: &'static str,
        /// Where.
        domain: String,
        /// What the transport says.
        cause: String,
    },
}

fn by(pid: Option<u32>) -> String {
    pid.map_or_else(String::new, |pid| format!(" (process {pid})"))
}

type Service<T> = PortFactory<ipc::Service, T, ()>;

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
    _role: Held,
    domain: Arc<Domain>,
    terms: Terms,
    peer_pid: Cell<u32>,
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
            _role: role,
            domain: Arc::clone(domain),
            terms,
            peer_pid: Cell::new(0),
            stop: stop.clone(),
            waiter: Waiter::new(),
        })
    }

    fn wait_for_peer(
        self,
        timeout: Duration,
        mut watch: impl FnMut(&Missing) -> bool,
    ) -> Result<Self, ConnectError> {
        let start = Instant::now();
        loop {
            if let Some(pid) = Self::agree(&self.domain, self.terms)?
                && self.peer_has_ports()
                // A publisher is mapped only by a look at its queue. Look now: what a peer sends
                // before it is mapped is lost if it leaves before the first receive.
                && self.subscriber.has_samples().is_ok()
            {
                self.peer_pid.set(pid);
                return Ok(self);
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
            };
            if waited >= timeout || !watch(&missing) {
                return Err(ConnectError::PeerMissing(missing));
            }
            std::thread::sleep(LOOK.min(timeout.saturating_sub(waited)));
        }
    }

    /// The peer's process, if it is there; an error if it does not fit.
    fn agree(domain: &Arc<Domain>, ours: Terms) -> Result<Option<u32>, ConnectError> {
        let seen = card::presence(domain, In::SENDER)
            .map_err(|cause| failed(domain, "look for the peer", &cause))?;
        let Presence::Alive(Some(card)) = seen else {
            return Ok(None);
        };
        let theirs = card.terms;
        if theirs == ours {
            return Ok(Some(card.pid));
        }
        std::thread::sleep(LINGER);
        Err(if theirs.wire_version == ours.wire_version {
            ConnectError::Rate { peer: In::SENDER, theirs: theirs.rate_hz, ours: ours.rate_hz }
        } else {
            ConnectError::WireVersion {
                peer: In::SENDER,
                theirs: theirs.wire_version,
                ours: ours.wire_version,
            }
        })
    }

    fn peer_has_ports(&self) -> bool {
        let peer = In::SENDER.as_str();
        let mut reads = false;
        self.outgoing.dynamic_config().list_subscribers(|port| {
            reads |= port.subscriber_name == peer;
            CallbackProgression::Continue
        });
        reads && self.incoming.dynamic_config().number_of_publishers() > 0
    }

    /// The peer's process.
    #[must_use]
    pub fn peer_pid(&self) -> u32 {
        self.peer_pid.get()
    }

    /// Off the control path: whether the peer this end is connected to is still there.
    fn check_peer(&self) -> Result<(), LinkError> {
        if self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        let (role, pid) = (In::SENDER, self.peer_pid.get());
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
            Ok(message) => Ok(message.map(|message| *message)),
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

fn broken(action: &'static str, cause: &dyn Display) -> LinkError {
    LinkError::Transport { action, cause: cause.to_string() }
}

fn failed(domain: &Domain, action: &'static str, cause: &dyn Display) -> ConnectError {
    ConnectError::Transport { action, domain: domain.name().to_owned(), cause: cause.to_string() }
}

/// iceoryx2's configuration for a domain: all its files in the domain's
/// folder, all its shared memory under the domain's prefix.
fn config(domain: &Domain) -> Result<Config, String> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).map_err(|e| e.to_string())?;
    let root = Path::new(domain.root().as_os_str().as_encoded_bytes())
        .map_err(|cause| format!("{}: {cause}", domain.root().display()))?;
    config.global.set_root_path(&root);
    Ok(config)
}

/// Opens or makes the service that carries `T`.
fn service<T: Message>(
    node: &Node<ipc::Service>,
    domain: &Domain,
    terms: Terms,
) -> Result<Service<T>, ConnectError> {
    let name = T::SERVICE.try_into().map_err(|e| failed(domain, "name a service", &e))?;
    let attributes =
        attributes(terms).map_err(|cause| failed(domain, "describe a service", &cause))?;
    settle(|| {
        node.service_builder(&name)
            .publish_subscribe::<T>()
            .max_publishers(1)
            .max_subscribers(MAX_READERS)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(1)
            .subscriber_max_borrowed_samples(1)
            .history_size(0)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&attributes)
    })
    .map_err(|cause| {
        // The cards agreed, so this is no peer of ours: an observer's service, or another iceoryx2.
        failed(
            domain,
            "open the service of the messages (made by a program of another version?)",
            &cause,
        )
    })
}

/// What a service says of itself, for the `iox2` tool and for peers without a card.
fn attributes(terms: Terms) -> Result<AttributeVerifier, String> {
    let mut attributes = AttributeVerifier::new();
    for (key, number) in
        [(WIRE_VERSION_KEY, u32::from(terms.wire_version)), (RATE_KEY, terms.rate_hz)]
    {
        let key = AttributeKey::new(key.as_bytes()).map_err(|cause| cause.to_string())?;
        let value = AttributeValue::new(number.to_string().as_bytes())
            .map_err(|cause| cause.to_string())?;
        attributes = attributes.require(&key, &value).map_err(|cause| cause.to_string())?;
    }
    Ok(attributes)
}

/// Repeats what fails only because a dead or leaving process is still being cleaned up.
fn settle<T, E>(mut attempt: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let deadline = Instant::now() + SETTLE;
    let mut pause = Duration::from_millis(1);
    loop {
        match attempt() {
            Err(_) if Instant::now() < deadline => {
                std::thread::sleep(pause);
                pause = (pause * 2).min(Duration::from_millis(50));
            }
            outcome => return outcome,
        }
    }
}
