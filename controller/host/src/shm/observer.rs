//! Reading the messages of a leg and its controller without taking a role.

use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Node, PortName};
use iceoryx2::service::port_factory::PortFactory as _;
use leg_control::wire::{Command, Sample};

use super::error::{ConnectError, failed};
use super::payload::{Message, Payload};
use super::recorder::Registration;
use super::service::{Ipc, OBSERVER, RECORDER, Service, node, text};
use crate::discovery::{Domain, DomainError, Session, holder};
use crate::link::Role;

/// Which roles of a domain are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Participants {
    /// Whether a process holds the role of the leg.
    pub leg: bool,
    /// Whether a process holds the role of the controller.
    pub controller: bool,
}

impl Participants {
    /// Reads which roles of the domain `domain` are held, without joining it.
    ///
    /// # Errors
    /// Returns [`DomainError`] when the name is invalid.
    pub fn of(domain: &str) -> Result<Self, DomainError> {
        let folder = Domain::folder(domain)?;
        let is_held = |role| holder(&folder, role).is_ok_and(|holder| holder.is_some());
        Ok(Self { leg: is_held(Role::Leg), controller: is_held(Role::Controller) })
    }

    /// Returns whether any role is held.
    #[must_use]
    pub fn any(self) -> bool {
        self.leg || self.controller
    }
}

/// Receives the newest sample and the newest command of a domain, or all of them, and sends
/// nothing.
///
/// An observer holds no role and only opens services that exist. It joins the
/// domain, which the last process to leave removes: so check often whether any role
/// is still held ([`Participants::of`]) and the session goes on ([`Observer::is_over`]), and
/// drop the observer when not.
// The readers, which hold the ports, must be dropped before the node and the domain.
#[derive(Debug)]
pub struct Observer {
    samples: Reader<Sample>,
    commands: Reader<Command>,
    _node: Node<Ipc>,
    session: Session,
    _domain: Arc<Domain>,
}

/// A subscriber to one service.
#[derive(Debug)]
struct Reader<T: Message> {
    subscriber: Subscriber<Ipc, Payload<T>, ()>,
    _service: Service<T>,
}

impl<T: Message> Reader<T> {
    /// With a buffer for the newest message, or as large as the service allows.
    fn open(node: &Node<Ipc>, is_recorder: bool) -> Result<Self, String> {
        let service = node
            .service_builder(&T::SERVICE.try_into().map_err(text)?)
            .publish_subscribe::<Payload<T>>()
            .open()
            .map_err(text)?;
        let (name, buffer) = if is_recorder {
            (RECORDER, service.static_config().subscriber_max_buffer_size())
        } else {
            (OBSERVER, 1)
        };
        let port = PortName::new(name).map_err(text)?;
        let subscriber = service.subscriber_builder().name(&port).buffer_size(buffer).create();
        Ok(Self { subscriber: subscriber.map_err(text)?, _service: service })
    }

    /// Returns the oldest message in the buffer. A publisher that dies
    /// while it connects causes an error, which counts as no message.
    fn newest(&self) -> Option<T> {
        self.subscriber.receive().ok().flatten().map(|message| message.0)
    }
}

impl Observer {
    /// Subscribes to both services of the session in the domain `domain`.
    ///
    /// # Errors
    /// Returns [`ConnectError`], for example when leg and controller have not connected
    /// yet, or when there are too many observers; then retry.
    pub fn join(domain: &str) -> Result<Self, ConnectError> {
        Self::join_as(Domain::join(domain)?, false)
    }

    /// Like [`join`](Self::join), with a buffer from which [`sample`](Self::sample) and
    /// [`command`](Self::command) return every message, the oldest first; it holds some
    /// thousands, and drops the oldest where it is full.
    ///
    /// # Errors
    /// Like [`join`](Self::join).
    pub fn join_as_recorder(recorder: &Registration) -> Result<Self, ConnectError> {
        Self::join_as(Arc::clone(recorder.domain()), true)
    }

    fn join_as(domain: Arc<Domain>, is_recorder: bool) -> Result<Self, ConnectError> {
        let failed = |cause: &str| failed(&domain, "observe leg and controller", &cause);
        let session = Session::current(&domain)
            .ok_or_else(|| failed("they have not connected to each other yet"))?;
        let join = || {
            let node = node(&session, OBSERVER)?;
            let samples = Reader::open(&node, is_recorder)?;
            Ok::<_, String>((samples, Reader::open(&node, is_recorder)?, node))
        };
        let (samples, commands, node) = join().map_err(|cause| failed(&cause))?;
        Ok(Self { samples, commands, _node: node, session, _domain: domain })
    }

    /// Returns whether the session is over: leg and controller have begun another, or the
    /// folder of the domain was removed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        !self.session.folder.exists()
    }

    /// Returns whether there is a session to join in the domain of `recorder`.
    #[must_use]
    pub fn can_join(recorder: &Registration) -> bool {
        Session::current(recorder.domain()).is_some()
    }

    /// Returns the newest sample, of a recorder the oldest, if there is an unread one.
    #[must_use]
    pub fn sample(&self) -> Option<Sample> {
        self.samples.newest()
    }

    /// Returns the newest command, of a recorder the oldest, if there is an unread one.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        self.commands.newest()
    }
}
