//! Reading the messages of a leg and its controller without taking a role.

use std::sync::Arc;

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    LogLevel, Node, NodeName, PortName, SignalHandlingMode, ipc, set_log_level_from_env_or,
};
use leg_control::wire::{Command, Sample};

use super::error::{ConnectError, failed};
use super::payload::{Message, Payload};
use super::service::{Service, config};
use crate::discovery::{Domain, Presence, presence_in};
use crate::link::Role;

/// Name of the observer's node and ports.
const NAME: &str = "observer";

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
    /// Returns [`ConnectError`] when the name is invalid or the folder cannot be read.
    pub fn of(domain: &str) -> Result<Self, ConnectError> {
        let folder = Domain::folder(domain)?;
        let is_held = |role| match presence_in(&folder, role) {
            Ok(presence) => Ok(matches!(presence, Presence::Alive(_))),
            Err(cause) => Err(ConnectError::Transport {
                action: "check for leg and controller",
                domain: domain.to_owned(),
                cause: cause.to_string(),
            }),
        };
        Ok(Self { leg: is_held(Role::Leg)?, controller: is_held(Role::Controller)? })
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
/// is still held ([`Participants::of`]), and drop the observer when none is.
// The readers, which hold the ports, must be dropped before the node and the domain.
#[derive(Debug)]
pub struct Observer {
    samples: Reader<Sample>,
    commands: Reader<Command>,
    _node: Node<ipc::Service>,
    _domain: Arc<Domain>,
}

/// A subscriber to one service.
#[derive(Debug)]
struct Reader<T: Message> {
    subscriber: Subscriber<ipc::Service, Payload<T>, ()>,
    _service: Service<T>,
}

impl<T: Message> Reader<T> {
    fn open(node: &Node<ipc::Service>, domain: &Domain) -> Result<Self, ConnectError> {
        let name = T::SERVICE.try_into().map_err(|e| failed(domain, "name a service", &e))?;
        let service = node
            .service_builder(&name)
            .publish_subscribe::<Payload<T>>()
            .open()
            .map_err(|cause| failed(domain, "open the service of the messages", &cause))?;
        let port = PortName::new(NAME).map_err(|e| failed(domain, "name the ports", &e))?;
        let subscriber =
            service.subscriber_builder().name(&port).buffer_size(1).create().map_err(|cause| {
                failed(domain, "subscribe (are there too many readers?)", &cause)
            })?;
        Ok(Self { subscriber, _service: service })
    }

    /// Returns the newest message, if there is an unread one. A publisher that dies
    /// while it connects causes an error, which counts as no message.
    fn newest(&self) -> Option<T> {
        self.subscriber.receive().ok().flatten().map(|message| message.0)
    }
}

impl Observer {
    /// Subscribes to both services of the domain `domain`.
    ///
    /// # Errors
    /// Returns [`ConnectError`], for example when leg and controller have not created
    /// their services yet; then retry.
    pub fn join(domain: &str) -> Result<Self, ConnectError> {
        let domain = Domain::join(domain)?;
        let _creation = domain.lock_creation()?;
        set_log_level_from_env_or(LogLevel::Fatal);
        let name = NodeName::new(NAME).map_err(|e| failed(&domain, "name the node", &e))?;
        let config =
            config(&domain).map_err(|cause| failed(&domain, "name the services", &cause))?;
        let node = NodeBuilder::new()
            .config(&config)
            .name(&name)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|cause| failed(&domain, "start iceoryx2", &cause))?;
        Ok(Self {
            samples: Reader::open(&node, &domain)?,
            commands: Reader::open(&node, &domain)?,
            _node: node,
            _domain: domain,
        })
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
