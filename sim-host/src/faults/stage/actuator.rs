//! Faults of the leg's actuators, which act on commands.
//!
//! The elongation is commanded as a ramp that may start below 0, where it means 0. An actuator
//! follows the ramp with its negative part set to 0.

use core::f64::consts::FRAC_PI_2;

use super::pipeline::{FaultStage, Now, Passed};
use leg_control::wire::Command;

/// Returns the commanded elongation at the tick of a command, m.
fn commanded_m(command: &Command) -> f64 {
    f64::from(command.elongation_m).max(0.0)
}

/// Returns the commanded elongation a tick later, m.
fn commanded_next_m(command: &Command, tick_s: f64) -> f64 {
    (f64::from(command.elongation_m) + f64::from(command.elongation_rate_m_s) * tick_s).max(0.0)
}

/// The state of the actuators at their last command.
#[derive(Clone, Copy, Debug)]
struct Pose {
    tick: u64,
    angle_rad: f64,
    elongation_m: f64,
}

/// Makes angle and elongation follow the command as a first-order lag, which reaches 63 % of a
/// step after one time constant.
#[derive(Debug)]
pub struct Lag {
    time_constant_s: f64,
    tick_s: f64,
    pose: Option<Pose>,
}

impl Lag {
    /// Creates a lag from its time constant and the length of a tick, s.
    #[must_use]
    pub fn new(time_constant_s: f64, tick_s: f64) -> Self {
        Self { time_constant_s, tick_s, pose: None }
    }

    /// Returns the share of a step that is complete after `ticks` ticks.
    fn step_response(&self, ticks: u64) -> f64 {
        if self.time_constant_s > 0.0 {
            -libm::expm1(-(ticks as f64) * self.tick_s / self.time_constant_s)
        } else {
            1.0
        }
    }
}

impl FaultStage<Command> for Lag {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let (angle_rad, elongation_m) = (f64::from(command.leg_angle_rad), commanded_m(&command));
        if !(angle_rad.is_finite() && elongation_m.is_finite()) {
            return Passed::untouched(message);
        }
        let commanded = Pose { tick: now.tick, angle_rad, elongation_m };
        let pose = match self.pose {
            // The first command sets the state.
            None => commanded,
            Some(pose) => {
                let done = self.step_response(now.tick - pose.tick);
                Pose {
                    tick: now.tick,
                    angle_rad: pose.angle_rad + done * (commanded.angle_rad - pose.angle_rad),
                    elongation_m: pose.elongation_m
                        + done * (commanded.elongation_m - pose.elongation_m),
                }
            }
        };
        self.pose = Some(pose);
        let next_m = pose.elongation_m
            + self.step_response(1) * (commanded_next_m(&command, self.tick_s) - pose.elongation_m);
        command.leg_angle_rad = pose.angle_rad as f32;
        command.elongation_m = pose.elongation_m as f32;
        command.elongation_rate_m_s = ((next_m - pose.elongation_m) / self.tick_s) as f32;
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}

/// A limit of an actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Limit of the angle from the vertical, rad.
    Angle(f64),
    /// Limit of the rate of the angle, rad/s.
    AngleRate(f64),
    /// Limit of the rate of the elongation, m/s.
    ElongationRate(f64),
}

/// Limits an actuator.
#[derive(Debug)]
pub struct Saturate {
    limit: Limit,
    tick_s: f64,
    pose: Option<Pose>,
}

impl Saturate {
    /// Creates an actuator with this limit; a tick takes `tick_s`, s.
    #[must_use]
    pub fn new(limit: Limit, tick_s: f64) -> Self {
        Self { limit, tick_s, pose: None }
    }
}

impl FaultStage<Command> for Saturate {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let (angle_rad, elongation_m) = (f64::from(command.leg_angle_rad), commanded_m(&command));
        if !(angle_rad.is_finite() && elongation_m.is_finite()) {
            return Passed::untouched(message);
        }
        let before = self.pose.unwrap_or(Pose { tick: now.tick, angle_rad, elongation_m });
        let passed_s = (now.tick - before.tick) as f64 * self.tick_s;
        let towards = |from: f64, to: f64, most: f64| from + (to - from).clamp(-most, most);
        let mut pose = Pose { tick: now.tick, angle_rad, elongation_m };
        match self.limit {
            Limit::Angle(most) => {
                pose.angle_rad = angle_rad.clamp(FRAC_PI_2 - most, FRAC_PI_2 + most);
            }
            Limit::AngleRate(most) => {
                pose.angle_rad = towards(before.angle_rad, angle_rad, most * passed_s);
            }
            Limit::ElongationRate(most) => {
                let here_m = towards(before.elongation_m, elongation_m, most * passed_s);
                pose.elongation_m = here_m;
                let next_m = commanded_next_m(&command, self.tick_s);
                let rate = (next_m - here_m) / self.tick_s;
                let keeps_up = here_m == elongation_m && rate.abs() <= most;
                if !keeps_up {
                    command.elongation_m = here_m as f32;
                    command.elongation_rate_m_s = rate.clamp(-most, most) as f32;
                }
            }
        }
        if pose.angle_rad != angle_rad {
            command.leg_angle_rad = pose.angle_rad as f32;
        }
        self.pose = Some(pose);
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}
