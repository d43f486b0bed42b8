//! What the controller returns each tick: the command for the leg, the state of the
//! controller, and its telemetry.

use crate::guard::Reject;

/// Leg angle of the safe command, rad: upright.
pub const UPRIGHT_RAD: f32 = core::f32::consts::FRAC_PI_2;

/// What the leg does from one tick to the next.
///
/// The swinging leg is held at the angle. The spring's rest length is
/// `r0 + clamp(elongation_m + elongation_rate_m_s * s, 0, dr)`, `s` seconds after the
/// tick, with the leg's rest length `r0` and its largest elongation `dr`: a ramp that
/// may start inside a tick, from below zero.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LegCommand {
    /// Leg angle from the +x axis, rad, 0 to pi; the foot is ahead of the mass above pi/2.
    pub leg_angle_rad: f32,
    /// Elongation at the tick, m; below 0 before touchdown, at most the leg's largest.
    pub elongation_m: f32,
    /// Rate of the elongation, m/s, 0 or more.
    pub elongation_rate_m_s: f32,
}

impl LegCommand {
    /// The safe command: upright and passive. The spring bears the leg and adds no energy.
    pub const SAFE: Self =
        Self { leg_angle_rad: UPRIGHT_RAD, elongation_m: 0.0, elongation_rate_m_s: 0.0 };

    /// Returns whether every value is finite and within its range: the last check before
    /// a command leaves the controller.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        // A NaN is in no range.
        let is_within = |x: f32, most: f32| 0.0 <= x && x <= most;
        is_within(self.leg_angle_rad, core::f32::consts::PI)
            && self.elongation_m.abs() <= f32::MAX
            && is_within(self.elongation_rate_m_s, f32::MAX)
    }
}

/// The state of the controller in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// The command is [`LegCommand::SAFE`]: no measurement for too long, none yet, or no
    /// action to follow yet.
    Safe,
    /// No usable measurement in this tick: the last command is continued.
    Coasting,
    /// The command follows from the measurement of this tick.
    Running,
}

impl Status {
    /// Returns whether the command is the safe one.
    #[must_use]
    pub fn is_safe(self) -> bool {
        self == Self::Safe
    }
}

/// What the controller found out at the last apex, and its counters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Telemetry {
    /// Horizontal velocity at the last apex, m/s.
    pub apex_vx_m_s: f32,
    /// Height of the last apex above the ground, m.
    pub apex_y_m: f32,
    /// Density ratio that the actor was given at the last apex; none before the first.
    pub density_ratio: Option<f32>,
    /// Offset that the cascade subtracted from the observed velocity, m/s.
    pub velocity_offset_m_s: f32,
    /// Apexes since the start of the run.
    pub apexes: u32,
}

/// What [`Controller::step`](crate::control::Controller::step) returns.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output {
    /// What the leg does until the next tick. Always finite and in range.
    pub command: LegCommand,
    /// Whether the controller runs, coasts, or is in its safe state.
    pub status: Status,
    /// Why the measurement of this tick was not used; `None` when it was.
    pub rejected: Option<Reject>,
    /// Values at the last apex.
    pub telemetry: Telemetry,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_check_refuses_every_value_that_is_not_finite_or_out_of_range() {
        assert!(LegCommand::SAFE.is_valid());
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        for x in bad.into_iter().chain([-1e-3, 3.2]) {
            assert!(!LegCommand { leg_angle_rad: x, ..LegCommand::SAFE }.is_valid(), "{x} rad");
        }
        for x in bad {
            assert!(!LegCommand { elongation_m: x, ..LegCommand::SAFE }.is_valid(), "{x} m");
        }
        for x in bad.into_iter().chain([-0.1]) {
            let command = LegCommand { elongation_rate_m_s: x, ..LegCommand::SAFE };
            assert!(!command.is_valid(), "{x} m/s");
        }
    }
}
