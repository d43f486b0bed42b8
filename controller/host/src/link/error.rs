//! Errors of an established link.

use super::params::Role;

/// An established link can no longer be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The peer's process ended without closing its end: it crashed or was killed.
    #[error("the {role} (process {pid}) died")]
    PeerDied {
        /// Role of the peer.
        role: Role,
        /// Process id of the peer.
        pid: u32,
    },
    /// The peer closed its end.
    #[error(
        "the {role} (process {pid}) left before the run was over; see its own output for the reason"
    )]
    PeerLeft {
        /// Role of the peer.
        role: Role,
        /// Process id of the peer.
        pid: u32,
    },
    /// The peer is gone and no other has connected in time.
    #[error("{cause}; no other connected within {:.1} s", *waited_ms as f64 * 1e-3)]
    ReconnectTimeout {
        /// How the peer was lost.
        cause: Box<LinkError>,
        /// How long the link waited for another peer, ms.
        waited_ms: u64,
    },
    /// A signal asked this process to stop.
    #[error("stopped by a signal")]
    Stopped,
    /// The transport failed.
    #[error("cannot {action}: {cause}")]
    Transport {
        /// The action that failed.
        action: &'static str,
        /// Error of the transport.
        cause: String,
    },
}

impl LinkError {
    /// Returns the process id of the peer if the error is the loss of the peer.
    #[must_use]
    pub fn lost_peer(&self) -> Option<u32> {
        match self {
            Self::PeerDied { pid, .. } | Self::PeerLeft { pid, .. } => Some(*pid),
            Self::ReconnectTimeout { .. } | Self::Stopped | Self::Transport { .. } => None,
        }
    }
}
