//! The control law: one call a tick, from a sample to a command.

use crate::actor::Observation;
use crate::gait::{Apex, Gait, LegTarget};
use crate::guard::{Counts, Guard, Limits, Trusted, Verdict};
use crate::medium::DensityEstimator;
use crate::policy::Policy;
use crate::velocity::Cascade;
use crate::wire::{Command, Header, Sample, WIRE_VERSION, flags};

/// Samples in flight from which a leg that starts, or restarts, in mid-air
/// first estimates what it is in.
const START_SAMPLES: usize = 8;

/// How the control law is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Time from one tick to the next, ns.
    pub tick_ns: u64,
    /// Gravity where the leg is, m/s2: the density estimate needs it.
    pub gravity_m_s2: f32,
    /// What a sample must satisfy.
    pub limits: Limits,
}

/// Lowest and highest control rate, Hz.
pub const RATE_HZ: core::ops::RangeInclusive<u32> = 50..=20_000;

/// Why a control law cannot be set up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ConfigError {
    /// A control rate outside [`RATE_HZ`].
    Rate(u32),
    /// A gravity that is not a finite figure above 0.
    Gravity(f32),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Rate(hz) => write!(
                f,
                "control rate {hz} Hz: choose one from {} to {} Hz",
                RATE_HZ.start(),
                RATE_HZ.end()
            ),
            Self::Gravity(g) => write!(f, "gravity {g} m/s2: it must be finite and above 0"),
        }
    }
}

impl core::error::Error for ConfigError {}

impl Config {
    /// The usual configuration at a control rate, with the gravity of Earth.
    ///
    /// # Errors
    /// [`ConfigError::Rate`] outside [`RATE_HZ`].
    pub fn at_rate(rate_hz: u32) -> Result<Self, ConfigError> {
        if !RATE_HZ.contains(&rate_hz) {
            return Err(ConfigError::Rate(rate_hz));
        }
        let tick_ns = 1_000_000_000 / u64::from(rate_hz);
        let usual = Limits::default();
        let limits = Limits { max_gap_ns: usual.max_gap_ns.max(4 * tick_ns), ..usual };
        Ok(Self { tick_ns, gravity_m_s2: 9.81, limits })
    }

    /// The same under another gravity, m/s2.
    ///
    /// # Errors
    /// [`ConfigError::Gravity`] when it is not finite and above 0.
    pub fn with_gravity(self, gravity_m_s2: f32) -> Result<Self, ConfigError> {
        if gravity_m_s2.is_finite() && gravity_m_s2 > 0.0 {
            Ok(Self { gravity_m_s2, ..self })
        } else {
            Err(ConfigError::Gravity(gravity_m_s2))
        }
    }
}

/// What the controller knows since the last apex; goes out with every command.
#[derive(Clone, Copy, Debug, Default)]
struct Insight {
    apex_vx_m_s: f32,
    apex_y_m: f32,
    density_ratio: Option<f32>,
    velocity_offset_m_s: f32,
    apexes: u32,
}

/// The whole controller: guard, gait, density estimate, cascade, actor.
///
/// It knows time only by the samples' stamps and the fixed tick. The same
/// object runs on a microcontroller, in the host process and in the trainer's
/// evaluation.
#[derive(Clone, Debug)]
pub struct Controller<'a> {
    policy: Policy<'a>,
    config: Config,
    guard: Guard,
    gait: Gait,
    estimator: DensityEstimator,
    cascade: Cascade,
    insight: Insight,
    target: LegTarget,
    header: Header,
}

impl<'a> Controller<'a> {
    /// A controller that has seen nothing yet.
    #[must_use]
    pub fn new(policy: Policy<'a>, config: Config) -> Self {
        let manifest = policy.manifest();
        let leg = manifest.leg;
        Self {
            cascade: Cascade::new(manifest.gains.clone()),
            gait: Gait::new(leg.rest_length_m, leg.max_elongation_m),
            guard: Guard::new(config.limits),
            estimator: DensityEstimator::new(),
            insight: Insight::default(),
            target: LegTarget::SAFE,
            header: Header::default(),
            policy,
            config,
        }
    }

