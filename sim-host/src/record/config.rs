//! What a recording says of its run.

use std::time::{SystemTime, UNIX_EPOCH};

use leg_control::policy;
use leg_control::wire::WIRE_VERSION;
use leg_host::Pace;
use leg_host::realtime::{Row, Word};

use super::schema::{Config, End, Loop, Policy};
use crate::scenario::{Scenario, Settings};
use crate::session::{Ending, Outcome};

/// How [`Config::pace`] says it.
pub const LOCK_STEP: &str = "lock-step";
/// How [`Config::pace`] says it.
pub const REAL_TIME: &str = "real-time";

impl Config {
    /// Of a run that begins now, of this program as it was called.
    ///
    /// # Errors
    /// When the settings have a number that TOML does not: a seed of 2^63 or more.
    pub fn of(
        settings: &Settings,
        scenario: &Scenario,
        pace: Pace,
    ) -> Result<Self, toml::ser::Error> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Ok(Self {
            scenario_toml: toml::to_string(settings)?,
            sim_host_version: env!("CARGO_PKG_VERSION").to_owned(),
            wire_version: WIRE_VERSION.into(),
            rate_hz: scenario.rate_hz,
            gravity_m_s2: scenario.controller_gravity_m_s2(),
            pace: match pace {
                Pace::LockStep => LOCK_STEP,
                Pace::RealTime => REAL_TIME,
            }
            .to_owned(),
            command_line: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
            started_unix_ns: since.as_nanos() as u64,
        })
    }
}

impl Policy {
    /// A policy that passed its checks, given to the controller before a tick.
    #[must_use]
    pub fn of(blob: &[u8], policy: &policy::Policy<'_>, run_id: u32, seq: u64) -> Self {
        let crc32 = blob.last_chunk().copied().map_or(0, u32::from_le_bytes);
        let name = policy.manifest().name.to_owned();
        Self { name, crc32, blob: blob.to_vec(), run_id, seq }
    }
}

impl Loop {
    /// A row of the leg's loop.
    #[must_use]
    pub fn of(row: &Row) -> Self {
        Self {
            seq: row.seq,
            lateness_ns: i64::try_from(row.lateness_ns).unwrap_or(i64::MAX),
            tick_ns: row.work_ns,
            sample_age_ns: row.sample_age_ns.unwrap_or(0),
            round_trip_ns: row.round_trip_ns.unwrap_or(0),
            flags: u32::from(row.word == Word::Stale) | u32::from(row.safe) << 1,
        }
    }
}

impl End {
    /// Of a run that came to its end.
    #[must_use]
    pub fn of(outcome: &Outcome) -> Self {
        let report = outcome.report();
        Self {
            ending: match report.ending {
                Ending::Duration => "duration",
                Ending::Distance => "distance",
                Ending::Fall => "fall",
                Ending::Stopped => "stopped",
            }
            .to_owned(),
            ticks: report.ticks,
            state_hash: report.state_hash,
            dropped: 0,
        }
    }

    /// Of a run that broke off.
    #[must_use]
    pub fn broken_off(cause: &impl std::fmt::Display) -> Self {
        Self { ending: cause.to_string(), ..Self::default() }
    }
}
