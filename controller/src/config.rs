//! How the control law is run: rate, gravity, limits, and what it takes for the state.

#[cfg(feature = "estimator")]
use crate::estimator::{SensorNoise, StateNoise};
use crate::guard::{Limits, SAFE_AFTER_NS};

/// Lowest and highest control rate, Hz.
pub const RATE_HZ: core::ops::RangeInclusive<u32> = 50..=20_000;

/// Shortest and longest stale limit, ns: a tick of the fastest rate, and a second.
pub const STALE_LIMIT_NS: core::ops::RangeInclusive<u64> = 50_000..=1_000_000_000;

/// Gravity on Earth, m/s2: the value of "Learning to stop", doi 10.5281/zenodo.4607469.
const EARTH_GRAVITY_M_S2: f32 = 9.81;

/// The configuration of a controller; only checked ones exist.
///
/// ```
/// use leg_control::config::Config;
///
/// let on_the_moon = Config::at_rate(500)?.with_gravity(1.62)?;
/// assert_eq!(on_the_moon.tick_ns(), 2_000_000);
/// assert!(Config::at_rate(0).is_err());
/// # Ok::<(), leg_control::config::ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    tick_ns: u64,
    gravity_m_s2: f32,
    limits: Limits,
    stale_limit_ns: u64,
    estimation: Estimation,
}

/// What the control law takes for the state of the leg.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Estimation {
    /// The readings themselves: for exact sensors.
    #[default]
    Readings,
    /// An estimate from noisy readings of velocity and height ([`crate::estimator`]): it
    /// needs no exact reading and none in particular, waits for no message, and decides ahead
    /// of the apex, so that the command is there in time over a slow link.
    #[cfg(feature = "estimator")]
    StateChannels(StateNoise),
    /// An estimate from accelerometer, encoders of the leg and contact
    /// ([`Sensors`](crate::measurement::Sensors)), of a leg that senses neither velocity nor
    /// height.
    #[cfg(feature = "estimator")]
    Inertial(SensorNoise),
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ConfigError {
    /// The control rate, Hz, is outside [`RATE_HZ`].
    Rate(u32),
    /// The gravity, m/s2, is not finite and above 0.
    Gravity(f32),
    /// The stale limit, ns, is outside [`STALE_LIMIT_NS`].
    StaleLimit(u64),
    /// A stated deviation of the noise is out of range; see [`StateNoise::is_valid`] and
    /// [`SensorNoise::is_valid`].
    Noise,
    /// This build has no state estimator: the feature `estimator` is off.
    NoEstimator,
    /// A range of the limits is empty, not finite or too wide; see [`Limits::are_valid`].
    Limits,
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
            Self::StaleLimit(ns) => write!(
                f,
                "stale limit {ns} ns: choose one from {} to {} ns",
                STALE_LIMIT_NS.start(),
                STALE_LIMIT_NS.end()
            ),
            Self::NoEstimator => f.write_str("this controller was built without a state estimator"),
            Self::Noise => f.write_str(
                "noise of the readings: each standard deviation must be 1e-4 to 1e3, each figure \
                 of a raw sensor 1e-6 to 1e5",
            ),
            Self::Limits => f.write_str(
                "limits: each range must be finite, not empty and within 1e6, heights 0 or more, \
                 and the longest gap from 1 ns to 1 s",
            ),
        }
    }
}

impl core::error::Error for ConfigError {}

impl Default for Config {
    /// Returns 1 kHz, the gravity of Earth, the default limits, and no estimator.
    fn default() -> Self {
        Self {
            tick_ns: 1_000_000,
            gravity_m_s2: EARTH_GRAVITY_M_S2,
            limits: Limits::default(),
            stale_limit_ns: SAFE_AFTER_NS,
            estimation: Estimation::default(),
        }
    }
}

impl Config {
    /// Returns the usual configuration at a control rate, Hz, with the gravity of Earth.
    /// The longest gap between measurements is that of [`Limits::default`], or four ticks
    /// where those are longer.
    ///
    /// # Errors
    /// [`ConfigError::Rate`] outside [`RATE_HZ`].
    pub fn at_rate(rate_hz: u32) -> Result<Self, ConfigError> {
        if !RATE_HZ.contains(&rate_hz) {
            return Err(ConfigError::Rate(rate_hz));
        }
        let tick_ns = u64::from(1_000_000_000 / rate_hz);
        let usual = Limits::default();
        let limits = Limits { max_gap_ns: usual.max_gap_ns.max(4 * tick_ns), ..usual };
        Ok(Self { tick_ns, limits, ..Self::default() })
    }

