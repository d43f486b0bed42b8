//! Watching a leg and its controller without being either.

use std::sync::Arc;

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    LogLevel, Node, NodeName, PortName, SignalHandlingMode, ipc, set_log_level_from_env_or,
};

use super::service::{Service, config};
use super::{ConnectError, failed};
use crate::card::{self, Presence, Role};
use crate::domain::Domain;
use crate::payload::{Message, Shared};
use leg_control::wire::{Command, Sample};

/// Name of its node and ports.
const NAME: &str = "observer";

/// Who plays in a domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Players {
    /// Whether there is a leg.
    pub leg: bool,
    /// Whether there is a controller.
    pub controller: bool,
}

impl Players {
    /// Looks into the domain of this name, without joining it.
    ///
    /// # Errors
    /// [`ConnectError`] when the name is unfit or the folder cannot be read.
    pub fn of(domain: &str) -> Result<Self, ConnectError> {
        let folder = Domain::folder(domain)?;
        let plays = |role| match card::presence_in(&folder, role) {
            Ok(presence) => Ok(matches!(presence, Presence::Alive(_))),
            Err(cause) => Err(ConnectError::Transport {
                action: "look for the players",
                domain: domain.to_owned(),
                cause: cause.to_string(),
            }),
        };
        Ok(Self { leg: plays(Role::Leg)?, controller: plays(Role::Controller)? })
    }

    /// Whether anybody plays.
    #[must_use]
    pub fn any(self) -> bool {
        self.leg || self.controller
    }
}

/// Hears samples and commands, the newest of each, and is heard by nobody.
///
/// It has no role. It only opens services that are there, and it joins their
/// domain: so look often whether anybody still plays ([`Players::of`]), and drop
/// it when not, for the last to leave takes everything along.
///
/// Ports are dropped first, then what they stand on.
#[derive(Debug)]
pub struct Observer {
    samples: Ear<Sample>,
    commands: Ear<Command>,
    _node: Node<ipc::Service>,
    _domain: Arc<Domain>,
}

/// A reader of one service.
#[derive(Debug)]
struct Ear<T: Message> {
    subscriber: Subscriber<ipc::Service, Shared<T>, ()>,
    _service: Service<T>,
}

impl<T: Message> Ear<T> {
    fn open(node: &Node<ipc::Service>, domain: &Domain) -> Result<Self, ConnectError> {
        let name = T::SERVICE.try_into().map_err(|e| failed(domain, "name a service", &e))?;
        let service = node
            .service_builder(&name)
            .publish_subscribe::<Shared<T>>()
            .open()
            .map_err(|cause| failed(domain, "open the service of the messages", &cause))?;
        let port = PortName::new(NAME).map_err(|e| failed(domain, "name the ports", &e))?;
        let subscriber =
            service.subscriber_builder().name(&port).buffer_size(1).create().map_err(|cause| {
                failed(domain, "subscribe (are there too many readers?)", &cause)
            })?;
        Ok(Self { subscriber, _service: service })
    }

    /// A peer that dies while it connects shows as an error here: then there is
    /// nothing to hear.
    fn newest(&self) -> Option<T> {
        self.subscriber.receive().ok().flatten().map(|message| message.0)
    }
}

impl Observer {
    /// Begins to listen in the domain of this name, in which somebody plays.
    ///
    /// # Errors
    /// [`ConnectError`], as when the players have not made their services yet:
    /// then try again.
    pub fn join(domain: &str) -> Result<Self, ConnectError> {
        let domain = Domain::join(domain)?;
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
            samples: Ear::open(&node, &domain)?,
            commands: Ear::open(&node, &domain)?,
            _node: node,
            _domain: domain,
        })
    }

    /// The newest sample, if there is one that was not taken yet.
    #[must_use]
    pub fn sample(&self) -> Option<Sample> {
        self.samples.newest()
    }

    /// The newest command, if there is one that was not taken yet.
    #[must_use]
    pub fn command(&self) -> Option<Command> {
        self.commands.newest()
    }
}
