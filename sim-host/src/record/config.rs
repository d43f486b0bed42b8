//! Fills the messages that describe a run: configuration, policies, timing, end.

use std::time::{SystemTime, UNIX_EPOCH};

use leg_control::policy;
use leg_control::serial::message::Estimator;
use leg_control::wire::WIRE_VERSION;
use leg_host::realtime::{RxStatus, TickStats};
use leg_host::{TimeMode, law};

use super::schema::{Config, End, Law, Loop, Noise, Policy};
use crate::scenario::{Scenario, Settings};
use crate::session::{Ending, Outcome};

/// [`Config::time_mode`] of a run in lock-step.
pub const LOCK_STEP: &str = "lock-step";
/// [`Config::time_mode`] of a run in real time.
pub const REAL_TIME: &str = "real-time";

impl Config {
    /// Describes a run of this program that begins now.
    ///
    /// # Errors
    /// If the settings have a number that TOML cannot represent.
    pub fn of(
        settings: &Settings,
        scenario: &Scenario,
        time_mode: TimeMode,
    ) -> Result<Self, toml::ser::Error> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Ok(Self {
            scenario_toml: toml::to_string(settings)?,
            sim_host_version: env!("CARGO_PKG_VERSION").to_owned(),
            wire_version: WIRE_VERSION.into(),
            rate_hz: scenario.rate_hz,
            gravity_m_s2: scenario.controller_gravity_m_s2(),
            time_mode: match time_mode {
                TimeMode::LockStep => LOCK_STEP,
                TimeMode::RealTime => REAL_TIME,
            }
            .to_owned(),
            command_line: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
            started_unix_ns: since.as_nanos() as u64,
        })
    }
}

impl Law {
    /// Describes a law with this estimator; `stepped` in turn with the leg.
    #[must_use]
    pub fn of(estimator: Estimator, stale_limit_ns: u64, stepped: bool) -> Self {
        let (name, noise) = law::parts(estimator);
        let noise = noise.into_iter().map(|(name, deviation)| Noise { name, deviation }).collect();
        Self { estimator: name, noise, stale_limit_ns, stepped }
    }

    /// Returns the estimator.
    ///
    /// # Errors
    /// A message with the name of an estimator or of a noise that this program does not know.
    pub fn estimator(&self) -> Result<Estimator, String> {
        let noise = self.noise.iter().map(|noise| (noise.name.as_str(), noise.deviation));
        law::from_parts(&self.estimator, noise)
    }
}

impl Policy {
    /// Describes a policy that the controller receives before tick `seq`.
    #[must_use]
    pub fn of(blob: &[u8], policy: &policy::Policy<'_>, run_id: u32, seq: u64) -> Self {
        let crc32 = blob.last_chunk().copied().map_or(0, u32::from_le_bytes);
        let name = policy.manifest().name.to_owned();
        Self { name, crc32, blob: blob.to_vec(), run_id, seq }
    }
}

impl Loop {
    /// Describes the timing of a tick of the leg's loop.
    #[must_use]
    pub fn of(tick: &TickStats) -> Self {
        Self {
            seq: tick.seq,
            lateness_ns: i64::try_from(tick.lateness_ns).unwrap_or(i64::MAX),
            tick_ns: tick.work_ns,
            sample_age_ns: tick.sample_age_ns.unwrap_or(0),
            round_trip_ns: tick.round_trip_ns.unwrap_or(0),
            flags: u32::from(tick.rx == RxStatus::Stale) | u32::from(tick.safe) << 1,
        }
    }
}

impl End {
    /// Describes a run that ended as planned, by a fall, or by a signal.
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

    /// Describes a run that ended with an error.
    #[must_use]
    pub fn broken_off(cause: &impl std::fmt::Display) -> Self {
        Self { ending: cause.to_string(), ..Self::default() }
    }
}
