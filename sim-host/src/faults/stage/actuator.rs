//! Faults of the leg's actuators, which act on commands.
//!
//! The elongation is commanded as a ramp that may start below 0, where it means 0. An actuator
//! follows the ramp with its negative part set to 0.

use core::f64::consts::{FRAC_PI_2, TAU};
use std::collections::VecDeque;

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

/// Position and velocity of a critically damped second-order lag.
#[derive(Clone, Copy, Debug)]
struct SecondOrder {
    position: f64,
    velocity: f64,
}

impl SecondOrder {
    fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0 }
    }

    /// Returns the state after `t_s` under a constant input: the exact solution of
    /// `x'' = w w (input - x) - 2 w x'`, with the natural frequency `w` in rad/s.
    fn after(self, t_s: f64, input: f64, natural_rad_s: f64) -> Self {
        let off = self.position - input;
        let drift = self.velocity + natural_rad_s * off;
        let kept = libm::exp(-natural_rad_s * t_s);
        Self {
            position: input + kept * (off + drift * t_s),
            velocity: kept * (self.velocity - natural_rad_s * drift * t_s),
        }
    }
}

/// Makes angle and elongation follow the command as a critically damped second-order lag.
#[derive(Debug)]
pub struct Bandwidth {
    natural_rad_s: f64,
    tick_s: f64,
    /// Tick of the last command, angle (rad) and elongation (m).
    state: Option<(u64, SecondOrder, SecondOrder)>,
}

impl Bandwidth {
    /// Creates actuators from the frequency at which they follow a sine with 3 dB less amplitude,
    /// Hz, and the length of a tick, s.
    #[must_use]
    pub fn new(bandwidth_hz: f64, tick_s: f64) -> Self {
        // The gain is 1 / (1 + (f / f0)^2), which is 1 / sqrt(2) at f = f0 sqrt(sqrt(2) - 1).
        let over_natural = (core::f64::consts::SQRT_2 - 1.0).sqrt();
        Self { natural_rad_s: TAU * bandwidth_hz / over_natural, tick_s, state: None }
    }
}

impl FaultStage<Command> for Bandwidth {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let (angle_rad, elongation_m) = (f64::from(command.leg_angle_rad), commanded_m(&command));
        if !(angle_rad.is_finite() && elongation_m.is_finite()) {
            return Passed::untouched(message);
        }
        let [angle, elongation] = match self.state {
            // The first command sets the state.
            None => [angle_rad, elongation_m].map(SecondOrder::at_rest),
            Some((tick, angle, elongation)) => {
                let passed_s = (now.tick - tick) as f64 * self.tick_s;
                [(angle, angle_rad), (elongation, elongation_m)]
                    .map(|(state, input)| state.after(passed_s, input, self.natural_rad_s))
            }
        };
        self.state = Some((now.tick, angle, elongation));
        let next_input_m = commanded_next_m(&command, self.tick_s);
        let next = elongation.after(self.tick_s, next_input_m, self.natural_rad_s);
        command.leg_angle_rad = angle.position as f32;
        command.elongation_m = elongation.position as f32;
        command.elongation_rate_m_s = ((next.position - elongation.position) / self.tick_s) as f32;
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}

/// The set-points of a command, and its tick.
#[derive(Clone, Copy, Debug)]
struct SetPoints {
    tick: u64,
    angle_rad: f32,
    elongation_m: f32,
    elongation_rate_m_s: f32,
}

/// Makes the actuators react late: they follow the set-points of some ticks ago. In contrast to a
/// late message, the command has a stamp of this tick, so nothing can make up for it.
#[derive(Debug)]
pub struct DeadTime {
    ticks: u64,
    tick_s: f64,
    /// Set-points that have not taken effect, behind those that have.
    waiting: VecDeque<SetPoints>,
}

impl DeadTime {
    /// Creates actuators from their dead time in ticks and the length of a tick, s.
    #[must_use]
    pub fn new(ticks: u32, tick_s: f64) -> Self {
        // One for each tick of the dead time, this tick's, and the one in effect.
        let waiting = VecDeque::with_capacity(ticks as usize + 2);
        Self { ticks: ticks.into(), tick_s, waiting }
    }
}

impl FaultStage<Command> for DeadTime {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        // The last command of a tick counts.
        self.waiting.pop_back_if(|last| last.tick == now.tick);
        self.waiting.push_back(SetPoints {
            tick: now.tick,
            angle_rad: command.leg_angle_rad,
            elongation_m: command.elongation_m,
            elongation_rate_m_s: command.elongation_rate_m_s,
        });
        let in_effect = |at: &SetPoints| at.tick + self.ticks <= now.tick;
        while self.waiting.get(1).is_some_and(in_effect) {
            self.waiting.pop_front();
        }
        // Before the first ones take effect, they count as those of long ago.
        if let Some(old) = self.waiting.front() {
            command.leg_angle_rad = old.angle_rad;
            command.elongation_rate_m_s = old.elongation_rate_m_s;
            command.elongation_m = match now.tick.saturating_sub(old.tick + self.ticks) {
                0 => old.elongation_m,
                // The ramp goes on while no newer set-points come.
                ticks => {
                    let since_s = (ticks as f64 * self.tick_s) as f32;
                    old.elongation_m + old.elongation_rate_m_s * since_s
                }
            };
        }
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}

/// The actuator that a backlash affects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// The leg angle, rad.
    Angle,
    /// The elongation, m.
    Elongation,
}

/// Gives an actuator play: the leg stays where it is until the drive has crossed the gap, and
/// follows half the gap behind it. The load does not move the leg within the gap.
#[derive(Debug)]
pub struct Backlash {
    drive: Drive,
    half_gap: f64,
    tick_s: f64,
    position: Option<f64>,
}

impl Backlash {
    /// Creates the play of a drive from the width of its gap, rad or m, and the length of a tick, s.
    #[must_use]
    pub fn new(drive: Drive, gap: f64, tick_s: f64) -> Self {
        Self { drive, half_gap: 0.5 * gap, tick_s, position: None }
    }

    fn follow(&self, position: f64, input: f64) -> f64 {
        position.clamp(input - self.half_gap, input + self.half_gap)
    }
}

impl FaultStage<Command> for Backlash {
    fn pass(&mut self, now: Now, message: Option<Command>) -> Passed<Command> {
        let Some(mut command) = message.filter(|_| now.active) else {
            return Passed::untouched(message);
        };
        let input = match self.drive {
            Drive::Angle => f64::from(command.leg_angle_rad),
            Drive::Elongation => commanded_m(&command),
        };
        if !input.is_finite() {
            return Passed::untouched(message);
        }
        let position = self.follow(self.position.unwrap_or(input), input);
        self.position = Some(position);
        match self.drive {
            Drive::Angle => command.leg_angle_rad = position as f32,
            Drive::Elongation => {
                let next_input = commanded_next_m(&command, self.tick_s);
                let next = self.follow(position, next_input);
                if next.is_finite() && (position != input || next != next_input) {
                    command.elongation_m = position as f32;
                    command.elongation_rate_m_s = ((next - position) / self.tick_s) as f32;
                }
            }
        }
        Passed { touched: Some(command) != message, message: Some(command) }
    }
}
