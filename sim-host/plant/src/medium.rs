//! The medium: its density and its gravity.

use crate::leg::{EARTH_GRAVITY_M_S2, ParameterError, check_not_negative};

/// The medium around the leg: a density, as a ratio to that of fresh water, and a gravity.
///
/// A ratio of 1 is water. A ratio of 0 is vacuum, which the paper uses for air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    density_ratio: f64,
    gravity_m_s2: f64,
}

impl Medium {
    /// Water on Earth.
    pub const WATER: Self = Self::on_earth(1.0);
    /// Air on Earth, without drag or buoyancy.
    pub const AIR: Self = Self::on_earth(0.0);
    /// The surface of the Moon.
    pub const MOON: Self = Self { density_ratio: 0.0, gravity_m_s2: 1.62 };
    /// The surface of Mars, its thin air neglected.
    pub const MARS: Self = Self { density_ratio: 0.0, gravity_m_s2: 3.71 };

    const fn on_earth(density_ratio: f64) -> Self {
        Self { density_ratio, gravity_m_s2: EARTH_GRAVITY_M_S2 }
    }

    /// Creates a medium. In a medium denser than the leg the leg floats, which is allowed.
    ///
    /// # Errors
    /// Returns an error if the ratio or the gravity (m/s²) is negative or not finite.
    pub fn new(density_ratio: f64, gravity_m_s2: f64) -> Result<Self, ParameterError> {
        check_not_negative("density_ratio", density_ratio)?;
        check_not_negative("gravity_m_s2", gravity_m_s2)?;
        Ok(Self { density_ratio, gravity_m_s2 })
    }

    /// Returns a medium of the same gravity and another density.
    ///
    /// # Errors
    /// Returns an error if the ratio is negative or not finite.
    pub fn with_density_ratio(self, density_ratio: f64) -> Result<Self, ParameterError> {
        Self::new(density_ratio, self.gravity_m_s2)
    }

    /// Returns the density over that of fresh water.
    #[must_use]
    pub const fn density_ratio(self) -> f64 {
        self.density_ratio
    }

    /// Returns the gravity, m/s², positive downwards.
    #[must_use]
    pub const fn gravity_m_s2(self) -> f64 {
        self.gravity_m_s2
    }
}

impl Default for Medium {
    /// Returns [`Medium::AIR`].
    fn default() -> Self {
        Self::AIR
    }
}
