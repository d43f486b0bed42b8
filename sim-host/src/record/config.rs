//! Fills the messages that describe a run: configuration, control law, timing, end.

use std::time::{SystemTime, UNIX_EPOCH};

use leg_control::serial::message::Estimator;
use leg_control::wire::WIRE_VERSION;
use leg_host::realtime::{RxStatus, TickStats};
use leg_host::{TimeMode, law};

use super::schema::{Config, End, LOCK_STEP, Law, Loop, Noise, REAL_TIME};
use crate::scenario::{Scenario, Settings};
use crate::session::{Ending, Outcome};

/// Describes a run of this program that begins now.
///
/// # Errors
/// If the settings have a number that TOML cannot represent.
pub fn of_run(
    settings: &Settings,
    scenario: &Scenario,
    time_mode: TimeMode,
) -> Result<Config, toml::ser::Error> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Ok(Config {
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

/// Describes a law with this estimator; `stepped` in turn with the leg.
#[must_use]
pub fn of_law(estimator: Estimator, stale_limit_ns: u64, stepped: bool) -> Law {
    let (name, noise) = law::parts(estimator);
    let noise = noise.into_iter().map(|(name, deviation)| Noise { name, deviation }).collect();
    Law { estimator: name, noise, stale_limit_ns, stepped }
}

/// Describes the timing of a tick of the leg's loop.
#[must_use]
pub fn of_tick(tick: &TickStats) -> Loop {
    Loop {
        seq: tick.seq,
        lateness_ns: i64::try_from(tick.lateness_ns).unwrap_or(i64::MAX),
        tick_ns: tick.work_ns,
        sample_age_ns: tick.sample_age_ns.unwrap_or(0),
        round_trip_ns: tick.round_trip_ns.unwrap_or(0),
        flags: u32::from(tick.rx == RxStatus::Stale) | u32::from(tick.safe) << 1,
    }
}

/// Describes the end of a run of which an observer has received `ticks` and missed `missed`.
#[must_use]
pub fn of_observed_end(ending: &str, ticks: u64, missed: u64) -> End {
    End { ending: ending.to_owned(), ticks, state_hash: String::new(), dropped: missed }
}

/// Describes a run that ended as planned, by a fall, or by a signal.
#[must_use]
pub fn of_end(outcome: &Outcome) -> End {
    let report = outcome.report();
    End {
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
