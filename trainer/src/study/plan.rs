//! The plan of a study: everything that its results depend on.

use crate::config::Config;
use crc::{CRC_64_XZ, Crc};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use toml::{Table, Value};

/// Largest number of seeds of a study.
pub const MOST_SEEDS: u64 = 1_000_000;

/// A range of seeds, without its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Seeds {
    first: u64,
    end: u64,
}

/// The reason why a text is no range of seeds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SeedsError {
    /// The text is not two numbers.
    #[error("'{0}' is not FIRST..END, two whole numbers, such as 0..20 for the seeds 0 to 19")]
    Form(String),
    /// The end is not above the first seed.
    #[error("{0} holds no seed: the end, which does not count, must be above the first")]
    Empty(String),
    /// The range has more than [`MOST_SEEDS`] seeds.
    #[error("{0} holds more than {MOST_SEEDS} seeds; split it into several studies")]
    Many(String),
}

impl Seeds {
    /// Returns the seeds, ascending.
    pub fn iter(self) -> impl Iterator<Item = u64> {
        self.first..self.end
    }

    /// Returns the number of seeds.
    #[must_use]
    pub fn count(self) -> u64 {
        self.end - self.first
    }
}

impl FromStr for Seeds {
    type Err = SeedsError;

    fn from_str(text: &str) -> Result<Self, SeedsError> {
        let form = || SeedsError::Form(text.into());
        let (first, end) = text.split_once("..").ok_or_else(form)?;
        let number = |digits: &str| digits.trim().parse::<u64>().map_err(|_| form());
        let (first, end) = (number(first)?, number(end)?);
        match end.checked_sub(first) {
            None | Some(0) => Err(SeedsError::Empty(text.into())),
            Some(count) if count > MOST_SEEDS => Err(SeedsError::Many(text.into())),
            Some(_) => Ok(Self { first, end }),
        }
    }
}

impl TryFrom<String> for Seeds {
    type Error = SeedsError;

    fn try_from(text: String) -> Result<Self, SeedsError> {
        text.parse()
    }
}

impl From<Seeds> for String {
    fn from(seeds: Seeds) -> Self {
        seeds.to_string()
    }
}

impl fmt::Display for Seeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.first, self.end)
    }
}

/// The plan of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of the trainer.
    pub trainer: String,
    /// All seeds of the study, whatever the shard.
    pub seeds: Seeds,
    /// Number of random starts of an evaluation, at each density ratio and in each condition.
    pub eval_starts: u32,
    /// Seed of these starts.
    pub eval_seed: u64,
    /// Configuration of the trainings.
    pub config: Config,
}

impl Plan {
    /// Creates a plan for this version of the trainer.
    #[must_use]
    pub fn new(config: Config, seeds: Seeds, eval_starts: u32, eval_seed: u64) -> Self {
        let trainer = env!("CARGO_PKG_VERSION").into();
        Self { trainer, seeds, eval_starts, eval_seed, config }
    }

    /// Returns the complete plan as TOML.
    ///
    /// # Panics
    /// Never: every field has a TOML form.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("every field has a TOML form")
    }

    /// Returns a fingerprint of everything that a seed's result depends on: 16 hexadecimal
    /// digits.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        // A seed's result does not depend on the other seeds.
        let one = Self { seeds: Seeds { first: 0, end: 1 }, ..self.clone() };
        format!("{:016x}", Crc::<u64>::new(&CRC_64_XZ).checksum(one.to_toml().as_bytes()))
    }

    /// Returns the first key in which another plan, in TOML, differs from this one, with the
    /// other value and this one; `None` when they are the same.
    #[must_use]
    pub fn difference(&self, other: &Table) -> Option<[String; 3]> {
        let here: Table = self.to_toml().parse().expect("TOML, just written");
        difference("", &Value::Table(other.clone()), &Value::Table(here))
    }
}

fn difference(key: &str, there: &Value, here: &Value) -> Option<[String; 3]> {
    let text = |value: Option<&Value>| value.map_or_else(|| "absent".into(), ToString::to_string);
    let inner = |name: &str| if key.is_empty() { name.into() } else { format!("{key}.{name}") };
    let one = |key: String, there: Option<&Value>, here: Option<&Value>| match (there, here) {
        (Some(there), Some(here)) => difference(&key, there, here),
        _ => Some([key, text(there), text(here)]),
    };
    match (there, here) {
        (Value::Table(a), Value::Table(b)) => {
            let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.into_iter().find_map(|name| one(inner(name), a.get(name), b.get(name)))
        }
        (Value::Array(a), Value::Array(b)) => {
            (0..a.len().max(b.len())).find_map(|i| one(format!("{key}[{i}]"), a.get(i), b.get(i)))
        }
        _ if there == here => None,
        _ => Some([key.into(), text(Some(there)), text(Some(here))]),
    }
}

#[cfg(test)]
mod tests {
    use super::{Plan, Seeds};
    use crate::preset::Preset;

    fn plan() -> Plan {
        Plan::new(Preset::Robust.config(), "3..7".parse().unwrap(), 100, 1)
    }

    #[test]
    fn a_range_of_seeds_excludes_its_end() {
        let seeds: Seeds = "3..7".parse().unwrap();
        assert_eq!(seeds.iter().collect::<Vec<_>>(), [3, 4, 5, 6]);
        assert_eq!((seeds.count(), seeds.to_string().as_str()), (4, "3..7"));
        for (text, expected) in [
            ("3", "'3' is not FIRST..END"),
            ("a..7", "'a..7' is not FIRST..END"),
            ("-1..7", "'-1..7' is not"),
            ("7..7", "7..7 holds no seed"),
            ("8..7", "8..7 holds no seed"),
            ("0..1000001", "more than 1000000 seeds"),
        ] {
            let error = text.parse::<Seeds>().unwrap_err().to_string();
            assert!(error.starts_with(expected) || error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_difference_names_the_key_and_both_values() {
        let plan = plan();
        let table = || plan.to_toml().parse::<toml::Table>().unwrap();
        assert_eq!(plan.difference(&table()), None);
        assert_eq!(toml::from_str::<Plan>(&plan.to_toml()).unwrap(), plan);
        let mut other = plan.clone();
        other.config.learning.batch = 32;
        let difference = other.difference(&table()).unwrap();
        assert_eq!(difference, ["config.learning.batch", "64", "32"]);
        let mut longer = table();
        longer.insert("more".into(), 1.into());
        assert_eq!(plan.difference(&longer).unwrap(), ["more", "1", "absent"]);
        other = plan.clone();
        other.config.stages.push(other.config.stages[0].clone());
        assert_eq!(other.difference(&table()).unwrap()[..2], ["config.stages[1]", "absent"]);
    }

    #[test]
    fn the_fingerprint_depends_on_all_but_the_range_of_seeds() {
        let plan = plan();
        let seeds = Plan { seeds: "0..100".parse().unwrap(), ..plan.clone() };
        assert_eq!(plan.fingerprint(), seeds.fingerprint());
        let starts = Plan { eval_starts: 101, ..plan.clone() };
        assert_ne!(plan.fingerprint(), starts.fingerprint());
        assert_eq!(plan.fingerprint().len(), 16);
    }
}
