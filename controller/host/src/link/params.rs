//! What the two sides of a link must agree on.

use std::fmt;

use leg_control::guard::SAFE_AFTER_NS;
use leg_control::leg::LegModel;
use leg_control::serial::message::Estimator;
use leg_control::wire::WIRE_VERSION;
use serde::{Deserialize, Serialize};

use crate::law::Channels;

/// The two roles on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Simulates or drives the leg: sends samples and receives commands.
    Leg,
    /// Controls the leg: receives samples and sends commands.
    Controller,
}

impl Role {
    /// Returns the other role.
    #[must_use]
    pub fn peer(self) -> Self {
        match self {
            Self::Leg => Self::Controller,
            Self::Controller => Self::Leg,
        }
    }

    /// Returns the name of the role in files, ports and JSON.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Leg => "leg",
            Self::Controller => "controller",
        }
    }
}

/// Formats the role as messages to the user name it: the leg is the simulator.
impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leg => "simulator",
            Self::Controller => "controller",
        })
    }
}

/// What advances the time of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeMode {
    /// Each tick waits for the command that answers its sample.
    LockStep,
    /// Both sides tick by the machine's clock; neither waits for the other.
    RealTime,
}

impl fmt::Display for TimeMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LockStep => "lock-step",
            Self::RealTime => "real time",
        })
    }
}

/// The parameters of a session that each side publishes before the first message.
///
/// Both sides must agree on all of them except the leg (a policy may be tried on a leg for which
/// it was not trained) and the channels: the leg may sense more than the law needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionParams {
    /// Version of the messages.
    pub wire_version: u16,
    /// Tick rate, Hz.
    pub rate_hz: u32,
    /// Gravity at the leg's location, m/s2.
    pub gravity_m_s2: f32,
    /// [`LegModel::fingerprint`] of the simulated leg, or of the leg that the
    /// policy was trained for; `None` if unspecified.
    pub leg: Option<u32>,
    /// What advances the time; `None` accepts either mode.
    pub time_mode: Option<TimeMode>,
    /// Age from which on a sample or a command counts for nothing, ns.
    #[serde(default = "usual_stale_limit_ns")]
    pub stale_limit_ns: u64,
    /// What the controller takes for the state; of a leg, what it wants a controller to take.
    /// `None` if unspecified, and accepts any.
    #[serde(default)]
    pub estimator: Option<Estimator>,
    /// What the leg senses; of a controller, what its law needs.
    #[serde(default)]
    pub channels: Channels,
}

fn usual_stale_limit_ns() -> u64 {
    SAFE_AFTER_NS
}

impl SessionParams {
    /// Returns the parameters for lock-step at `rate_hz` on Earth, with the wire
    /// version of this build and no leg specified.
    #[must_use]
    pub fn at(rate_hz: u32) -> Self {
        Self {
            wire_version: WIRE_VERSION,
            rate_hz,
            gravity_m_s2: 9.81,
            leg: None,
            time_mode: Some(TimeMode::LockStep),
            stale_limit_ns: SAFE_AFTER_NS,
            estimator: None,
            channels: Channels::default(),
        }
    }

    /// Returns the same parameters with another stale limit, ns.
    #[must_use]
    pub fn with_stale_limit(self, stale_limit_ns: u64) -> Self {
        Self { stale_limit_ns, ..self }
    }

    /// Returns the same parameters of a controller with this estimator.
    #[must_use]
    pub fn with_estimator(self, estimator: Estimator) -> Self {
        let channels = Channels::needed_by(estimator);
        Self { estimator: Some(estimator), channels, ..self }
    }

    /// Returns the same parameters with another time mode.
    #[must_use]
    pub fn with_time_mode(self, time_mode: TimeMode) -> Self {
        Self { time_mode: Some(time_mode), ..self }
    }

    /// Returns the same parameters, accepting either time mode of the peer.
    #[must_use]
    pub fn with_any_time_mode(self) -> Self {
        Self { time_mode: None, ..self }
    }

    /// Returns the same parameters with another gravity, m/s2.
    #[must_use]
    pub fn with_gravity(self, gravity_m_s2: f32) -> Self {
        Self { gravity_m_s2, ..self }
    }

    /// Returns the same parameters with the fingerprint of `leg`.
    #[must_use]
    pub fn with_leg(self, leg: &LegModel) -> Self {
        Self { leg: Some(leg.fingerprint()), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_of_the_leg_changes_its_fingerprint() {
        type Change = fn(&mut LegModel);
        let human = LegModel::HUMAN.fingerprint();
        let changes: [Change; 10] = [
            |leg| leg.mass_kg = 3.0,
            |leg| leg.added_mass_kg = 3.0,
            |leg| leg.stiffness_n_m = 3.0,
            |leg| leg.volume_m3 = 3.0,
            |leg| leg.rest_length_m = 3.0,
            |leg| leg.max_elongation_m = 3.0,
            |leg| leg.area_x_m2 = 3.0,
            |leg| leg.area_y_m2 = 3.0,
            |leg| leg.drag_x = 3.0,
            |leg| leg.drag_y = 3.0,
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut leg = LegModel::HUMAN;
            change(&mut leg);
            assert_ne!(leg.fingerprint(), human, "parameter {i}");
        }
    }
}
