//! Faults of the leg's actuators: on commands.
//!
//! The elongation is commanded as a ramp that may start below 0 and means 0
//! until it is above; an actuator that cannot follow it follows that.

use core::f64::consts::FRAC_PI_2;

use super::chain::{Now, Passed, Stage};
use leg_control::wire::Command;

/// What an actuator is asked at a command's tick.
fn asked_m(command: &Command) -> f64 {
    f64::from(command.elongation_m).max(0.0)
}

/// And a tick later.
fn asked_next_m(command: &Command, tick_s: f64) -> f64 {
    (f64::from(command.elongation_m) + f64::from(command.elongation_rate_m_s) * tick_s).max(0.0)
}

/// Where an actuator is, and when it was last commanded.
#[derive(Clone, Copy, Debug)]
struct Pose {
    tick: u64,
    angle_rad: f64,
    elongation_m: f64,
}

/// An angle and an elongation that follow what is asked as a first-order lag
/// does: after one time constant 63 % of a step.
#[derive(Debug)]
pub struct Lag {
    time_constant_s: f64,
    tick_s: f64,
    pose: Option<Pose>,
}

impl Lag {
    /// Of this time constant, at ticks of this length, s.
    #[must_use]
    pub fn new(time_constant_s: f64, tick_s: f64) -> Self {
        Self { time_constant_s, tick_s, pose: None }
    }

    /// How much of a step is done after so many ticks.
    fn done(&self, ticks: u64) -> f64 {
        if self.time_constant_s > 0.0 {
            -libm::expm1(-(ticks as f64) * self.tick_s / self.time_constant_s)
        } else {
            1.0
        }
    }
}

impl Stage<Command> for Lag {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let (angle_rad, elongation_m) = (f64::from(command.leg_angle_rad), asked_m(&command));
        if !(angle_rad.is_finite() && elongation_m.is_finite()) {
            return Passed::untouched(message);
        }
        let asked = Pose { tick: now.tick, angle_rad, elongation_m };
        let pose = match self.pose {
            // It stands where it is first sent.
            None => asked,
            Some(pose) => {
                let done = self.done(now.tick - pose.tick);
                Pose {
                    tick: now.tick,
                    angle_rad: pose.angle_rad + done * (asked.angle_rad - pose.angle_rad),
                    elongation_m: pose.elongation_m
                        + done * (asked.elongation_m - pose.elongation_m),
                }
            }
        };
        self.pose = Some(pose);
        let next_m = pose.elongation_m
            + self.done(1) * (asked_next_m(&command, self.tick_s) - pose.elongation_m);
        command.leg_angle_rad = pose.angle_rad as f32;
        command.elongation_m = pose.elongation_m as f32;
        command.elongation_rate_m_s = ((next_m - pose.elongation_m) / self.tick_s) as f32;
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}

/// What an actuator cannot exceed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// The angle from the vertical, rad.
    Angle(f64),
    /// The speed of the angle, rad/s.
    AngleRate(f64),
    /// The speed of the elongation, m/s.
    ElongationRate(f64),
}

/// An actuator at its limit.
#[derive(Debug)]
pub struct Saturate {
    limit: Limit,
    tick_s: f64,
    pose: Option<Pose>,
}

impl Saturate {
    /// With this limit, at ticks of this length, s.
    #[must_use]
    pub fn new(limit: Limit, tick_s: f64) -> Self {
        Self { limit, tick_s, pose: None }
    }
}

impl Stage<Command> for Saturate {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let (angle_rad, elongation_m) = (f64::from(command.leg_angle_rad), asked_m(&command));
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
                let next_m = asked_next_m(&command, self.tick_s);
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
