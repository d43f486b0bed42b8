//! The control law: one call a tick, from a measurement to a command.

use crate::actor::Observation;
use crate::command::{LegCommand, Output, Status, Telemetry};
use crate::config::{Config, Estimation};
use crate::gait::{Apex, Gait};
use crate::guard::{Counts, Guard, InRange, Limits, Reject, Trusted, Verdict};
use crate::math::clamp;
use crate::measurement::Measurement;
use crate::medium::DensityEstimator;
use crate::policy::Policy;
use crate::velocity::{Cascade, gains_at};
use estimated::Tracked;

#[cfg(feature = "estimator")]
mod estimated;
#[cfg(not(feature = "estimator"))]
#[path = "control/read.rs"]
mod estimated;

/// Measurements in flight from which a leg that starts, or restarts, in mid-air first
/// estimates the density: 8 ms at 1 kHz, a small part of any fall, and enough for a
/// hundredth of density even in f32.
const START_MEASUREMENTS: usize = 8;

/// The whole controller: guard, gait, density estimate, cascade, actor; with an estimator
/// of the state between guard and gait where [`Config::estimation`] asks for one.
///
/// It knows time only by the measurements' stamps and the fixed tick, so the same
/// object runs on a microcontroller and in the host process; the trainer evaluates with
/// its actor and its cascade.
#[derive(Clone, Debug)]
pub struct Controller<'a> {
    policy: Policy<'a>,
    config: Config,
    guard: Guard,
    gait: Gait,
    estimator: DensityEstimator,
    cascade: Cascade,
    /// The state estimator; none where the readings are the state.
    tracked: Option<Tracked>,
    telemetry: Telemetry,
    command: LegCommand,
    set_point_m_s: f32,
    /// The policy to switch to at the next apex.
    next: Option<Policy<'a>>,
}

impl<'a> Controller<'a> {
    /// Returns a controller at the start of its first run, in the safe state.
    #[must_use]
    pub fn new(policy: Policy<'a>, config: Config) -> Self {
        Self {
            cascade: Cascade::new(),
            gait: Self::gait(&policy),
            guard: Guard::new(config.limits(), config.tick_ns(), config.stale_limit_ns()),
            tracked: Tracked::new(&policy, &config),
            estimator: DensityEstimator::new(),
            telemetry: Telemetry::default(),
            command: LegCommand::SAFE,
            set_point_m_s: 0.0,
            next: None,
            policy,
            config,
        }
    }

    /// Forgets everything but the policy, as if made anew with `config`. A policy that
    /// waits for an apex is switched to at once.
    pub fn restart(&mut self, config: Config) {
        self.take_next();
        self.config = config;
        self.guard = Guard::new(config.limits(), config.tick_ns(), config.stale_limit_ns());
        self.command = LegCommand::SAFE;
        self.set_point_m_s = 0.0;
        self.begin_estimate();
        self.forget();
    }

    /// Announces that the next measurement begins another run: its time may be any; with
    /// it the controller forgets the run before, and counters start at 0. The set-point
    /// is 0 until the next one.
    pub fn begin_run(&mut self) {
        self.guard.begin_run();
        self.set_point_m_s = 0.0;
    }

    /// Switches to another policy: at the next apex, or at once when no action is in
    /// force. One that still waits is dropped for this one.
    ///
    /// At that apex all of the new policy holds: its leg, its media, its gains and its
    /// actor. What the run has taught is kept: the medium, the cascade's integral (an
    /// offset in m/s, so new gains give no kick) and the last apex.
    pub fn swap(&mut self, policy: Policy<'a>) {
        self.next = Some(policy);
        if !self.gait.has_action() {
            self.take_next();
        }
    }

    /// Returns whether a policy waits for the next apex.
    #[must_use]
    pub fn swap_is_pending(&self) -> bool {
        self.next.is_some()
    }

