//! The iceoryx2 services of a session, and a port of each.

use std::fmt::Display;
use std::time::Duration;

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{
    CallbackProgression, Config, FileName, LogLevel, Node, NodeName, Path, PortName,
    SemanticString, SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern;
use iceoryx2::service::{self, Service as _};
use serde::Serialize;

use super::payload::{Message, Payload};
use super::wake::Wake;
use crate::discovery::Session;

/// The variant of iceoryx2. (`ipc_threadsafe` locks a mutex at each access: a tick takes a
/// sixth longer.)
pub(super) type Ipc = ipc::Service;

/// Name of an observer's node and ports.
pub(super) const OBSERVER: &str = "observer";
/// Name of those of an observer that receives every message.
pub(super) const RECORDER: &str = "recorder";

/// Messages that a recorder may be behind, a tenth of a second of a leg of 20,000 ticks/s. All
/// of them take 4 MB of shared memory in each session.
const RECORDER_BUFFER: usize = 2048;

/// Subscribers of each service: the peer, and seven observers such as live views.
const MAX_READERS: usize = 8;
/// Processes at a service: both roles, and the observers.
const MAX_NODES: usize = 16;

/// How long iceoryx2 waits for an object that another process is creating: longer than
/// creation takes. The loops wait as long when an observer is killed while it connects.
const CREATION_TIMEOUT: Duration = Duration::from_millis(5);

/// The service that transports messages of type `T`.
pub(super) type Service<T> = PortFactory<Ipc, Payload<T>, ()>;

/// Returns the iceoryx2 configuration of a session: all files in its folder, all shared
/// memory under its prefix.
///
/// # Errors
/// Returns a message when iceoryx2 does not accept the names.
pub fn config(session: &Session) -> Result<Config, String> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(session.prefix.as_bytes()).map_err(text)?;
    let folder = Path::new(session.folder.as_os_str().as_encoded_bytes()).map_err(text)?;
    config.global.set_root_path(&folder);
    config.global.creation_timeout = CREATION_TIMEOUT;
    Ok(config)
}

/// Returns the log level that a value of `IOX2_LOG_LEVEL` names, otherwise that of fatal errors.
/// (`set_log_level_from_env_or` prints any other value, and panics if the standard error is closed.)
fn log_level(name: Option<&str>) -> LogLevel {
    match name.unwrap_or_default().to_lowercase().as_str() {
        "trace" => LogLevel::Trace,
        "debug" => LogLevel::Debug,
        "info" => LogLevel::Info,
        "warn" => LogLevel::Warn,
        "error" => LogLevel::Error,
        _ => LogLevel::Fatal,
    }
}

/// Returns a node of iceoryx2 in a session.
pub(super) fn node(session: &Session, name: &str) -> Result<Node<Ipc>, String> {
    // iceoryx2 would also log each error that it returns.
    set_log_level(log_level(std::env::var("IOX2_LOG_LEVEL").ok().as_deref()));
    NodeBuilder::new()
        .config(&config(session)?)
        .name(&NodeName::new(name).map_err(text)?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .map_err(text)
}

/// Most messages that a reader holds at once: the last one while it receives the next, as the
/// usual loop of a program in Python does.
const MAX_BORROWED: usize = 2;

/// The attributes with which a service is created, by the names of iceoryx2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Attributes {
    max_publishers: usize,
    max_subscribers: usize,
    max_nodes: usize,
    subscriber_max_buffer_size: usize,
    subscriber_max_borrowed_samples: usize,
    history_size: usize,
    enable_safe_overflow: bool,
}

/// Returns the attributes of each service of a session.
pub(super) fn attributes() -> Attributes {
    Attributes {
        max_publishers: 1,
        max_subscribers: MAX_READERS,
        max_nodes: MAX_NODES,
        subscriber_max_buffer_size: RECORDER_BUFFER,
        subscriber_max_borrowed_samples: MAX_BORROWED,
        history_size: 0,
        enable_safe_overflow: true,
    }
}

/// Opens the service that transports messages of type `T`, or creates it.
fn service<T: Message>(node: &Node<Ipc>) -> Result<Service<T>, String> {
    let wanted = attributes();
    node.service_builder(&T::SERVICE.try_into().map_err(text)?)
        .publish_subscribe::<Payload<T>>()
        .max_publishers(wanted.max_publishers)
        .max_subscribers(wanted.max_subscribers)
        .max_nodes(wanted.max_nodes)
        .subscriber_max_buffer_size(wanted.subscriber_max_buffer_size)
        .subscriber_max_borrowed_samples(wanted.subscriber_max_borrowed_samples)
        .history_size(wanted.history_size)
        .enable_safe_overflow(wanted.enable_safe_overflow)
        .open_or_create()
        .map_err(|cause| match mismatch::<T>(node) {
            Some(mismatch) => format!("{mismatch} ({cause})"),
            None => text(cause),
        })
}

