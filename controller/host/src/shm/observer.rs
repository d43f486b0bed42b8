//! Reading the messages of a leg and its controller without taking a role.

use std::sync::Arc;

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Node, PortName};
use leg_control::wire::{Command, Sample};

use super::error::{ConnectError, failed};
use super::payload::{Message, Payload};
use super::service::{Ipc, OBSERVER, Service, node, text};
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

/// Receives the newest sample and the newest command of a domain, and sends nothing.
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
    fn open(node: &Node<Ipc>) -> Result<Self, String> {
        let service = node
            .service_builder(&T::SERVICE.try_into().map_err(text)?)
            .publish_subscribe::<Payload<T>>()
            .open()
            .map_err(text)?;
        let port = PortName::new(OBSERVER).map_err(text)?;
        let subscriber = service.subscriber_builder().name(&port).buffer_size(1).create();
        Ok(Self { subscriber: subscriber.map_err(text)?, _service: service })
    }

    /// Returns the newest message, if there is an unread one. A publisher that dies
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
        let domain = Domain::join(domain)?;
        let failed = |cause: &str| failed(&domain, "observe leg and controller", &cause);
        let session = Session::current(&domain)
            .ok_or_else(|| failed("they have not connected to each other yet"))?;
        let join = || {
            let node = node(&session, OBSERVER)?;
            Ok::<_, String>((Reader::open(&node)?, Reader::open(&node)?, node))
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

    /// Returns the newest sample, if there is an unread one.
    #[must_use]
    pub fn sample(&self) -> Option<Sample> {
        self.samples.newest()
    }

    /// Returns the newest command, if there is an unread one.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        self.commands.newest()
    }
}
