//! Why two processes did not come together.

use std::fmt;
use std::time::Duration;

use crate::card::{Pace, Role};
use crate::domain::{DomainError, apart_from};

/// The peer that has not come, and how to start it.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Who.
    pub peer: Role,
    /// Where.
    pub domain: String,
    /// Waited for until now.
    pub waited: Duration,
    /// The rate that it has to have, Hz.
    pub rate_hz: u32,
    /// The gravity that it has to be told, m/s2.
    pub gravity_m_s2: f32,
    /// The pace that it has to have; `None` is either.
    pub pace: Option<Pace>,
    /// Other users with domains in the same place.
    pub other_users: Vec<u32>,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { peer, domain, waited, rate_hz, gravity_m_s2, pace, other_users } = self;
        let pace = if *pace == Some(Pace::RealTime) { " --real-time" } else { "" };
        write!(
            f,
            "no {peer} in domain `{domain}` after {:.1} s{}; start one with `{} --domain {domain} --rate {rate_hz} --gravity {gravity_m_s2}{pace}`",
            waited.as_secs_f64(),
            apart_from(other_users),
            peer.start_hint()
        )
    }
}

/// Why two processes did not come together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// No peer in time.
    #[error("{0}; --timeout sets how long to wait")]
    PeerMissing(Missing),
    /// The role is taken.
    #[error(
        "a {role} is already running in domain `{domain}`{}; end it, or choose another --domain for both sides",
        by(*pid)
    )]
    RoleTaken {
        /// Which role.
        role: Role,
        /// By which process, if it says.
        pid: Option<u32>,
        /// Where.
        domain: String,
    },
    /// The peer's messages are of another version.
    #[error(
        "the {peer} speaks version {theirs} of the messages, this program version {ours}; build both from the same release"
    )]
    WireVersion {
        /// Who.
        peer: Role,
        /// The peer's version.
        theirs: u16,
        /// This program's.
        ours: u16,
    },
    /// The peer ticks at another rate.
    #[error("the {peer} runs at {theirs} Hz, this program at {ours} Hz; give both the same --rate")]
    Rate {
        /// Who.
        peer: Role,
        /// The peer's rate, Hz.
        theirs: u32,
        /// This program's, Hz.
        ours: u32,
    },
    /// The peer counts with another gravity.
    #[error(
        "the {peer} is under a gravity of {theirs} m/s2, this program under {ours} m/s2; give both the same --gravity"
    )]
    Gravity {
        /// Who.
        peer: Role,
        /// The peer's gravity, m/s2.
        theirs: f32,
        /// This program's, m/s2.
        ours: f32,
    },
    /// The peer's time is set by something else.
    #[error(
        "the {peer} runs in {theirs}, this program in {ours}; give --real-time to both sides, or to neither"
    )]
    Pace {
        /// Who.
        peer: Role,
        /// The peer's pace.
        theirs: Pace,
        /// This program's.
        ours: Pace,
    },
    /// The domain cannot be joined.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// This process was told to stop, by a signal.
    #[error("stopped by a signal while waiting for the {0}")]
    Stopped(Role),
    /// iceoryx2 or the system refused.
    #[error("cannot {action} in domain `{domain}`: {cause}")]
    Transport {
        /// What was being done.
        action: &'static str,
        /// Where.
        domain: String,
        /// What the transport says.
        cause: String,
    },
}

impl ConnectError {
    /// Whether a peer is there that does not fit: another may.
    #[must_use]
    pub fn is_misfit(&self) -> bool {
        matches!(
            self,
            Self::WireVersion { .. } | Self::Rate { .. } | Self::Gravity { .. } | Self::Pace { .. }
        )
    }
}

fn by(pid: Option<u32>) -> String {
    pid.map_or_else(String::new, |pid| format!(" (process {pid})"))
}
