//! How the control law is run: rate, gravity, limits.

use crate::guard::Limits;

/// Lowest and highest control rate, Hz.
pub const RATE_HZ: core::ops::RangeInclusive<u32> = 50..=20_000;

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
            Self::Limits => f.write_str(
                "limits: each range must be finite, not empty and within 1e6, heights 0 or more, \
                 and the longest gap from 1 ns to 1 s",
            ),
        }
    }
}

impl core::error::Error for ConfigError {}

impl Default for Config {
    /// Returns 1 kHz, the gravity of Earth, and the default limits.
    fn default() -> Self {
        Self { tick_ns: 1_000_000, gravity_m_s2: EARTH_GRAVITY_M_S2, limits: Limits::default() }
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
    }
}
