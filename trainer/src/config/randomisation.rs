//! Domain randomisation: what differs from episode to episode, and by how much.

use super::{Config, ConfigError};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml::{Table, Value};

use super::check::out_of_range;
use super::text::ReadError;

/// What a training randomises; a parameter that is `None` keeps the value of the trainer.
///
/// The quantities of an episode are drawn once for the episode, those of a hop anew at each apex.
/// [`crate::world`] states what each of them does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Randomisation {
    /// Share of episodes that are randomised; the others have the leg, the earth and the exact
    /// observation of the trainer.
    #[serde(default = "all")]
    pub share: f64,
    /// Factor of the leg's dry mass, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<Distribution>,
    /// Factor of the spring's stiffness, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<Distribution>,
    /// Factor of gravity, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity: Option<Distribution>,
    /// Damping along the leg, of an episode, N s/m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping_n_s_m: Option<Distribution>,
    /// Mass of the foot, whose energy is lost at the impact, of an episode, kg. Below 1 g the foot
    /// has no mass.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foot_mass_kg: Option<Distribution>,
    /// Coefficient of friction, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<Distribution>,
    /// Height of the ground on which a hop lands, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground_m: Option<Distribution>,
    /// Time from an event to the action that answers it, of an episode, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_s: Option<Distribution>,
    /// Noise on the observed velocity, of a hop, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_vx_m_s: Option<Distribution>,
    /// Noise on the observed height, of a hop, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_y_m: Option<Distribution>,
    /// Noise on the observed density ratio, of a hop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_density_ratio: Option<Distribution>,
    /// Error of the observed velocity, of an episode, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_vx_m_s: Option<Distribution>,
    /// Error of the observed height, of an episode, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_y_m: Option<Distribution>,
    /// Error of the observed density ratio, of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_density_ratio: Option<Distribution>,
}

const fn all() -> f64 {
    1.0
}

/// The distribution of a randomised quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
#[serde(expecting = "a distribution, such as { kind = \"uniform\", low = 0.8, high = 1.2 }")]
pub enum Distribution {
    /// Uniform from `low` to `high`.
    Uniform {
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// Uniform in the logarithm from `low`, above 0, to `high`.
    LogUniform {
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// Normal; values beyond `low` and `high` are moved there.
    Normal {
        /// Mean before clipping.
        mean: f64,
        /// Standard deviation before clipping.
        deviation: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
}

impl Distribution {
    /// Returns the lowest and the highest value.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        match *self {
            Self::Uniform { low, high }
            | Self::LogUniform { low, high }
            | Self::Normal { low, high, .. } => [low, high],
        }
    }
}

/// A quantity that can be randomised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named as the fields of Randomisation")]
pub enum Parameter {
    Mass,
    Stiffness,
    Gravity,
    Damping,
    FootMass,
    Friction,
    Ground,
    Delay,
    NoiseVx,
    NoiseY,
    NoiseDensity,
    BiasVx,
    BiasY,
    BiasDensity,
}

impl Parameter {
    /// All parameters. Their order is that of their random streams: new ones come last.
    pub const ALL: [Self; 14] = [
        Self::Mass,
        Self::Stiffness,
        Self::Gravity,
        Self::Damping,
        Self::FootMass,
        Self::Friction,
        Self::Ground,
        Self::Delay,
        Self::NoiseVx,
        Self::NoiseY,
        Self::NoiseDensity,
        Self::BiasVx,
        Self::BiasY,
        Self::BiasDensity,
    ];

    /// Returns the key in the table `[randomisation]`.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::Mass => "mass",
            Self::Stiffness => "stiffness",
            Self::Gravity => "gravity",
            Self::Damping => "damping_n_s_m",
            Self::FootMass => "foot_mass_kg",
            Self::Friction => "friction",
            Self::Ground => "ground_m",
            Self::Delay => "delay_s",
            Self::NoiseVx => "noise_vx_m_s",
            Self::NoiseY => "noise_y_m",
            Self::NoiseDensity => "noise_density_ratio",
            Self::BiasVx => "bias_vx_m_s",
            Self::BiasY => "bias_y_m",
            Self::BiasDensity => "bias_density_ratio",
        }
    }
}

impl Default for Randomisation {
    /// Returns a table that randomises nothing.
    fn default() -> Self {
        Self {
            share: all(),
            mass: None,
            stiffness: None,
            gravity: None,
            damping_n_s_m: None,
            foot_mass_kg: None,
            friction: None,
            ground_m: None,
            delay_s: None,
            noise_vx_m_s: None,
            noise_y_m: None,
            noise_density_ratio: None,
            bias_vx_m_s: None,
            bias_y_m: None,
            bias_density_ratio: None,
        }
    }
}

