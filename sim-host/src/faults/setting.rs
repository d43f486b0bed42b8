//! A fault as a user writes it: `drop=0.1,direction=commands` on the command line, or a `[[fault]]`
//! table in a scenario file with the same names.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::de::{Deserializer, Error as _};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};

use super::catalog::{self, FaultKind};

/// A fault as a user wrote it: a kind with its value, and further keys. The names are checked, the
/// values are not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultSetting {
    pub(super) kind: FaultKind,
    pub(super) value: String,
    pub(super) keys: BTreeMap<String, String>,
}

/// A fault that cannot be used; the message is one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FaultError(pub(super) String);

impl FaultSetting {
    /// Creates a setting from names and values in any order. Exactly one name must be a kind.
    fn from_pairs(pairs: impl IntoIterator<Item = (String, String)>) -> Result<Self, FaultError> {
        let (mut found, mut keys) = (None, BTreeMap::new());
        for (name, value) in pairs {
            if let Some(kind) = FaultKind::named(&name) {
                if let Some((first, _)) = found.replace((kind, value)) {
                    return Err(FaultError(format!(
                        "`{}` and `{name}` are two faults; each needs a setting of its own",
                        FaultKind::name(first)
                    )));
                }
            } else if keys.insert(name.clone(), value).is_some() {
                return Err(FaultError(format!("`{name}` is given twice")));
            }
        }
        let Some((kind, value)) = found else {
            let unknown = keys.into_keys().next().unwrap_or_default();
            return Err(FaultError(format!(
                "`{unknown}` is not a kind of fault; the kinds are {}",
                catalog::names()
            )));
        };
        let known = kind.info().keys;
        if let Some(key) = keys.keys().find(|key| !known.contains(&key.as_str())) {
            return Err(FaultError(format!(
                "`{}` has no key `{key}`; its keys are: {}",
                kind.name(),
                if known.is_empty() { "none".to_owned() } else { known.join(", ") }
            )));
        }
        Ok(Self { kind, value, keys })
    }
}

impl FromStr for FaultSetting {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let pairs = text.split(',').map(|part| match part.split_once('=') {
            Some((name, value)) => Ok((name.trim().to_owned(), value.trim().to_owned())),
            None => Err(FaultError(format!(
                "`{part}` is not key=value; a fault is kind=value,key=value,... with one of the kinds {}",
                catalog::names()
            ))),
        });
        Self::from_pairs(pairs.collect::<Result<Vec<_>, _>>()?)
    }
}

impl fmt::Display for FaultSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.kind.name(), self.value)?;
        self.keys.iter().try_for_each(|(key, value)| write!(f, ",{key}={value}"))
    }
}

/// A value of a `[[fault]]` table.
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
        Self::from_pairs(table.into_iter().map(|(name, value)| (name, value.into())))
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
