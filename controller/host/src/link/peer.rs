//! The process at the other end of a link.

use leg_control::serial::message::Estimator;
use serde::{Deserialize, Serialize};

use super::params::Role;

/// A connected peer whose session parameters agree with this end's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peer {
    /// Role of the peer.
    pub role: Role,
    /// Process id of the peer.
    pub pid: u32,
    /// [`fingerprint`](leg_control::leg::LegModel::fingerprint) of the leg that the
    /// peer simulates or has a policy for; `None` if it does not specify one.
    pub leg: Option<u32>,
    /// What a controller takes for the state, or a leg wants it to take; `None` if it does not
    /// say.
    pub estimator: Option<Estimator>,
}

/// The state of the connection to the peer, for a status report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PeerStatus {
    /// Process id of the connected peer, if there is one.
    pub pid: Option<u32>,
    /// How often a peer has connected.
    pub connections: u64,
    /// How often a connected peer was gone, by the end of its run or otherwise.
    pub losses: u64,
}