impl Randomisation {
    /// Returns the distribution of a parameter; `None` where it is not randomised.
    #[must_use]
    pub const fn get(&self, parameter: Parameter) -> Option<Distribution> {
        match parameter {
            Parameter::Mass => self.mass,
            Parameter::Stiffness => self.stiffness,
            Parameter::Gravity => self.gravity,
            Parameter::Damping => self.damping_n_s_m,
            Parameter::FootMass => self.foot_mass_kg,
            Parameter::Friction => self.friction,
            Parameter::Ground => self.ground_m,
            Parameter::Delay => self.delay_s,
            Parameter::NoiseVx => self.noise_vx_m_s,
            Parameter::NoiseY => self.noise_y_m,
            Parameter::NoiseDensity => self.noise_density_ratio,
            Parameter::BiasVx => self.bias_vx_m_s,
            Parameter::BiasY => self.bias_y_m,
            Parameter::BiasDensity => self.bias_density_ratio,
        }
    }

    const fn get_mut(&mut self, parameter: Parameter) -> &mut Option<Distribution> {
        match parameter {
            Parameter::Mass => &mut self.mass,
            Parameter::Stiffness => &mut self.stiffness,
            Parameter::Gravity => &mut self.gravity,
            Parameter::Damping => &mut self.damping_n_s_m,
            Parameter::FootMass => &mut self.foot_mass_kg,
            Parameter::Friction => &mut self.friction,
            Parameter::Ground => &mut self.ground_m,
            Parameter::Delay => &mut self.delay_s,
            Parameter::NoiseVx => &mut self.noise_vx_m_s,
            Parameter::NoiseY => &mut self.noise_y_m,
            Parameter::NoiseDensity => &mut self.noise_density_ratio,
            Parameter::BiasVx => &mut self.bias_vx_m_s,
            Parameter::BiasY => &mut self.bias_y_m,
            Parameter::BiasDensity => &mut self.bias_density_ratio,
        }
    }

    /// Returns the table with one parameter randomised as `distribution` says.
    #[must_use]
    pub const fn with(mut self, parameter: Parameter, distribution: Distribution) -> Self {
        *self.get_mut(parameter) = Some(distribution);
        self
    }

    /// Returns the parameters that are randomised.
    pub fn parameters(&self) -> impl Iterator<Item = Parameter> + '_ {
        Parameter::ALL.into_iter().filter(|&parameter| self.get(parameter).is_some())
    }

    /// Returns the table with one of its parameters alone, in every episode.
    #[must_use]
    pub fn only(&self, parameter: Parameter) -> Self {
        let mut alone = Self::default();
        *alone.get_mut(parameter) = self.get(parameter);
        alone
    }

    /// Returns the lowest and highest factor of gravity.
    #[must_use]
    pub fn gravity_range(&self) -> [f64; 2] {
        let [low, high] = self.gravity.map_or([1.0; 2], |gravity| gravity.range());
        // The episodes that are not randomised have the gravity of the earth.
        if self.share < 1.0 { [low.min(1.0), high.max(1.0)] } else { [low, high] }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// [`ConfigError`] with the first parameter out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let value =
            Value::try_from(self).map_err(|e| out_of_range(TABLE, &e, &"what TOML can hold"))?;
        super::check::check_value(TABLE, TABLE, &value)?;
        self.relations()
    }

    /// Checks the relations within each distribution.
    pub(super) fn relations(&self) -> Result<(), ConfigError> {
        for parameter in self.parameters() {
            let Some(distribution) = self.get(parameter) else { continue };
            let key = format!("{TABLE}.{}", parameter.key());
            let [low, high] = distribution.range();
            if low > high {
                return Err(out_of_range(
                    &format!("{key}.low to high"),
                    &format!("{low} to {high}"),
                    &"low to high",
                ));
            }
            if matches!(distribution, Distribution::LogUniform { .. }) && low <= 0.0 {
                return Err(out_of_range(
                    &format!("{key}.low"),
                    &low,
                    &"above 0 for a log-uniform distribution",
                ));
            }
        }
        Ok(())
    }

    /// Reads the table `[randomisation]` of a TOML file, which holds nothing else or a complete
    /// configuration, and checks it.
    ///
    /// # Errors
    /// [`ReadError`] with the file, the key, its value and its limit.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let text = super::text::read_text(path)?;
        let syntax = |cause| ReadError::Syntax { path: path.into(), cause: Box::new(cause) };
        let table: Table = toml::from_str(&text).map_err(syntax)?;
        let randomisation = if table.len() == 1 && table.contains_key(TABLE) {
            let alone: Alone = toml::from_str(&text).map_err(syntax)?;
            Some(alone.randomisation)
        } else {
            toml::from_str::<Config>(&text).map_err(syntax)?.randomisation
        };
        let absent = || ReadError::NoTable { path: path.into(), table: TABLE };
        let randomisation = randomisation.ok_or_else(absent)?;
        randomisation.check().map_err(|cause| ReadError::Parameter { path: path.into(), cause })?;
        Ok(randomisation)
    }
}

/// Key of the table.
pub(super) const TABLE: &str = "randomisation";

/// A file that holds the table alone.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Alone {
    randomisation: Randomisation,
}
