//! Errors of connecting two processes.

use std::fmt::{self, Display};
use std::time::Duration;

use crate::discovery::{Domain, DomainError, Whereabouts};
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
    /// Tick rate that the peer must have, Hz.
    pub rate_hz: u32,
    /// Gravity that the peer must have, m/s2.
    pub gravity_m_s2: f32,
    /// Time mode that the peer must have; `None` accepts either.
    pub time_mode: Option<TimeMode>,
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
        )
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
    /// The peer uses another version of the messages.
    #[error(
        "the {peer} uses version {theirs} of the messages, this program version {ours}; build both from the same release"
    )]
    WireVersion {
        /// Role of the peer.
        peer: Role,
        /// Version of the peer.
        theirs: u16,
        /// Version of this program.
        ours: u16,
    },
    /// The peer ticks at another rate.
    #[error("the {peer} runs at {theirs} Hz, this program at {ours} Hz")]
    Rate {
        /// Role of the peer.
        peer: Role,
        /// Rate of the peer, Hz.
        theirs: u32,
        /// Rate of this program, Hz.
        ours: u32,
    },
    /// The peer assumes another gravity.
    #[error("the {peer} is under a gravity of {theirs} m/s2, this program under {ours} m/s2")]
    Gravity {
        /// Role of the peer.
        peer: Role,
        /// Gravity of the peer, m/s2.
        theirs: f32,
        /// Gravity of this program, m/s2.
        ours: f32,
    },
    /// The peer runs in the other time mode.
    #[error("the {peer} runs in {theirs}, this program in {ours}")]
    TimeMode {
        /// Role of the peer.
        peer: Role,
        /// Time mode of the peer.
        theirs: TimeMode,
        /// Time mode of this program.
        ours: TimeMode,
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
            Self::WireVersion { .. }
                | Self::Rate { .. }
                | Self::Gravity { .. }
                | Self::TimeMode { .. }
        )
    }
}

fn process(pid: Option<u32>) -> String {
    pid.map_or_else(String::new, |pid| format!(" (process {pid})"))
}

/// Returns the first session parameter on which the two sides disagree.
pub(super) fn disagreement(
    peer: Role,
    theirs: SessionParams,
    ours: SessionParams,
) -> Option<ConnectError> {
    if theirs.wire_version != ours.wire_version {
        let (theirs, ours) = (theirs.wire_version, ours.wire_version);
        Some(ConnectError::WireVersion { peer, theirs, ours })
    } else if theirs.rate_hz != ours.rate_hz {
        let (theirs, ours) = (theirs.rate_hz, ours.rate_hz);
        Some(ConnectError::Rate { peer, theirs, ours })
    } else if theirs.gravity_m_s2.to_bits() != ours.gravity_m_s2.to_bits() {
        let (theirs, ours) = (theirs.gravity_m_s2, ours.gravity_m_s2);
        Some(ConnectError::Gravity { peer, theirs, ours })
    } else if let (Some(theirs), Some(ours)) = (theirs.time_mode, ours.time_mode)
        && theirs != ours
    {
        Some(ConnectError::TimeMode { peer, theirs, ours })
    } else {
        None
    }
}

/// Returns the error of a failed action of the transport.
pub(super) fn failed(domain: &Domain, action: &'static str, cause: &dyn Display) -> ConnectError {
    ConnectError::Transport { action, domain: domain.name().to_owned(), cause: cause.to_string() }
}
