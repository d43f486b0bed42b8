//! A fault as a user says it: `--fault drop=0.1,direction=commands`, or in a
//! scenario file `[[fault]]` with the same names.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::de::{Deserializer, Error as _};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};

use super::catalog::{self, Kind};

/// A kind, its value, and the keys beside it: the names are known, the values are
/// not checked yet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultSetting {
    pub(super) kind: Kind,
    pub(super) value: String,
    pub(super) keys: BTreeMap<String, String>,
}

/// What is wrong with a fault; one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadFault(pub(super) String);

impl FaultSetting {
    /// From names and values in any order, exactly one name that of a kind.
    fn of(pairs: impl IntoIterator<Item = (String, String)>) -> Result<Self, BadFault> {
        let (mut found, mut keys) = (None, BTreeMap::new());
        for (name, value) in pairs {
            if let Some(kind) = Kind::named(&name) {
                if let Some((first, _)) = found.replace((kind, value)) {
                    return Err(BadFault(format!(
                        "`{}` and `{name}` are two faults: say each in a --fault, or a [[fault]], of its own",
                        Kind::name(first)
                    )));
                }
            } else if keys.insert(name.clone(), value).is_some() {
                return Err(BadFault(format!("`{name}` is said twice")));
            }
        }
        let Some((kind, value)) = found else {
            let said = keys.into_keys().next().unwrap_or_default();
            return Err(BadFault(format!(
                "`{said}` is not a fault; there are {}; `sim-host faults` explains them",
                catalog::names()
            )));
        };
        let known = kind.row().keys;
        if let Some(key) = keys.keys().find(|key| !known.contains(&key.as_str())) {
            return Err(BadFault(format!(
                "`{}` has no key `{key}`; it has {}; `sim-host faults` explains them",
                kind.name(),
                known.join(", ")
            )));
        }
        Ok(Self { kind, value, keys })
    }
}

impl FromStr for FaultSetting {
    type Err = BadFault;

    fn from_str(text: &str) -> Result<Self, BadFault> {
        let pairs = text.split(',').map(|part| match part.split_once('=') {
            Some((name, value)) => Ok((name.trim().to_owned(), value.trim().to_owned())),
            None => Err(BadFault(format!(
                "`{part}` is not key=value; a fault is kind=value,key=value,… of the kinds {}; \
                 `sim-host faults` explains them",
                catalog::names()
            ))),
        });
        Self::of(pairs.collect::<Result<Vec<_>, _>>()?)
    }
}

impl fmt::Display for FaultSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.kind.name(), self.value)?;
        self.keys.iter().try_for_each(|(key, value)| write!(f, ",{key}={value}"))
    }
}

/// A value in a scenario file.
#[derive(Deserialize)]
#[serde(untagged)]
enum Scalar {
    Whole(i64),
    Number(f64),
    Text(String),
}

impl From<Scalar> for String {
    fn from(scalar: Scalar) -> Self {
        match scalar {
            Scalar::Whole(number) => number.to_string(),
            Scalar::Number(number) => number.to_string(),
            Scalar::Text(text) => text,
        }
    }
}

impl<'de> Deserialize<'de> for FaultSetting {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = BTreeMap::<String, Scalar>::deserialize(deserializer)?;
        Self::of(table.into_iter().map(|(name, value)| (name, value.into())))
            .map_err(D::Error::custom)
    }
}

impl Serialize for FaultSetting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(1 + self.keys.len()))?;
        map.serialize_entry(self.kind.name(), &self.value)?;
        for (key, value) in &self.keys {
            map.serialize_entry(key, value)?;
        }
        map.end()
    }
}
