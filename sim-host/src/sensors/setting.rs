//! A figure as a user sets it: `accelerometer-bias=0.5` on the command line, or a key of the table
//! `[sensor]` in a scenario file with the same name.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::de::Deserializer;
use serde::{Deserialize, Serialize, Serializer};

use super::catalog::{self, Figures, TABLE};
use super::figure::{Quantity, Sensor};
use super::profile::SensorProfile;

/// A figure as a user set it. The name is checked, the value is not.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSetting {
    row: usize,
    value: f64,
}

/// A setting of a sensor that cannot be used; the message is one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SensorError(String);

impl SensorSetting {
    fn named(name: &str, value: f64) -> Result<Self, SensorError> {
        if let Some(row) = catalog::named(name) {
            return Ok(Self { row, value });
        }
        let sensor = Sensor::ALL.into_iter().find(|sensor| {
            name == sensor.name()
                || name.strip_prefix(sensor.name()).is_some_and(|rest| rest.starts_with('-'))
        });
        let known: Vec<String> = match sensor {
            Some(sensor) => TABLE
                .iter()
                .filter(|row| row.figure.sensor == sensor)
                .map(|row| row.figure.to_string())
                .collect(),
            None => Sensor::ALL.iter().map(|sensor| format!("{}-…", sensor.name())).collect(),
        };
        Err(SensorError(format!(
            "`{name}` is not a figure of a sensor; the figures are {}",
            known.join(", ")
        )))
    }

    /// Returns `settings` over `base`, of which a figure that both set counts no more.
    pub(crate) fn merged(base: Vec<Self>, settings: Vec<Self>) -> Vec<Self> {
        let is_replaced = |old: &Self| settings.iter().any(|new| new.row == old.row);
        let kept: Vec<Self> = base.into_iter().filter(|old| !is_replaced(old)).collect();
        kept.into_iter().chain(settings).collect()
    }
}

impl FromStr for SensorSetting {
    type Err = SensorError;

    fn from_str(text: &str) -> Result<Self, SensorError> {
        let Some((name, value)) = text.split_once('=') else {
            return Err(SensorError(format!(
                "`{text}` is not figure=value, such as accelerometer-bias=0.5"
            )));
        };
        let (name, value) = (name.trim(), value.trim());
        let setting = Self::named(name, 0.0)?;
        let value = value
            .parse()
            .map_err(|_| SensorError(format!("{name} is `{value}`; it must be a number")))?;
        Ok(Self { value, ..setting })
    }
}

impl fmt::Display for SensorSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", TABLE[self.row].figure, self.value)
    }
}

impl Figures {
    /// Checks all settings and returns the figures of a run.
    ///
    /// # Errors
    /// [`SensorError`] for a value out of range, a figure that is set twice, one of a sensor that
    /// the leg does not have, and a leg that cannot tell whether it stands.
    pub fn check(profile: SensorProfile, settings: &[SensorSetting]) -> Result<Self, SensorError> {
        let mut figures = Self::of_profile(profile);
        for (i, setting) in settings.iter().enumerate() {
            let row = &TABLE[setting.row];
            let figure = row.figure;
            if settings[..i].iter().any(|earlier| earlier.row == setting.row) {
                return Err(SensorError(format!("`{figure}` is set twice; set it once")));
            }
            if !(0.0..=row.most).contains(&setting.value) {
                return Err(SensorError(format!(
                    "{figure} is {}; it must be a number from 0 to {}{}",
                    setting.value,
                    row.most,
                    unit_after(&figure.unit())
                )));
            }
            figures.set_row(setting.row, setting.value);
        }
        for setting in settings {
            let figure = TABLE[setting.row].figure;
            if figure.quantity != Quantity::Rate && !figures.has(figure.sensor) {
                let (name, sensor) = (profile.name(), figure.sensor.name());
                return Err(SensorError(format!(
                    "{setting}: the leg has no sensor `{sensor}` in the profile {name}; \
                     {sensor}-rate above 0 adds it"
                )));
            }
        }
        if !(figures.has(Sensor::Contact) || figures.has(Sensor::LegLength)) {
            return Err(SensorError(
                "contact-rate and leg-length-rate are 0; one of them must be above 0, for the leg \
                 must sense whether it stands"
                    .to_owned(),
            ));
        }
        Ok(figures)
    }
}

fn unit_after(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

/// The settings of the table `[sensor]`.
pub(crate) mod as_table {
    use serde::de::Error as _;

    use super::{BTreeMap, Deserialize, Deserializer, SensorSetting, Serialize, Serializer, TABLE};

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<SensorSetting>, D::Error> {
        BTreeMap::<String, f64>::deserialize(deserializer)?
            .into_iter()
            .map(|(name, value)| SensorSetting::named(&name, value).map_err(D::Error::custom))
            .collect()
    }

    pub(crate) fn serialize<S: Serializer>(
        settings: &[SensorSetting],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let entry =
            |setting: &SensorSetting| (TABLE[setting.row].figure.to_string(), setting.value);
        settings.iter().map(entry).collect::<BTreeMap<_, _>>().serialize(serializer)
    }
}
