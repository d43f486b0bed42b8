//! The status of a controller process: the JSON document that answers
//! [`Request::Report`](leg_control::serial::message::Request::Report).

use std::fmt;

use leg_control::serial::message::{Activity, Estimator, RejectCounts, RunTick};
use serde::{Deserialize, Serialize};

use super::link::{PeerStatus, TimeMode};
use super::realtime::LoopReport;

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

/// The status of a controller process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Process id.
    pub pid: u32,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
    /// What sets the time.
    pub time_mode: TimeMode,
    /// What the control law takes for the state.
    #[serde(default)]
    pub estimator: Option<Estimator>,
    /// Age from which on a sample counts for nothing, ns.
    #[serde(default)]
    pub stale_limit_ns: Option<u64>,
    /// What it is doing.
    pub activity: Activity,
    /// The policy in force.
    pub policy: PolicyName,
    /// When that took over: wall time, s since 1970 began, to some 10 ms.
    pub since_unix_s: f64,
    /// The tick that it took over at; `None` when no sample has been answered since.
    pub since: Option<RunTick>,
    /// The policy that waits for the next apex.
    pub pending: Option<PolicyName>,
    /// Policies that took over since the process began, the first not counted.
    pub swaps: u64,
    /// The last sample answered.
    pub last: Option<RunTick>,
    /// Samples answered since the process began.
    pub ticks: u64,
    /// The set-point in force in place of that in the samples, m/s: of all runs, until another
    /// request.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_point_m_s: Option<f32>,
    /// Apexes of this run.
    pub apexes: u32,
    /// What the guard has rejected in this run.
    pub rejected: RejectCounts,
    /// The leg's process.
    pub peer: PeerStatus,
    /// The latest swaps, oldest first.
    #[serde(default)]
    pub swap_log: Vec<SwapRecord>,
    /// The policy before the oldest of these swaps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before_swaps: Option<Crc32>,
    /// The latest requests for another set-point, oldest first.
    #[serde(default)]
    pub set_point_log: Vec<SetPointRecord>,
    /// In real time: the loop's own figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<LoopReport>,
}

/// A swap as the control loop took it. To repeat it, swap before tick
/// [`at`](Self::at).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SwapRecord {
    /// Its number, from 1.
    pub number: u64,
    /// CRC-32 of the policy.
    pub crc32: Crc32,
    /// The first tick with a sample after the order; `None` until then.
    pub at: Option<RunTick>,
}

/// A set-point in place of that in the samples, as the control loop took it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetPointRecord {
    /// Its number, from 1.
    pub number: u64,
    /// The set-point, m/s; `None` returns to that in the samples.
    pub set_point_m_s: Option<f32>,
    /// The first tick with a sample after the order; `None` until then.
    pub at: Option<RunTick>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_is_eight_hexadecimal_digits_in_text() {
        let text = serde_json::to_string(&Crc32(0xab)).unwrap();
        assert_eq!(text, "\"000000ab\"");
        assert_eq!(serde_json::from_str::<Crc32>(&text).unwrap(), Crc32(0xab));
        assert!(serde_json::from_str::<Crc32>("\"policy\"").is_err());
    }
}
