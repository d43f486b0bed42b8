//! Errors of connecting two processes.

use std::fmt::{self, Display};
use std::path::PathBuf;
use std::time::Duration;

use crate::discovery::{Domain, DomainError, Whereabouts};
use crate::law::Described;
use crate::link::{LinkError, Role, SessionParams, TimeMode};

/// A peer that has not connected, and the session parameters that it needs.
#[derive(Clone, Debug)]
pub struct MissingPeer {
    /// Role of the missing peer.
    pub peer: Role,
    /// Name of the domain.
    pub domain: String,
    /// How long this end has waited.
    pub waited: Duration,
    /// The parameters that it must agree on.
    pub params: SessionParams,
    /// Why the last try to connect to one failed.
    pub failure: Option<String>,
    /// Where it was looked for, and where else one runs.
    pub whereabouts: Whereabouts,
}

impl Display for MissingPeer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "no {} in domain `{}` after {:.1} s{}",
            self.peer,
            self.domain,
            self.waited.as_secs_f64(),
            self.whereabouts
        )?;
        self.failure.as_ref().map_or(Ok(()), |cause| write!(f, "; the last try failed: {cause}"))
    }
}

/// Two processes could not connect.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// No peer connected in time.
    #[error("{0}")]
    PeerMissing(Box<MissingPeer>),
    /// Another process holds this end's role.
    #[error("a {role} is already running in domain `{domain}`{}", process(*pid))]
    RoleTaken {
        /// The role.
        role: Role,
        /// Process id of the holder, if its record is readable.
        pid: Option<u32>,
        /// Name of the domain.
        domain: String,
    },
    /// The two sides disagree on a session parameter.
    #[error("{}", parameter.describe(*peer, theirs, ours))]
    Disagreement {
        /// Role of the peer.
        peer: Role,
        /// The first parameter on which they disagree.
        parameter: Parameter,
        /// Its value at the peer.
        theirs: String,
        /// Its value in this program.
        ours: String,
    },
    /// A process has connected that does not follow the protocol of a session.
    #[error(
        "a process has connected as the {peer}, but its first line is not understood ({cause}); is it \
         of another release?"
    )]
    NotUnderstood {
        /// Role of the peer.
        peer: Role,
        /// What is wrong with it.
        cause: String,
    },
    /// The peer refuses the session.
    #[error("the {peer} (process {pid}) refuses the session: {reason}")]
    Refused {
        /// Role of the peer.
        peer: Role,
        /// Process id of the peer.
        pid: u32,
        /// What it states as the reason.
        reason: String,
    },
    /// A process has begun to connect and does not go on.
    #[error("{}", half.describe(*peer, *pid))]
    HalfMet {
        /// Role of the peer.
        peer: Role,
        /// Process id of the peer, if it has sent it.
        pid: Option<u32>,
        /// What is missing.
        half: Half,
    },
    /// The domain cannot be joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// A signal asked this process to stop during the wait for the peer.
    #[error("stopped by a signal while waiting for the {0}")]
    Stopped(Role),
    /// iceoryx2 or the system failed.
    #[error("cannot {action} in domain `{domain}`: {cause}")]
    Transport {
        /// The action that failed.
        action: &'static str,
        /// Name of the domain.
        domain: String,
        /// Error of the transport.
        cause: String,
    },
}

impl From<ConnectError> for LinkError {
    fn from(error: ConnectError) -> Self {
        match error {
            ConnectError::Stopped(_) => Self::Stopped,
            ConnectError::Transport { action, cause, .. } => Self::Transport { action, cause },
            other => Self::Transport { action: "connect", cause: other.to_string() },
        }
    }
}

impl ConnectError {
    /// Returns whether a peer is present that disagrees on the session parameters.
    /// Another one may agree.
    #[must_use]
    pub fn is_disagreement(&self) -> bool {
        matches!(
            self,
            Self::Disagreement { .. } | Self::NotUnderstood { .. } | Self::Refused { .. }
        )
    }
}

/// What a process has not done that has begun to connect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Half {
    /// It has sent no hello.
    Hello,
    /// It has not sent that it is ready.
    Ready {
        /// What the names of the session's shared memory start with.
        prefix: String,
        /// The folder of the session's files.
        folder: PathBuf,
    },
    /// It has left before it was ready.
    Left,
    /// It has sent that it is ready, but does not have these ports in the session.
    Ports {
        /// Each port, with its service.
        missing: String,
        /// What the names of the session's shared memory start with.
        prefix: String,
        /// The folder of the session's files.
        folder: PathBuf,
    },
}

