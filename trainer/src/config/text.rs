//! Configurations as text: printed with a comment at every key, read from files,
//! and changed key by key.

use super::keys::find;
use super::{Config, ConfigError};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Longest configuration file, bytes.
const LONGEST: u64 = 1 << 20;

/// Why a file is no configuration to train.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// It cannot be read.
    #[error("cannot read the configuration {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// It is not TOML, or has a key that is unknown, missing or of another type.
    #[error("{}: {cause}\n`trainer config show --preset P` prints a complete configuration", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where, and what was expected.
        cause: Box<toml::de::Error>,
    },
    /// A figure is out of range.
    #[error("{}: {cause}", path.display())]
    Parameter {
        /// The file.
        path: PathBuf,
        /// Which.
        cause: ConfigError,
    },
}

/// Why a single figure could not be set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// There is no `=`.
    #[error("{0}: expected KEY=VALUE, such as learning.batch=32")]
    Form(String),
    /// There is no such key in this configuration.
    #[error("{setting}: no key {key} here; `trainer config show` prints all keys")]
    Key {
        /// As given.
        setting: String,
        /// The part that leads nowhere.
        key: String,
    },
    /// The value does not fit.
    #[error("{setting}: {cause}")]
    Value {
        /// As given.
        setting: String,
        /// What was expected.
        cause: Box<toml::de::Error>,
    },
}

impl Config {
    /// As TOML, complete.
    ///
    /// # Panics
    /// Never for what passes [`Self::check`]: every field has a TOML form.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("every field has a TOML form")
    }

    /// As [`Self::to_toml`], with what it is, unit and range above every key.
    ///
    /// # Panics
    /// As [`Self::to_toml`].
    #[must_use]
    pub fn to_commented_toml(&self) -> String {
        let mut text = String::from(
            "# Every figure of a training: `trainer train --config FILE --seed N --out X.bin`.\n",
        );
        // A line holds a header, a key with its value, or nothing.
        let mut table = String::new();
        for line in self.to_toml().lines() {
            let header = line.trim_start_matches('[').trim_end_matches(']');
            let path = if line.starts_with('[') {
                table = format!("{header}.");
                header.to_owned()
            } else {
                line.split_once(" = ").map(|(key, _)| format!("{table}{key}")).unwrap_or_default()
            };
            if let Some(key) = find(&path) {
                _ = writeln!(text, "# {key}");
            }
            _ = writeln!(text, "{line}");
        }
        text
    }

    /// From a TOML file, complete and in range.
    ///
    /// # Errors
    /// [`ReadError`] with the file, the key, its value and its limit.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let read = |cause| ReadError::Read { path: path.into(), cause };
        let length = std::fs::metadata(path).map_err(read)?.len();
        if length > LONGEST {
            let long = format!("it has {length} bytes, at most {LONGEST}");
            return Err(read(io::Error::new(io::ErrorKind::FileTooLarge, long)));
        }
        let text = std::fs::read_to_string(path).map_err(read)?;
        let config: Self = toml::from_str(&text)
            .map_err(|cause| ReadError::Syntax { path: path.into(), cause: Box::new(cause) })?;
        config.check().map_err(|cause| ReadError::Parameter { path: path.into(), cause })?;
        Ok(config)
    }

    /// With one figure changed: `learning.batch=32`, `stages.0.length.steps=1000`,
    /// `exploration.deviation=[0.01, 0.3]`. It must still be [checked](Self::check).
    ///
    /// # Errors
    /// [`SetError`] when there is no such key, or the value is of another type.
    ///
    /// # Panics
    /// As [`Self::to_toml`].
    pub fn with(&self, setting: &str) -> Result<Self, SetError> {
        let form = || SetError::Form(setting.into());
        let (path, value) = setting.split_once('=').ok_or_else(form)?;
        // What is no TOML value is a word.
        let value = toml::from_str::<Table>(&format!("value = {value}"))
            .ok()
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| Value::String(value.trim().into()));
        let table = self.to_toml().parse::<Table>().expect("what was printed");
        let mut root = Value::Table(table);
        let mut at = &mut root;
        for key in path.trim().split('.') {
            let inner = match at {
                Value::Table(table) => table.get_mut(key),
                Value::Array(list) => key.parse().ok().and_then(|i: usize| list.get_mut(i)),
                _ => None,
            };
            let missing = || SetError::Key { setting: setting.into(), key: key.into() };
            at = inner.ok_or_else(missing)?;
        }
        *at = value;
        root.try_into()
            .map_err(|cause| SetError::Value { setting: setting.into(), cause: Box::new(cause) })
    }

    /// The first key, with both its values, in which this configuration differs
    /// from another; `None` when they are the same.
    ///
    /// # Panics
    /// As [`Self::to_toml`].
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        let table = |config: &Self| {
            Value::Table(config.to_toml().parse::<Table>().expect("what was printed"))
        };
        difference("", &table(self), &table(other))
    }
}

fn difference(path: &str, one: &Value, other: &Value) -> Option<String> {
    let inner = |key: &str| if path.is_empty() { key.into() } else { format!("{path}.{key}") };
    match (one, other) {
        (Value::Table(a), Value::Table(b)) => {
            let missing = |key: &&String| !a.contains_key(*key);
            if let Some(key) = b.keys().find(missing) {
                return Some(format!("{} is missing in one", inner(key)));
            }
            a.iter().find_map(|(key, value)| match b.get(key) {
                Some(with) => difference(&inner(key), value, with),
                None => Some(format!("{} is missing in one", inner(key))),
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => a
            .iter()
            .zip(b)
            .enumerate()
            .find_map(|(i, (a, b))| difference(&inner(&i.to_string()), a, b)),
        _ => (one != other).then(|| format!("{path} is {one} in one and {other} in the other")),
    }
}
