//! The leg: its mass, spring, size and drag.

use serde::{Deserialize, Serialize};

/// Density of fresh water, by which density ratios are defined.
pub const REFERENCE_DENSITY_KG_M3: f64 = 1000.0;

/// Gravity on Earth, as the paper rounds it.
pub const EARTH_GRAVITY_M_S2: f64 = 9.81;

/// Unchecked parameters of a leg; [`Leg::new`] checks them.
///
/// The model is a point mass on a massless telescopic leg with a spring; an actuator lengthens
/// the spring's rest length during stance. The symbols are those of table 1 of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LegParameters {
    /// Dry mass `m`; above 0.
    pub mass_kg: f64,
    /// Added mass `M` of the fluid that moves along, the same in every medium; 0 or more.
    pub added_mass_kg: f64,
    /// Spring stiffness `k`; above 0.
    pub stiffness_n_m: f64,
    /// Displaced volume `V`, which gives the buoyancy; 0 or more.
    pub volume_m3: f64,
    /// Rest length `r0` of the leg at touchdown; above 0.
    pub rest_length_m: f64,
    /// Largest elongation that the actuator adds to the rest length; 0 or more.
    pub max_elongation_m: f64,
    /// Frontal area seen by a horizontal flow; 0 or more.
    pub area_x_m2: f64,
    /// Frontal area seen by a vertical flow; 0 or more.
    pub area_y_m2: f64,
    /// Drag coefficient of the horizontal motion; 0 or more.
    pub drag_x: f64,
    /// Drag coefficient of the vertical motion; 0 or more.
    pub drag_y: f64,
}

/// A leg with checked parameters: each is finite and in the range that [`LegParameters`] states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LegParameters", into = "LegParameters")]
pub struct Leg(LegParameters);

/// A parameter out of its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// The value is not finite or not above 0.
    #[error("{name} is {value}; it must be a finite number above 0")]
    NotPositive {
        /// Name of the parameter, with its unit.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
    /// The value is not finite or below 0.
    #[error("{name} is {value}; it must be a finite number, 0 or more")]
    Negative {
        /// Name of the parameter, with its unit.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
    /// The value is not a number within its range.
    #[error("{name} is {value}; it must be a number from {least} to {most}")]
    OutOfRange {
        /// Name of the parameter, with its unit.
        name: &'static str,
        /// The refused value.
        value: f64,
        /// The least value.
        least: f64,
        /// The largest value.
        most: f64,
    },
}

/// Checks that a value is finite and above 0.
pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<(), ParameterError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(ParameterError::NotPositive { name, value })
    }
}

/// Checks that a value is finite and not below 0.
pub(crate) fn check_not_negative(name: &'static str, value: f64) -> Result<(), ParameterError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(ParameterError::Negative { name, value })
    }
}

/// Checks that a value is within a range.
pub(crate) fn check_within(
    name: &'static str,
    value: f64,
    [least, most]: [f64; 2],
) -> Result<(), ParameterError> {
    if value >= least && value <= most {
        Ok(())
    } else {
        Err(ParameterError::OutOfRange { name, value, least, most })
    }
}

impl Leg {
    /// Checks the parameters and creates a leg.
    ///
    /// # Errors
    /// Returns the first parameter that is not finite or out of the range that its field states.
    pub fn new(parameters: LegParameters) -> Result<Self, ParameterError> {
        let p = &parameters;
        check_positive("mass_kg", p.mass_kg)?;
        check_not_negative("added_mass_kg", p.added_mass_kg)?;
        check_positive("stiffness_n_m", p.stiffness_n_m)?;
        check_not_negative("volume_m3", p.volume_m3)?;
        check_positive("rest_length_m", p.rest_length_m)?;
        check_not_negative("max_elongation_m", p.max_elongation_m)?;
        check_not_negative("area_x_m2", p.area_x_m2)?;
        check_not_negative("area_y_m2", p.area_y_m2)?;
        check_not_negative("drag_x", p.drag_x)?;
        check_not_negative("drag_y", p.drag_y)?;
        Ok(Self(parameters))
    }

    /// Returns the human-size leg of the paper and its data (doi 10.5281/zenodo.4607469).
    #[must_use]
    pub const fn human() -> Self {
        Self(LegParameters {
            mass_kg: 80.0,
            added_mass_kg: 8.0,
            stiffness_n_m: 20_000.0,
            volume_m3: 0.0624,
            rest_length_m: 1.0,
            max_elongation_m: 0.2,
            area_x_m2: 0.1925,
            area_y_m2: 0.105,
            drag_x: 1.05,
            drag_y: 1.05,
        })
    }

    /// Returns the crab-size leg of the same source. Its buoyancy in water is nine tenths of its
    /// weight.
    #[must_use]
    pub const fn crab() -> Self {
        const MASS_KG: f64 = 0.074;
        const VOLUME_M3: f64 = (MASS_KG - MASS_KG / 10.0) / REFERENCE_DENSITY_KG_M3;
        const REST_LENGTH_M: f64 = 0.04;
        const SHELL_RADIUS_M: f64 = 0.054 / 2.0;
        Self(LegParameters {
            mass_kg: MASS_KG,
            added_mass_kg: 0.48 * REFERENCE_DENSITY_KG_M3 * VOLUME_M3,
            stiffness_n_m: 7.8 * MASS_KG * EARTH_GRAVITY_M_S2 / REST_LENGTH_M,
            volume_m3: VOLUME_M3,
            rest_length_m: REST_LENGTH_M,
            max_elongation_m: 0.005,
            area_x_m2: 4e-4,
            area_y_m2: core::f64::consts::PI * SHELL_RADIUS_M * SHELL_RADIUS_M,
            drag_x: 0.47,
            drag_y: 1.0,
        })
    }

    /// Returns this leg with more mass, which displaces nothing.
    pub(crate) fn with_more_mass(mut self, mass_kg: f64) -> Self {
        self.0.mass_kg += mass_kg;
        self
    }

    /// Returns the parameters.
    #[must_use]
    pub const fn parameters(&self) -> &LegParameters {
        &self.0
    }
}

impl Default for Leg {
    fn default() -> Self {
        Self::human()
    }
}

impl TryFrom<LegParameters> for Leg {
    type Error = ParameterError;

    fn try_from(parameters: LegParameters) -> Result<Self, ParameterError> {
        Self::new(parameters)
    }
}

impl From<Leg> for LegParameters {
    fn from(leg: Leg) -> Self {
        leg.0
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn presets_are_valid() {
        for leg in [Leg::human(), Leg::crab()] {
            assert_eq!(Leg::new(*leg.parameters()), Ok(leg));
        }
    }

    #[test]
    fn the_error_names_the_parameter_and_its_value() {
        let mut parameters = *Leg::human().parameters();
        parameters.stiffness_n_m = -1.0;
        let error = Leg::new(parameters).unwrap_err();
        assert_eq!(error.to_string(), "stiffness_n_m is -1; it must be a finite number above 0");
        parameters = *Leg::human().parameters();
        parameters.volume_m3 = f64::NAN;
        assert!(Leg::new(parameters).is_err());
    }

    #[test]
    fn rejects_unknown_keys() {
        let json = serde_json::to_string(&Leg::crab()).unwrap();
        assert_eq!(serde_json::from_str::<Leg>(&json).unwrap(), Leg::crab());
        let typo = json.replace("drag_y", "drag_z");
        assert!(serde_json::from_str::<Leg>(&typo).is_err());
    }
}