/// Returns in what a service that exists differs from what is wanted, if it does.
fn mismatch<T: Message>(node: &Node<Ipc>) -> Option<String> {
    let name = T::SERVICE.try_into().ok()?;
    let pattern = service::messaging_pattern::MessagingPattern::PublishSubscribe;
    let found = Ipc::details(&name, node.config(), pattern).ok()??.static_details;
    let MessagingPattern::PublishSubscribe(found) = found.messaging_pattern() else { return None };
    let described = |name: &str, bytes: usize, alignment: usize| {
        format!("{name} of {bytes} bytes, alignment {alignment}")
    };
    let payload = &found.message_type_details().payload;
    let theirs = described(&payload.type_name().to_string(), payload.size(), payload.alignment());
    let ours = described(T::TYPE_NAME, size_of::<T>(), align_of::<T>());
    let wanted = attributes();
    let at_least = |name, found: usize, wanted: usize| {
        (found < wanted).then(|| format!("{name} {found} instead of {wanted}"))
    };
    let differences = [
        (theirs != ours).then(|| format!("the payload {theirs}, instead of {ours}")),
        at_least("max_publishers", found.max_publishers(), wanted.max_publishers),
        at_least("max_subscribers", found.max_subscribers(), wanted.max_subscribers),
        at_least("max_nodes", found.max_nodes(), wanted.max_nodes),
        at_least(
            "subscriber_max_buffer_size",
            found.subscriber_max_buffer_size(),
            wanted.subscriber_max_buffer_size,
        ),
        at_least(
            "subscriber_max_borrowed_samples",
            found.subscriber_max_borrowed_samples(),
            wanted.subscriber_max_borrowed_samples,
        ),
        (!found.has_safe_overflow()).then(|| "no safe overflow".to_owned()),
    ];
    let differences: Vec<_> = differences.into_iter().flatten().collect();
    let list = differences.join(", ");
    (!differences.is_empty()).then(|| format!("the service {} has {list}", T::SERVICE))
}

/// The ports of one end of a session.
// In this order, since the ports must be dropped before the services, and those before the
// node.
#[derive(Debug)]
pub(super) struct Ports<Out: Message, In: Message> {
    pub(super) publisher: Publisher<Ipc, Payload<Out>, ()>,
    pub(super) subscriber: Subscriber<Ipc, Payload<In>, ()>,
    /// Wake-ups, where the peer wants them.
    pub(super) wake: Option<Wake>,
    services: (Service<Out>, Service<In>),
    _node: Node<Ipc>,
}

// SAFETY: the ports of the variant `ipc` are not `Send`, since a port and what is made from
// it share an `Rc`. All of these are fields of this struct, which are only borrowed, and
// received messages are copied out within one call; so all clones of an `Rc` are always
// together on one thread. Whoever passes them on synchronises the threads (by a mutex).
#[allow(unsafe_code, reason = "another thread creates the ports than the one that uses them")]
unsafe impl<Out: Message, In: Message> Send for Ports<Out, In> {}

impl<Out: Message, In: Message> Ports<Out, In> {
    /// Creates the ports of the sender of `Out`, and the services if there are none yet.
    pub(super) fn create(session: &Session) -> Result<Self, String> {
        let name = Out::SENDER.as_str();
        let node = node(session, name)?;
        let (outgoing, incoming) = (service::<Out>(&node)?, service::<In>(&node)?);
        let port = PortName::new(name).map_err(text)?;
        let subscriber =
            incoming.subscriber_builder().name(&port).buffer_size(1).create().map_err(text)?;
        let publisher = outgoing.publisher_builder().name(&port).create().map_err(text)?;
        Ok(Self { publisher, subscriber, wake: None, services: (outgoing, incoming), _node: node })
    }

    /// Returns the ports of the peer that do not exist, with their services. Observers are not
    /// counted.
    pub(super) fn missing_of_peer(&self) -> Option<String> {
        let (outgoing, incoming) = &self.services;
        let mut has_subscriber = false;
        outgoing.dynamic_config().list_subscribers(|subscriber| {
            has_subscriber |= ![OBSERVER, RECORDER].contains(&subscriber.subscriber_name.as_str());
            CallbackProgression::Continue
        });
        let publisher = (incoming.dynamic_config().number_of_publishers() == 0)
            .then(|| format!("publisher at {}", In::SERVICE));
        let subscriber = (!has_subscriber).then(|| format!("subscriber at {}", Out::SERVICE));
        let missing: Vec<_> = publisher.into_iter().chain(subscriber).collect();
        (!missing.is_empty()).then(|| missing.join(" and no "))
    }

    /// Finds out whether the peer wants wake-ups.
    ///
    /// # Errors
    /// Returns a message if it does and cannot be reached.
    pub(super) fn connect_wake(&mut self, session: &Session) -> Result<(), String> {
        self.wake = Wake::with_peer(session, Out::SENDER, In::SENDER).map_err(text)?;
        Ok(())
    }

    /// Returns the number of recorders that have both their ports.
    pub(super) fn recorders(&self) -> usize {
        let (outgoing, incoming) = &self.services;
        let (mut at_outgoing, mut at_incoming) = (0, 0);
        outgoing.dynamic_config().list_subscribers(|subscriber| {
            at_outgoing += usize::from(subscriber.subscriber_name.as_str() == RECORDER);
            CallbackProgression::Continue
        });
        incoming.dynamic_config().list_subscribers(|subscriber| {
            at_incoming += usize::from(subscriber.subscriber_name.as_str() == RECORDER);
            CallbackProgression::Continue
        });
        at_outgoing.min(at_incoming)
    }

    /// Maps the memory of the peer's ports, which must exist. Whatever a peer sends before
    /// would be lost if it left before the first receive.
    pub(super) fn map_peer(&self) -> Result<(), String> {
        self.publisher.update_connections().map_err(text)?;
        self.subscriber.has_samples().map(|_| ()).map_err(text)
    }
}

pub(super) fn text(cause: impl Display) -> String {
    cause.to_string()
}
