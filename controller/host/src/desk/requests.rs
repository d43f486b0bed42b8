//! What a running controller is asked, and what it answers.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::super::link::{PeerStatus, TimeMode};
use super::super::realtime::LoopReport;

/// A request to the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// What runs, and how it goes: answered by [`Status`].
    Status,
    /// Go on with this policy from the next apex: answered by [`Swapping`], or
    /// refused.
    Swap {
        /// What to call it in messages: its file.
        file: String,
        /// The policy blob.
        #[serde(with = "base64_text")]
        blob: Vec<u8>,
    },
    /// The policies of this process, for a recording: answered by [`Policies`].
    Policy,
}

/// The checksum of a blob, which names it; eight hexadecimal digits in text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Crc32(pub u32);

impl fmt::Display for Crc32 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

impl From<Crc32> for String {
    fn from(crc32: Crc32) -> Self {
        crc32.to_string()
    }
}

impl TryFrom<String> for Crc32 {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        u32::from_str_radix(&text, 16)
            .map(Self)
            .map_err(|_| format!("`{text}` is no checksum of eight hexadecimal digits"))
    }
}

/// A policy, as far as a reader of the status wants to know it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicyName {
    /// Its own name.
    pub name: String,
    /// Of its blob.
    pub crc32: Crc32,
    /// The file that it came from.
    pub file: String,
    /// How it was made, in a line.
    pub provenance: String,
}

/// A moment of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Moment {
    /// The run.
    pub run_id: u32,
    /// Its tick.
    pub seq: u64,
}

/// What the loop is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activity {
    /// No leg has come yet, or the one that was there is gone.
    Waiting,
    /// It answers samples, by the safe command.
    Safe,
    /// It answers samples, by its policy.
    Running,
}

/// What the guard has rejected, and how often it gave up, in this run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejected {
    /// Ticks without a sample to go by.
    pub ticks: u32,
    /// Those of them to which no sample came at all.
    pub missing: u32,
    /// Those that showed the last sample again.
    pub stale: u32,
    /// Times that the safe state was entered.
    pub safe_entered: u32,
}

/// How a controller is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Its process.
    pub pid: u32,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Gravity that it counts with, m/s2.
    pub gravity_m_s2: f32,
    /// What sets the time.
    pub pace: TimeMode,
    /// What it does.
    pub activity: Activity,
    /// The policy in force.
    pub policy: PolicyName,
    /// When that took over: wall time, s since 1970 began.
    pub since_unix_s: f64,
    /// The tick that it took over at; `None` when no sample has been answered since.
    pub since: Option<Moment>,
    /// The policy that waits for the next apex.
    pub pending: Option<PolicyName>,
    /// Policies taken up since the process began, the first not counted.
    pub swaps: u64,
    /// The last sample answered.
    pub last: Option<Moment>,
    /// Samples answered since the process began.
    pub ticks: u64,
    /// Apexes of this run.
    pub apexes: u32,
    /// What the guard has rejected in this run.
    pub rejected: Rejected,
    /// The leg's process.
    pub peer: PeerStatus,
    /// In real time: the loop's own figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<LoopReport>,
}

/// The answer to a swap that is taken.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swapping {
    /// Its number, from 1: it is in force when [`Status::swaps`] has come so far.
    pub number: u64,
    /// What it is.
    pub policy: PolicyName,
    /// The policy that is in force until then.
    pub instead_of: PolicyName,
}

/// A policy with its bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicyBytes {
    /// What it is.
    pub policy: PolicyName,
    /// Its blob.
    #[serde(with = "base64_text")]
    pub blob: Vec<u8>,
}

/// A swap as the controller was told of it.
///
/// To play it again: before the tick of [`at`](Self::at), swap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SwapRecord {
    /// Its number, from 1.
    pub number: u64,
    /// To this policy.
    pub crc32: Crc32,
    /// The first sample answered after the order; `None` until then.
    pub at: Option<Moment>,
}

/// The policies of a process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Policies {
    /// The one in force.
    pub running: PolicyBytes,
    /// The latest swaps, oldest first.
    pub swaps: Vec<SwapRecord>,
}

/// Bytes as base64 text.
mod base64_text {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;
    use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};

    pub(super) fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&STANDARD.encode(bytes))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        STANDARD.decode(String::deserialize(from)?).map_err(D::Error::custom)
    }
}