    /// Returns the same configuration under another gravity, m/s2.
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

    /// Returns the same configuration with other limits.
    ///
    /// # Errors
    /// [`ConfigError::Limits`] unless [`Limits::are_valid`].
    pub fn with_limits(self, limits: Limits) -> Result<Self, ConfigError> {
        if limits.are_valid() { Ok(Self { limits, ..self }) } else { Err(ConfigError::Limits) }
    }

    /// Returns the same configuration with another stale limit, ns: the age from which a
    /// measurement counts for nothing and the controller gives up. At least three ticks are
    /// waited for in any case. Raises [`Limits::max_gap_ns`] to the same time.
    ///
    /// The leg must hold commands as long. Over a link that delays samples and commands,
    /// choose more than both delays together; where messages are lost, several times the
    /// mean time between two that arrive.
    ///
    /// # Errors
    /// [`ConfigError::StaleLimit`] outside [`STALE_LIMIT_NS`].
    pub fn with_stale_limit(self, stale_limit_ns: u64) -> Result<Self, ConfigError> {
        if !STALE_LIMIT_NS.contains(&stale_limit_ns) {
            return Err(ConfigError::StaleLimit(stale_limit_ns));
        }
        let max_gap_ns = self.limits.max_gap_ns.max(stale_limit_ns);
        Ok(Self { stale_limit_ns, limits: Limits { max_gap_ns, ..self.limits }, ..self })
    }

    /// Returns the same configuration with another source of the state.
    ///
    /// # Errors
    /// [`ConfigError::Noise`] unless [`StateNoise::is_valid`].
    pub fn with_estimation(self, estimation: Estimation) -> Result<Self, ConfigError> {
        match estimation {
            #[cfg(feature = "estimator")]
            Estimation::StateChannels(noise) if !noise.is_valid() => Err(ConfigError::Noise),
            #[cfg(feature = "estimator")]
            Estimation::Inertial(noise) if !noise.is_valid() => Err(ConfigError::Noise),
            _ => Ok(Self { estimation, ..self }),
        }
    }

    /// Returns the stale limit, ns.
    #[must_use]
    pub fn stale_limit_ns(&self) -> u64 {
        self.stale_limit_ns
    }

    /// Returns what the control law takes for the state.
    #[must_use]
    pub fn estimation(&self) -> &Estimation {
        &self.estimation
    }

    /// Returns the time from one tick to the next, ns.
    #[must_use]
    pub fn tick_ns(&self) -> u64 {
        self.tick_ns
    }

    /// Returns the gravity, m/s2; the density estimate needs it.
    #[must_use]
    pub fn gravity_m_s2(&self) -> f32 {
        self.gravity_m_s2
    }

    /// Returns what a measurement must satisfy.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_the_law_cannot_run_with() {
        assert_eq!(Config::at_rate(49), Err(ConfigError::Rate(49)));
        assert_eq!(Config::at_rate(20_001), Err(ConfigError::Rate(20_001)));
        let config = Config::at_rate(1_000).unwrap();
        assert_eq!(config, Config::default());
        for bad in [0.0, -9.81, f32::NAN, f32::INFINITY] {
            assert!(config.with_gravity(bad).is_err(), "{bad} m/s2");
        }
        let nan = Limits { max_speed_m_s: f32::NAN, ..Limits::default() };
        assert_eq!(config.with_limits(nan), Err(ConfigError::Limits));
        for bad in [0, 49_999, 1_000_000_001, u64::MAX] {
            assert_eq!(config.with_stale_limit(bad), Err(ConfigError::StaleLimit(bad)));
        }
        for bad in [0.0, -0.1, 1e4, f32::NAN] {
            for noise in [
                StateNoise { velocity_m_s: bad, ..StateNoise::default() },
                StateNoise { height_m: bad, ..StateNoise::default() },
                StateNoise { leg_length_m: bad, ..StateNoise::default() },
            ] {
                let refused = config.with_estimation(Estimation::StateChannels(noise));
                assert_eq!(refused, Err(ConfigError::Noise), "{bad}");
            }
        }
    }

    #[test]
    fn a_stale_limit_allows_as_long_a_gap() {
        let config = Config::default().with_stale_limit(300_000_000).unwrap();
        assert_eq!(config.stale_limit_ns(), 300_000_000);
        assert_eq!(config.limits().max_gap_ns, 300_000_000);
        let short = Config::default().with_stale_limit(5_000_000).unwrap();
        assert_eq!(short.limits().max_gap_ns, Limits::default().max_gap_ns);
    }
}
