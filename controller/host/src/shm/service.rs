//! The services of a domain: what carries the messages, and what it says of itself.

use std::time::{Duration, Instant};

use iceoryx2::prelude::{AttributeVerifier, Config, FileName, Node, Path, SemanticString, ipc};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::{ConnectError, failed};
use crate::card::Terms;
use crate::domain::Domain;
use crate::payload::{Message, Shared};

/// Readers of each service: the peer, a recorder, a live view, and one to spare.
const MAX_READERS: usize = 4;
/// Processes at a service: two players, the readers, and some that are being cleaned up.
const MAX_NODES: usize = 16;
/// For how long to try to make a service or a port while a dead process is cleaned up.
const SETTLE: Duration = Duration::from_secs(2);

/// For how long iceoryx2 waits by itself for what another process is making. A loop may
/// have to, for a peer that is killed while it connects: as short as a process takes.
const CREATION: Duration = Duration::from_millis(5);

const WIRE_VERSION_KEY: &str = "wire-version";
const RATE_KEY: &str = "rate-hz";
const GRAVITY_KEY: &str = "gravity-m-s2";

/// A service that carries `T`.
pub(super) type Service<T> = PortFactory<ipc::Service, Shared<T>, ()>;

/// iceoryx2's configuration for a domain: all its files in the domain's
/// folder, all its shared memory under the domain's prefix.
///
/// # Errors
/// What in the folder's name iceoryx2 does not take.
pub fn config(domain: &Domain) -> Result<Config, String> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).map_err(|e| e.to_string())?;
    let root = Path::new(domain.root().as_os_str().as_encoded_bytes())
        .map_err(|cause| format!("{}: {cause}", domain.root().display()))?;
    config.global.set_root_path(&root);
    config.global.creation_timeout = CREATION;
    Ok(config)
}

/// Opens or makes the service that carries `T`.
pub(super) fn service<T: Message>(
    node: &Node<ipc::Service>,
    domain: &Domain,
    terms: Terms,
) -> Result<Service<T>, ConnectError> {
    let name = T::SERVICE.try_into().map_err(|e| failed(domain, "name a service", &e))?;
    let attributes =
        attributes(terms).map_err(|cause| failed(domain, "describe a service", &cause))?;
    settle(|| {
        node.service_builder(&name)
            .publish_subscribe::<Shared<T>>()
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
    for (key, number) in [
        (WIRE_VERSION_KEY, terms.wire_version.to_string()),
        (RATE_KEY, terms.rate_hz.to_string()),
        (GRAVITY_KEY, terms.gravity_m_s2.to_string()),
    ] {
        let key = AttributeKey::new(key.as_bytes()).map_err(|cause| cause.to_string())?;
        let value = AttributeValue::new(number.as_bytes()).map_err(|cause| cause.to_string())?;
        attributes = attributes.require(&key, &value).map_err(|cause| cause.to_string())?;
    }
    Ok(attributes)
}

/// Repeats what fails only because a dead or leaving process is still being cleaned up.
pub(super) fn settle<T, E>(mut attempt: impl FnMut() -> Result<T, E>) -> Result<T, E> {
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