impl Half {
    fn describe(&self, peer: Role, pid: Option<u32>) -> String {
        let process = pid.map_or_else(|| "a process".to_owned(), |pid| format!("process {pid}"));
        let begun = format!("{process} has connected as the {peer}, but");
        match self {
            Self::Hello => format!("{begun} has not sent its hello; is it stopped?"),
            Self::Ready { prefix, folder } => format!(
                "{begun} has not sent that it is ready, with ports in the session (prefix {prefix}, \
                 root path {}); is it stopped?",
                folder.display()
            ),
            Self::Left => format!("{begun} left before it was ready; see its own output"),
            Self::Ports { missing, prefix, folder } => format!(
                "{begun} has no {missing} in the session when it is ready; its iceoryx2 \
                 must have the prefix {prefix} and the root path {}",
                folder.display()
            ),
        }
    }
}

/// A session parameter on which both sides must agree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Version of the session protocol.
    SessionVersion,
    /// Version of the messages.
    WireVersion,
    /// Tick rate, Hz.
    Rate,
    /// Gravity, m/s2.
    Gravity,
    /// What advances the time.
    TimeMode,
    /// Age from which on a message counts for nothing, ms.
    StaleLimit,
    /// What the controller takes for the state.
    Estimator,
    /// What the leg senses, and what the law needs.
    Channels,
}

impl Parameter {
    fn describe(self, peer: Role, theirs: &str, ours: &str) -> String {
        match self {
            Self::SessionVersion => format!(
                "the {peer} uses version {theirs} of the session protocol, this program version \
                 {ours}; build both from the same release"
            ),
            Self::WireVersion => format!(
                "the {peer} uses version {theirs} of the messages, this program version {ours}; build \
                 both from the same release"
            ),
            Self::Rate => format!("the {peer} runs at {theirs} Hz, this program at {ours} Hz"),
            Self::Gravity => format!(
                "the {peer} is under a gravity of {theirs} m/s2, this program under {ours} m/s2"
            ),
            Self::TimeMode => format!("the {peer} runs in {theirs}, this program in {ours}"),
            Self::StaleLimit => format!(
                "the {peer} has a stale limit of {theirs} ms, this program one of {ours} ms"
            ),
            Self::Estimator => {
                format!("the estimator of the {peer} is {theirs}, that of this program {ours}")
            }
            Self::Channels => match peer {
                Role::Leg => format!(
                    "the leg of the {peer} senses {theirs}, but the estimator of this program \
                     needs {ours}"
                ),
                Role::Controller => format!(
                    "the estimator of the {peer} needs {theirs}, but the leg of this program \
                     senses {ours}"
                ),
            },
        }
    }
}

fn process(pid: Option<u32>) -> String {
    pid.map_or_else(String::new, |pid| format!(" (process {pid})"))
}

/// Returns the first session parameter on which the two sides disagree.
pub(super) fn disagreement(
    peer: Role,
    (their_version, theirs): (u16, SessionParams),
    (our_version, ours): (u16, SessionParams),
) -> Option<ConnectError> {
    // A time mode is compared when both have one. Numbers are equal if their texts are.
    let modes =
        theirs.time_mode.zip(ours.time_mode).unwrap_or((TimeMode::LockStep, TimeMode::LockStep));
    let text = |number: &dyn Display| number.to_string();
    let estimators = theirs.estimator.zip(ours.estimator).map(|(theirs, ours)| [theirs, ours]);
    let [their_estimator, our_estimator] =
        estimators.unwrap_or_default().map(|estimator| Described(estimator).to_string());
    let (senses, needs) = match peer {
        Role::Leg => (theirs.channels, ours.channels),
        Role::Controller => (ours.channels, theirs.channels),
    };
    let channels = (!senses.include(needs)).then_some([theirs.channels, ours.channels]);
    let [their_channels, our_channels] = channels.unwrap_or_default().map(|it| it.to_string());
    let ms = |ns: u64| (ns as f64 / 1e6).to_string();
    [
        (Parameter::SessionVersion, text(&their_version), text(&our_version)),
        (Parameter::WireVersion, text(&theirs.wire_version), text(&ours.wire_version)),
        (Parameter::Rate, text(&theirs.rate_hz), text(&ours.rate_hz)),
        (Parameter::Gravity, text(&theirs.gravity_m_s2), text(&ours.gravity_m_s2)),
        (Parameter::TimeMode, text(&modes.0), text(&modes.1)),
        (Parameter::StaleLimit, ms(theirs.stale_limit_ns), ms(ours.stale_limit_ns)),
        (Parameter::Estimator, their_estimator, our_estimator),
        (Parameter::Channels, their_channels, our_channels),
    ]
    .into_iter()
    .find(|(_, theirs, ours)| theirs != ours)
    .map(|(parameter, theirs, ours)| ConnectError::Disagreement {
        peer,
        parameter,
        theirs,
        ours,
    })
}

/// Returns the error of a failed action of the transport.
pub(super) fn failed(domain: &Domain, action: &'static str, cause: &dyn Display) -> ConnectError {
    ConnectError::Transport { action, domain: domain.name().to_owned(), cause: cause.to_string() }
}