    /// The policy that it runs.
    #[must_use]
    pub fn policy(&self) -> &Policy<'a> {
        &self.policy
    }

    /// What the guard has rejected since the epoch's start.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        self.guard.counts()
    }

    /// One tick: the sample that came, or none, and the command for it.
    ///
    /// The command carries the header of the sample it answers, also when the
    /// sample was rejected, and is always finite.
    pub fn tick(&mut self, sample: Option<&Sample>) -> Command {
        if let Some(sample) = sample {
            self.header = sample.header;
        }
        match self.guard.judge(sample) {
            Verdict::Use(sample) => self.advance(&sample),
            Verdict::Restart(sample) => {
                self.forget();
                self.advance(&sample);
            }
            Verdict::Coast => self.coast(),
            Verdict::Safe => {
                self.target = LegTarget::SAFE;
                return self.command(flags::SAFE);
            }
        }
        self.command(if self.gait.has_action() { 0 } else { flags::SAFE })
    }

    fn forget(&mut self) {
        let leg = &self.policy.manifest().leg;
        self.gait = Gait::new(leg.rest_length_m, leg.max_elongation_m);
        self.estimator.clear();
        self.cascade.reset();
        self.insight = Insight::default();
    }

    fn advance(&mut self, sample: &Trusted) {
        let passed = self.gait.sense(sample);
        let s = sample.sample();
        if self.gait.in_flight() {
            self.estimator.push(s.header.t_ns, s.vy_m_s);
        } else {
            self.estimator.clear();
        }
        let sensed = sample.has(flags::DENSITY_SENSED).then_some(s.density_ratio);
        if let Some(apex) = passed.or_else(|| self.starting_apex(sensed.is_some())) {
            self.decide(apex, sensed, s.set_point_m_s);
        }
        self.target = self.gait.target();
    }

    /// In mid-air without an action yet: the apex that the leg falls from.
    fn starting_apex(&self, density_is_sensed: bool) -> Option<Apex> {
        let knows_medium = density_is_sensed || self.estimator.samples() >= START_SAMPLES;
        (!self.gait.has_action() && knows_medium).then(|| self.gait.apex_behind()).flatten()
    }

    /// Once an apex: medium, cascade, actor.
    fn decide(&mut self, apex: Apex, sensed: Option<f32>, set_point_m_s: f32) {
        let manifest = self.policy.manifest();
        let found = sensed
            .or_else(|| self.estimator.estimate(&manifest.leg, self.config.gravity_m_s2))
            .or(self.insight.density_ratio);
        let Some(found) = found else { return };
        let [low, high] = manifest.media.density_ratio;
        let density_ratio = if found > low { if found < high { found } else { high } } else { low };
        let offset = self.cascade.update(set_point_m_s, apex.vx_m_s, density_ratio);
        let observation =
            Observation { apex_vx_m_s: apex.vx_m_s - offset, apex_y_m: apex.y_m, density_ratio };
        self.gait.set_action(self.policy.actor().act(observation));
        self.insight = Insight {
            apex_vx_m_s: apex.vx_m_s,
            apex_y_m: apex.y_m,
            density_ratio: Some(density_ratio),
            velocity_offset_m_s: offset,
            apexes: self.insight.apexes.saturating_add(1),
        };
    }

    /// Continues the last command by one tick.
    fn coast(&mut self) {
        let tick_s = 1e-9 * self.config.tick_ns as f32;
        let limit_m = self.policy.manifest().leg.max_elongation_m;
        let grown_m = self.target.elongation_m + self.target.elongation_rate_m_s * tick_s;
        self.target.elongation_m = if grown_m < limit_m { grown_m } else { limit_m };
    }

    fn command(&self, flags: u16) -> Command {
        Command {
            header: Header { version: WIRE_VERSION, flags, ..self.header },
            leg_angle_rad: self.target.angle_rad,
            elongation_m: self.target.elongation_m,
            elongation_rate_m_s: self.target.elongation_rate_m_s,
            apex_vx_m_s: self.insight.apex_vx_m_s,
            apex_y_m: self.insight.apex_y_m,
            density_ratio: self.insight.density_ratio.unwrap_or(0.0),
            velocity_offset_m_s: self.insight.velocity_offset_m_s,
            apexes: self.insight.apexes,
            rejected: self.guard.counts().rejected(),
            reserved: 0,
        }
    }
}
