//! The iceoryx2 services of a domain and their attributes.

use std::time::{Duration, Instant};

use iceoryx2::prelude::{AttributeVerifier, Config, FileName, Node, Path, SemanticString, ipc};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::error::{ConnectError, failed};
use super::payload::{Message, Payload};
use crate::discovery::Domain;
use crate::link::SessionParams;

/// Subscribers of each service: the peer, and seven observers such as live views.
const MAX_READERS: usize = 8;
/// Processes at a service: both roles, the other readers, and dead ones that are being
/// cleaned up.
const MAX_NODES: usize = 16;
/// How long to retry creating a service or a port while a dead process is cleaned up.
const RETRY_TIMEOUT: Duration = Duration::from_secs(2);

/// How long iceoryx2 waits for an object that another process is creating. A real-time
/// loop may run into this wait if its peer is killed while connecting, so it is no longer
/// than creation takes.
const CREATION_TIMEOUT: Duration = Duration::from_millis(5);

const WIRE_VERSION_KEY: &str = "wire-version";
const RATE_KEY: &str = "rate-hz";
const GRAVITY_KEY: &str = "gravity-m-s2";

/// The service that transports messages of type `T`.
pub(super) type Service<T> = PortFactory<ipc::Service, Payload<T>, ()>;

/// Returns the iceoryx2 configuration for a domain: all files in the domain's
/// folder, all shared memory under the domain's prefix.
///
/// # Errors
/// Returns a message when iceoryx2 does not accept the folder's name.
pub fn config(domain: &Domain) -> Result<Config, String> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).map_err(|e| e.to_string())?;
    let root = Path::new(domain.root().as_os_str().as_encoded_bytes())
        .map_err(|cause| format!("{}: {cause}", domain.root().display()))?;
    config.global.set_root_path(&root);
    config.global.creation_timeout = CREATION_TIMEOUT;
    Ok(config)
}

/// Opens or creates the service that transports messages of type `T`.
pub(super) fn service<T: Message>(
    node: &Node<ipc::Service>,
    domain: &Domain,
    params: SessionParams,
) -> Result<Service<T>, ConnectError> {
    let name = T::SERVICE.try_into().map_err(|e| failed(domain, "name a service", &e))?;
    let attributes =
        attributes(params).map_err(|cause| failed(domain, "describe a service", &cause))?;
    retry(|| {
        node.service_builder(&name)
            .publish_subscribe::<Payload<T>>()
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
        // The records agreed, so the service was created by another program: an observer of
        // another version, or another version of iceoryx2.
        failed(
            domain,
            "open the service of the messages (created by a program of another version?)",
            &cause,
        )
    })
}

/// Returns the attributes of a service, for the `iox2` tool and for peers that publish
/// no record.
fn attributes(params: SessionParams) -> Result<AttributeVerifier, String> {
    let mut attributes = AttributeVerifier::new();
    for (key, number) in [
        (WIRE_VERSION_KEY, params.wire_version.to_string()),
        (RATE_KEY, params.rate_hz.to_string()),
        (GRAVITY_KEY, params.gravity_m_s2.to_string()),
    ] {
        let key = AttributeKey::new(key.as_bytes()).map_err(|cause| cause.to_string())?;
        let value = AttributeValue::new(number.as_bytes()).map_err(|cause| cause.to_string())?;
        attributes = attributes.require(&key, &value).map_err(|cause| cause.to_string())?;
    }
    Ok(attributes)
}

/// Retries an operation that may fail while a dead or leaving process is cleaned up.
pub(super) fn retry<T, E>(mut operation: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let deadline = Instant::now() + RETRY_TIMEOUT;
    let mut pause = Duration::from_millis(1);
    loop {
        match operation() {
            Err(_) if Instant::now() < deadline => {
                std::thread::sleep(pause);
                pause = (pause * 2).min(Duration::from_millis(50));
            }
            result => return result,
        }
    }
}
