//! The control law: one call a tick, from a sample to a command.

use crate::actor::Observation;
use crate::gait::{Apex, Gait, LegTarget};
use crate::guard::{Counts, Guard, Limits, Trusted, Verdict};
use crate::medium::DensityEstimator;
use crate::policy::Policy;
use crate::velocity::{Cascade, gains_at};
use crate::wire::{Command, Header, Sample, WIRE_VERSION, flags};

/// Samples in flight from which a leg that starts, or restarts, in mid-air
/// first estimates what it is in: 8 ms at 1 kHz, a small part of any fall, and
/// enough for a hundredth of density even in f32.
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

/// The command of a leg that nobody controls: [`LegTarget::SAFE`], in answer to
/// the sample with this header.
#[must_use]
pub fn safe_command(header: &Header) -> Command {
    let LegTarget { angle_rad, elongation_m, elongation_rate_m_s } = LegTarget::SAFE;
    Command {
        header: Header { version: WIRE_VERSION, flags: flags::SAFE, ..*header },
        leg_angle_rad: angle_rad,
        elongation_m,
        elongation_rate_m_s,
        ..Command::default()
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
/// It knows time only by the samples' stamps and the fixed tick, so the same
/// object runs on a microcontroller and in the host process; the trainer
/// evaluates with its actor and its cascade.
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
    /// The policy to go on with from the next apex.
    next: Option<Policy<'a>>,
}

impl<'a> Controller<'a> {
    /// A controller that has seen nothing yet.
    #[must_use]
    pub fn new(policy: Policy<'a>, config: Config) -> Self {
        Self {
            cascade: Cascade::new(),
            gait: Self::gait(&policy),
            guard: Guard::new(config.limits),
            estimator: DensityEstimator::new(),
            insight: Insight::default(),
            target: LegTarget::SAFE,
            header: Header::default(),
            next: None,
            policy,
            config,
        }
    }

    /// Forgets everything but the policy, as if made anew under `config`. A
    /// policy that waits for an apex waits no longer.
    pub fn restart(&mut self, config: Config) {
        self.take_next();
        self.config = config;
        self.guard = Guard::new(config.limits);
        self.target = LegTarget::SAFE;
        self.header = Header::default();
        self.forget();
    }

    /// Goes on with another policy: from the next apex, or at once when no
    /// action is in force. One that still waits gives way to this one.
    ///
    /// At that apex all of the new policy holds: its leg, its media, its gains
    /// and its actor. What the run has taught is kept: the medium, the
    /// cascade's integral (an offset in m/s, so new gains give no kick) and the
    /// last apex.
    pub fn swap(&mut self, policy: Policy<'a>) {
        self.next = Some(policy);
        if !self.gait.has_action() {
            self.take_next();
        }
    }

    /// Whether a policy waits for the next apex.
    #[must_use]
    pub fn swap_is_pending(&self) -> bool {
        self.next.is_some()
    }

    /// The policy that it runs.
    #[must_use]
    pub fn policy(&self) -> &Policy<'a> {
        &self.policy
    }

    /// What the guard has rejected since the run's start.
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
                self.take_next();
                self.forget();
                self.advance(&sample);
            }
            Verdict::Coast => self.coast(),
            Verdict::Safe => {
                self.take_next();
                self.gait = Self::gait(&self.policy);
                self.target = LegTarget::SAFE;
                return self.command(flags::SAFE);
            }
        }
        self.command(if self.gait.has_action() { 0 } else { flags::SAFE })
    }

    fn gait(policy: &Policy<'_>) -> Gait {
        let leg = &policy.manifest().leg;
        Gait::new(leg.rest_length_m, leg.max_elongation_m)
    }

    /// From here on the policy that waited, if one did. Apart, so that the
    /// stack of an ordinary tick has no room for a policy.
    #[inline(never)]
    fn take_next(&mut self) {
        let Some(policy) = self.next.take() else { return };
        let manifest = policy.manifest();
        self.gait.refit(manifest.leg.rest_length_m, manifest.leg.max_elongation_m);
        self.policy = policy;
    }

    fn forget(&mut self) {
        self.gait = Self::gait(&self.policy);
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
        self.take_next();
        let manifest = self.policy.manifest();
        let found = sensed
            .or_else(|| self.estimator.estimate(&manifest.leg, self.config.gravity_m_s2))
            .or(self.insight.density_ratio);
        let Some(found) = found else { return };
        let [low, high] = manifest.media.density_ratio;
        let density_ratio = if found > low { if found < high { found } else { high } } else { low };
        let gains = gains_at(&manifest.gains, density_ratio);
        let offset = self.cascade.update(&gains, set_point_m_s, apex.vx_m_s);
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

#[cfg(test)]
mod swap_tests;
#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::policy::fixture::{Bytes, blob_of, manifest};
    use proptest::prelude::*;
    use std::vec::Vec as StdVec;

    fn with_controller(test: impl FnOnce(Controller<'_>)) {
        let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
        let policy = Policy::parse(bytes.get()).unwrap();
        test(Controller::new(policy, Config::at_rate(1_000).unwrap()));
    }

    /// Free fall from rest at `y_m`, as a leg in air feels it.
    fn falling(seq: u64, y_m: f32) -> Sample {
        let t_s = 1e-3 * seq as f32;
        let ay = -80.0 / 88.0 * 9.81;
        Sample {
            header: Header {
                version: WIRE_VERSION,
                flags: flags::CONTACT_SENSED,
                run_id: 3,
                seq,
                t_ns: seq * 1_000_000,
            },
            vx_m_s: 0.4,
            y_m: y_m + 0.5 * ay * t_s * t_s,
            vy_m_s: ay * t_s,
            ..Sample::default()
        }
    }

    fn is_safe(command: &Command) -> bool {
        command.header.flags & flags::SAFE != 0
    }

    #[test]
    fn a_leg_released_in_mid_air_is_safe_until_it_knows_its_medium() {
        with_controller(|mut controller| {
            for seq in 0..START_SAMPLES as u64 - 1 {
                assert!(is_safe(&controller.tick(Some(&falling(seq, 2.0)))));
            }
            let command = controller.tick(Some(&falling(START_SAMPLES as u64 - 1, 2.0)));
            assert!(!is_safe(&command));
            assert_eq!(command.apexes, 1);
            assert!((command.apex_y_m - 2.0).abs() < 1e-4, "{}", command.apex_y_m);
            assert!(command.density_ratio.abs() < 0.01, "{}", command.density_ratio);
        });
    }

    #[test]
    fn a_density_that_is_told_is_used_at_once() {
        with_controller(|mut controller| {
            let mut sample = falling(0, 2.0);
            sample.header.flags |= flags::DENSITY_SENSED;
            sample.density_ratio = 0.7;
            let command = controller.tick(Some(&sample));
            assert_eq!((command.apexes, command.density_ratio), (1, 0.7));
        });
    }

    #[test]
    fn the_ramp_of_the_elongation_is_armed_for_the_touchdown_foreseen() {
        with_controller(|mut controller| {
            let mut command = Command::default();
            for seq in 0..300 {
                command = controller.tick(Some(&falling(seq, 2.0)));
            }
            // At 2 m, from the fall's own formula.
            let ay = 80.0_f32 / 88.0 * 9.81;
            let touchdown_s = (2.0 * (2.0 - libm::sinf(command.leg_angle_rad)) / ay).sqrt();
            let foreseen_s = 0.299 - command.elongation_m / command.elongation_rate_m_s;
            assert!((foreseen_s - touchdown_s).abs() < 1e-5, "{foreseen_s} for {touchdown_s}");
        });
    }

    #[test]
    fn silence_is_bridged_then_safe_and_a_return_is_taken() {
        with_controller(|mut controller| {
            for seq in 0..100 {
                controller.tick(Some(&falling(seq, 3.0)));
            }
            let safe_after = Config::at_rate(1_000).unwrap().limits.safe_after_ticks;
            for _ in 1..safe_after {
                assert!(!is_safe(&controller.tick(None)));
            }
            let command = controller.tick(None);
            assert!(is_safe(&command));
            assert_eq!(
                (command.leg_angle_rad, command.elongation_m, command.elongation_rate_m_s),
                (core::f32::consts::FRAC_PI_2, 0.0, 0.0)
            );
            let first_back =
                (200..260).find(|&seq| !is_safe(&controller.tick(Some(&falling(seq, 3.0)))));
            // Three good samples to trust again, then those of the estimate.
            assert_eq!(first_back, Some(200 + 2 + START_SAMPLES as u64 - 1));
        });
    }

    fn any_sample() -> impl Strategy<Value = Option<Sample>> {
        let header = (0_u16..3, any::<u16>(), 0_u32..3, 0_u64..200, 0_u64..200).prop_map(
            |(version, flags, run_id, seq, tick)| Header {
                version,
                flags,
                run_id,
                seq,
                t_ns: tick * 1_000_000,
            },
        );
        let figure = || {
            prop_oneof![
                4 => -3.0_f32..3.0,
                1 => any::<u32>().prop_map(f32::from_bits),
            ]
        };
        let figures = (figure(), figure(), figure(), figure(), figure(), figure());
        prop::option::of((header, figures).prop_map(|(header, f)| Sample {
            header,
            set_point_m_s: f.0,
            vx_m_s: f.1,
            y_m: f.2,
            vy_m_s: f.3,
            leg_length_m: f.4,
            density_ratio: f.5,
        }))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        #[test]
        fn any_run_of_samples_gives_finite_commands_in_range(
            samples in prop::collection::vec(any_sample(), 1..80)
        ) {
            with_controller(|mut controller| {
                for sample in &samples {
                    let c = controller.tick(sample.as_ref());
                    let figures = [c.leg_angle_rad, c.elongation_m, c.elongation_rate_m_s,
                        c.apex_vx_m_s, c.apex_y_m, c.density_ratio, c.velocity_offset_m_s];
                    assert!(figures.iter().all(|x| x.is_finite()), "{c:?}");
                    assert!((0.0..=core::f32::consts::PI).contains(&c.leg_angle_rad), "{c:?}");
                    assert!(c.elongation_m <= 0.2 && (0.0..=2.0).contains(&c.elongation_rate_m_s));
                }
            });
        }

        /// Figures of any size: what parses, flies.
        #[test]
        fn any_policy_that_parses_gives_finite_commands(
            scale in prop::array::uniform6(any::<f32>()),
            clip in (0.0_f32..3.0, 0.0_f32..0.14, 0.0_f32..50.0, 0.0_f32..50.0),
            gains in prop::array::uniform5(-1e3_f32..1e3),
            lengths in prop::array::uniform3(0.0_f32..1e9),
            samples in prop::collection::vec(any_sample(), 1..60)
        ) {
            let mut manifest = manifest();
            manifest.observation.scale = [scale[0], scale[1], scale[2]];
            manifest.observation.offset[0] = scale[3];
            manifest.action.scale = [scale[4], scale[5]];
            manifest.action.low = [clip.0, clip.2];
            manifest.action.high = [clip.0 + clip.1, clip.2 + clip.3];
            manifest.leg.rest_length_m = lengths[0] + 1e-6;
            manifest.leg.max_elongation_m = lengths[1];
            manifest.leg.volume_m3 = lengths[2] + 1e-6;
            manifest.gains[0] = crate::policy::GainPoint {
                density_ratio: 0.0,
                kp: gains[0],
                ki: gains[1],
                kd: gains[2],
                feed_forward: gains[3],
                limit_m_s: gains[4].abs() * 0.1,
            };
            let Ok(blob) = blob_of(&manifest) else { return Ok(()) };
            let bytes = Bytes::new(&blob);
            let policy = Policy::parse(bytes.get()).unwrap();
            let mut controller = Controller::new(policy, Config::at_rate(1_000).unwrap());
            for sample in &samples {
                let c = controller.tick(sample.as_ref());
                let figures = [c.leg_angle_rad, c.elongation_m, c.elongation_rate_m_s,
                    c.apex_vx_m_s, c.apex_y_m, c.density_ratio, c.velocity_offset_m_s];
                prop_assert!(figures.iter().all(|x| x.is_finite()), "{c:?}");
                prop_assert!(c.velocity_offset_m_s.abs() <= 100.0);
            }
        }

        #[test]
        fn the_same_samples_give_the_same_bits(
            samples in prop::collection::vec(any_sample(), 1..80)
        ) {
            let run = || {
                let mut commands = StdVec::new();
                with_controller(|mut controller| {
                    commands.extend(samples.iter().map(|s| controller.tick(s.as_ref())));
                });
                commands
            };
            prop_assert_eq!(run(), run());
        }
    }
}