    /// Returns the policy in force.
    #[must_use]
    pub fn policy(&self) -> &Policy<'a> {
        &self.policy
    }

    /// Returns the configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Returns what was rejected since the start of the run.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.guard.counts()
    }

    /// Returns the limits of measurements and set-points.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        self.config.limits()
    }

    /// Returns the set-point in force, m/s: the last one that was accepted.
    #[must_use]
    pub fn set_point_m_s(&self) -> f32 {
        self.set_point_m_s
    }

    /// Runs one tick: takes the measurement of this tick, or `None` when there is none,
    /// and the wanted mean horizontal velocity, m/s; returns what the leg does until the
    /// next tick.
    ///
    /// A set-point that is not finite or beyond [`Limits::max_speed_m_s`] is refused: the
    /// last accepted one is held, and [`Counts::set_points_refused`] rises. It never costs
    /// a measurement.
    #[inline]
    pub fn step(&mut self, measurement: Option<&Measurement>, set_point_m_s: f32) -> Output {
        let checked = match measurement {
            Some(measurement) => self.check(measurement),
            None => Err(Reject::Missing),
        };
        let (status, rejected) = self.step_checked(checked, set_point_m_s);
        Output { command: self.command, status, rejected, telemetry: self.telemetry }
    }

    /// Checks the values of a measurement: all of them ([`Limits::check`]), or with an
    /// estimator each by itself ([`Limits::check_channels`]).
    ///
    /// # Errors
    /// [`Reject::NonFinite`] or [`Reject::OutOfRange`].
    #[inline]
    pub fn check<'m>(&self, measurement: &'m Measurement) -> Result<InRange<'m>, Reject> {
        match self.config.estimation() {
            Estimation::Readings => self.limits().check(measurement),
            #[cfg(feature = "estimator")]
            Estimation::StateChannels(_) => self.limits().check_channels(measurement),
            #[cfg(feature = "estimator")]
            Estimation::Inertial(_) => self.limits().check_sensors(measurement),
        }
    }

    /// Runs one tick as [`Self::step`] does, with a measurement whose values have been
    /// checked by [`Self::check`], or the reason why there is none: for adapters of a
    /// message format, which reject messages for reasons of their own. Returns the status,
    /// and why the measurement was not used; [`Self::command`] and [`Self::telemetry`]
    /// return the rest, which is then not copied.
    pub fn step_checked(
        &mut self,
        measurement: Result<InRange<'_>, Reject>,
        set_point_m_s: f32,
    ) -> (Status, Option<Reject>) {
        self.take_set_point(set_point_m_s);
        let (measurement, restarts) = match self.guard.judge(measurement) {
            Verdict::Use(measurement) => (measurement, false),
            Verdict::Restart(measurement) => (measurement, true),
            Verdict::Coast(reject) => {
                self.coast();
                return (self.checked(Status::Coasting), Some(reject));
            }
            Verdict::Safe(reject) => {
                self.take_next();
                self.gait = Self::gait(&self.policy);
                self.command = LegCommand::SAFE;
                return (Status::Safe, reject);
            }
        };
        if restarts {
            self.take_next();
            self.forget();
        }
        let status = if self.tracked.is_some() {
            self.advance_estimated(measurement)
        } else {
            self.advance(measurement)
        };
        (status, None)
    }

    /// Returns what the leg does until the next tick. Always finite and in range.
    #[must_use]
    pub fn command(&self) -> &LegCommand {
        &self.command
    }

    /// Returns what was found out at the last apex.
    #[must_use]
    pub fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    fn gait(policy: &Policy<'_>) -> Gait {
        let leg = &policy.manifest().leg;
        Gait::new(leg.rest_length_m, leg.max_elongation_m)
    }

    /// Switches to the policy that waits, if one does. Apart, so that the stack of an
    /// ordinary tick has no room for a policy.
    #[inline(never)]
    fn take_next(&mut self) {
        let Some(policy) = self.next.take() else { return };
        let manifest = policy.manifest();
        self.gait.set_lengths(manifest.leg.rest_length_m, manifest.leg.max_elongation_m);
        self.policy = policy;
        self.set_leg_of_estimate();
    }

    fn forget(&mut self) {
        self.gait = Self::gait(&self.policy);
        self.estimator.clear();
        self.forget_estimate();
        self.cascade.reset();
        self.telemetry = Telemetry::default();
    }

    fn take_set_point(&mut self, set_point_m_s: f32) {
        // A NaN is within no limit.
        if set_point_m_s.abs() <= self.limits().max_speed_m_s {
            self.set_point_m_s = set_point_m_s;
        } else {
            self.guard.count_refused_set_point();
        }
    }

    /// Runs a tick with a measurement, by its readings. Inlined at its only call.
    #[inline]
    fn advance(&mut self, measurement: Trusted<'_>) -> Status {
        let passed = self.gait.update(measurement);
        let m = measurement.measurement();
        if self.gait.in_flight() {
            self.estimator.push(m.t_ns, m.vy_m_s);
        } else {
            self.estimator.clear();
        }
        if let Some(apex) = passed.or_else(|| self.starting_apex(m.density_ratio.is_some())) {
            self.decide(apex, m.density_ratio);
        }
        self.command = self.gait.command();
        self.checked(Status::Running)
    }

    /// Returns the apex that a leg in mid-air without an action yet falls from.
    fn starting_apex(&self, density_is_measured: bool) -> Option<Apex> {
        let has_medium = density_is_measured || self.estimator.samples() >= START_MEASUREMENTS;
        (!self.gait.has_action() && has_medium).then(|| self.gait.apex_behind()).flatten()
    }

    /// Runs medium, cascade and actor, once an apex.
    fn decide(&mut self, apex: Apex, measured_density: Option<f32>) {
        self.take_next();
        let manifest = self.policy.manifest();
        let density = measured_density
            .or_else(|| self.estimator.estimate(&manifest.leg, self.config.gravity_m_s2()))
            .or(self.telemetry.density_ratio);
        let Some(density) = density else { return };
        let density_ratio = clamp(density, manifest.media.density_ratio);
        // Extrapolated from a fall that hardly accelerates, an apex can lie anywhere.
        let apex_y_m = clamp(apex.y_m, self.limits().height_m);
        let gains = gains_at(&manifest.gains, density_ratio);
        let offset = self.cascade.update(&gains, self.set_point_m_s, apex.vx_m_s);
        let observation =
            Observation { apex_vx_m_s: apex.vx_m_s - offset, apex_y_m, density_ratio };
        self.gait.set_action(self.policy.actor().act(observation));
        self.telemetry = Telemetry {
            apex_vx_m_s: apex.vx_m_s,
            apex_y_m,
            density_ratio: Some(density_ratio),
            velocity_offset_m_s: offset,
            apexes: self.telemetry.apexes.saturating_add(1),
        };
    }

    /// Continues the last command by one tick.
    fn coast(&mut self) {
        let tick_s = 1e-9 * self.config.tick_ns() as f32;
        let limit_m = self.policy.manifest().leg.max_elongation_m;
        let grown_m = self.command.elongation_m + self.command.elongation_rate_m_s * tick_s;
        self.command.elongation_m = if grown_m < limit_m { grown_m } else { limit_m };
    }

    /// Returns the status, after the last check of the command: it becomes the safe one
    /// when there is no action to follow, or when a value is not finite or out of range.
    fn checked(&mut self, status: Status) -> Status {
        if self.gait.has_action() && self.command.is_valid() {
            return status;
        }
        self.command = LegCommand::SAFE;
        Status::Safe
    }
}

#[cfg(test)]
mod tests;
