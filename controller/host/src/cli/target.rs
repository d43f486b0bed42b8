//! Which controller a command is for, and the connection to it.

use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::time::Duration;

use super::{DomainArgs, TIMEOUT, parse_timeout};
use crate::Domain;
use crate::discovery::{DEFAULT_DOMAIN, DomainError, Whereabouts};
use crate::link::Role;
use crate::node_server::PROCESS;
use crate::serial::stream::{
    ByteStream, Endpoint, OpenError, USUAL_BAUD, over_unix, parse_address, parse_baud,
};
use crate::serial::{Client, ClientError, DeviceIdentity, client::IDENTIFY_TIMEOUT};
use crate::server::socket_in;
use crate::socket::connect;
use leg_process::Stop;

/// How long to wait for the answer of each bridge.
const BRIDGE_TIMEOUT: Duration = Duration::from_millis(500);

/// Which controller: the one in a domain (the default), or a board.
#[derive(Clone, Debug, clap::Args)]
pub struct TargetArgs {
    /// The process in this domain, or the board of the bridge in it.
    #[command(flatten)]
    domain: DomainArgs,
    /// How long to wait for an answer, and for the apex of a swap, s [default: 3 for an answer,
    /// 10 for an apex].
    #[arg(long, value_name = "S", value_parser = parse_timeout, allow_negative_numbers = true)]
    timeout: Option<Duration>,
    /// The board on this serial port.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["domain", "unix", "tcp"])]
    serial: Option<PathBuf>,
    /// The controller behind this unix socket: an emulator's, or a bridge's --share.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["domain", "tcp"])]
    unix: Option<PathBuf>,
    /// The controller behind this TCP port.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address, conflicts_with = "domain")]
    tcp: Option<String>,
    /// Bits a second on the serial port; a USB port takes any [default: 2000000].
    #[arg(long, value_name = "BAUD", requires = "serial", value_parser = parse_baud, allow_negative_numbers = true)]
    baud: Option<u32>,
    /// Print the result as one JSON object.
    #[arg(long)]
    pub(super) json: bool,
}

/// Why there is no connection to a controller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectionError {
    /// The name of the domain is invalid.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// No controller runs in that domain.
    #[error(
        "no controller is running in domain `{domain}`{whereabouts}; start one with `controller \
         --policy FILE --domain {domain}`, name another --domain, or a board by --serial, --unix or \
         --tcp"
    )]
    Nobody {
        /// The domain.
        domain: String,
        /// Where it was looked for, and where else one runs.
        whereabouts: Whereabouts,
    },
    /// The system refused.
    #[error("cannot connect to the controller in domain `{domain}`: {cause}")]
    Io {
        /// The domain.
        domain: String,
        /// The error of the system.
        cause: io::Error,
    },
    /// The stream cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The controller does not answer, and a bridge may be using it.
    #[error(
        "{cause} A bridge runs in the domain {domains}; if it uses this controller, it answers for \
         it: name its --domain instead",
        domains = bridges.join(", ")
    )]
    Taken {
        /// The silence.
        cause: ClientError,
        /// The domains of all bridges.
        bridges: Vec<String>,
    },
    /// The controller does not answer.
    #[error(transparent)]
    Client(#[from] ClientError),
}

impl TargetArgs {
    /// Returns how long to wait for an apex.
    pub(super) fn timeout(&self) -> Duration {
        self.timeout.unwrap_or(TIMEOUT)
    }

    /// Connects to the controller, and asks for its identity.
    pub(super) fn connect(&self, stop: &Stop) -> Result<(Client, DeviceIdentity), ConnectionError> {
        let timeout = self.timeout.unwrap_or(IDENTIFY_TIMEOUT);
        let endpoint = match self {
            Self { serial: Some(path), baud, .. } => {
                Endpoint::Serial { path: path.clone(), baud: baud.unwrap_or(USUAL_BAUD) }
            }
            Self { unix: Some(path), .. } => Endpoint::Unix(path.clone()),
            Self { tcp: Some(address), .. } => Endpoint::Tcp(address.clone()),
            Self { .. } => {
                let mut client = Client::new(open_process(self.domain.name())?, stop);
                let identity = client.identify(timeout)?;
                return Ok((client, identity));
            }
        };
        let mut client = Client::new(endpoint.open()?, stop);
        let identity = client.identify(timeout).map_err(|cause| match cause {
            ClientError::Silent { is_serial_port: false, .. } => {
                let bridges = bridges();
                if bridges.is_empty() {
                    cause.into()
                } else {
                    ConnectionError::Taken { cause, bridges }
                }
            }
            _ => cause.into(),
        })?;
        Ok((client, identity))
    }
}

/// Returns the domains in which a bridge answers for a board.
fn bridges() -> Vec<String> {
    let Ok(folder) = Domain::folder(DEFAULT_DOMAIN) else { return Vec::new() };
    let mut domains = Whereabouts::of(Role::Controller, &folder).domains;
    domains.insert(0, DEFAULT_DOMAIN.to_owned());
    domains.retain(|domain| {
        open_process(domain).is_ok_and(|stream| {
            let identity = Client::new(stream, &Stop::default()).identify(BRIDGE_TIMEOUT);
            identity.is_ok_and(|identity| identity.board != PROCESS)
        })
    });
    domains
}

/// Opens a stream to the controller process in a domain.
///
/// # Errors
/// [`ConnectionError`].
pub fn open_process(domain: &str) -> Result<Box<dyn ByteStream>, ConnectionError> {
    let folder = Domain::folder(domain)?;
    let connected = connect(&socket_in(&folder)).and_then(over_unix);
    connected.map_err(|cause| match cause.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => ConnectionError::Nobody {
            domain: domain.to_owned(),
            whereabouts: Whereabouts::of(Role::Controller, &folder),
        },
        _ => ConnectionError::Io { domain: domain.to_owned(), cause },
    })
}

/// Reads the status of the controller process in a domain.
///
/// # Errors
/// [`ConnectionError`]; a controller that is no process answers by
/// [`ClientError::WrongReply`].
pub fn process_status(domain: &str) -> Result<crate::status::Status, ConnectionError> {
    let mut client = Client::new(open_process(domain)?, &Stop::default());
    let report = client.report()?.ok_or(ClientError::WrongReply)?;
    Ok(serde_json::from_slice(&report).map_err(|_| ClientError::WrongReply)?)
}
