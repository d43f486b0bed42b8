//! The medium: its density and its gravity.

use super::leg::{EARTH_GRAVITY_M_S2, ParameterError, not_negative};

/// What the leg moves in. The density is a ratio to water's: 1 is water, 0 is vacuum, which
/// the source takes for air.
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

    /// Any medium. A ratio above the leg's own makes it buoyant, which is allowed.
    ///
    /// # Errors
    /// A ratio or gravity that is negative or not finite.
    pub fn new(density_ratio: f64, gravity_m_s2: f64) -> Result<Self, ParameterError> {
        not_negative("density_ratio", density_ratio)?;
        not_negative("gravity_m_s2", gravity_m_s2)?;
        Ok(Self { density_ratio, gravity_m_s2 })
    }

    /// The same gravity at another density.
    ///
    /// # Errors
    /// A ratio that is negative or not finite.
    pub fn with_density_ratio(self, density_ratio: f64) -> Result<Self, ParameterError> {
        Self::new(density_ratio, self.gravity_m_s2)
    }

    /// Density over that of water.
    #[must_use]
    pub const fn density_ratio(self) -> f64 {
        self.density_ratio
    }

    /// Gravity, downwards.
    #[must_use]
    pub const fn gravity_m_s2(self) -> f64 {
        self.gravity_m_s2
    }
}

impl Default for Medium {
    /// [`Medium::AIR`].
    fn default() -> Self {
        Self::AIR
    }
}
