//! Configurations as text: printed with a comment at every key, read from files, and changed
//! key by key.

use super::keys::{Key, find, randomisation};
use super::randomisation::TABLE;
use super::{Config, ConfigError};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Largest configuration file, bytes.
const LONGEST: u64 = 1 << 20;

/// The reason why a file is no configuration that can be trained.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be read.
    #[error("cannot read the configuration {}: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        cause: io::Error,
    },
    /// The file is not TOML, or has a key that is unknown, missing or of another type.
    #[error("{}: {cause}\n`trainer config show --preset P` prints a complete configuration", path.display())]
    Syntax {
        /// Path of the file.
        path: PathBuf,
        /// Place in the file, and what was expected.
        cause: Box<toml::de::Error>,
    },
    /// The file has no table of this name.
    #[error("{}: it has no table [{table}]; add one, with a distribution for each quantity", path.display())]
    NoTable {
        /// Path of the file.
        path: PathBuf,
        /// Name of the table.
        table: &'static str,
    },
    /// A parameter is out of range.
    #[error("{}: {cause}", path.display())]
    Parameter {
        /// Path of the file.
        path: PathBuf,
        /// The parameter.
        cause: ConfigError,
    },
}

/// The reason why a parameter cannot be set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// The setting has no `=`.
    #[error("{0}: expected KEY=VALUE, such as learning.batch=32")]
    Form(String),
    /// The configuration has no such key.
    #[error("{setting}: no key {key} here; `trainer config show` prints all keys")]
    Key {
        /// The setting as given.
        setting: String,
        /// The part of the path that does not exist.
        key: String,
    },
    /// The value has another type.
    #[error("{setting}: {what}")]
    Value {
        /// The setting as given.
        setting: String,
        /// What was found and expected.
        what: String,
    },
}

/// Reads a file of at most [`LONGEST`] bytes.
pub(super) fn read_text(path: &Path) -> Result<String, ReadError> {
    let read = |cause| ReadError::Read { path: path.into(), cause };
    let length = std::fs::metadata(path).map_err(read)?.len();
    if length > LONGEST {
        let long = format!("it has {length} bytes, at most {LONGEST}");
        return Err(read(io::Error::new(io::ErrorKind::FileTooLarge, long)));
    }
    std::fs::read_to_string(path).map_err(read)
}

/// Returns the message of a value of another type in words of TOML instead of Rust.
fn in_plain_words(cause: &toml::de::Error) -> String {
    let message = cause.message().replace("invalid type: ", "");
    let Some((found, expected)) = message.rsplit_once(", expected ") else { return message };
    let expected = match expected {
        "usize" | "u32" | "u64" => "a whole number from 0",
        "f32" | "f64" => "a number",
        "a sequence" => "a list in [ ]",
        text if text.starts_with("struct ") => "a table in { }",
        text => text,
    };
    format!("{found}, expected {expected}")
}

impl Config {
    /// Returns the complete configuration as TOML.
    ///
    /// # Panics
    /// Never for a configuration that passes [`Self::check`]: every field has a TOML form.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("every field has a TOML form")
    }

    /// Returns the configuration as [`Self::to_toml`] does, with description, unit and range
    /// above every key.
    ///
    /// # Panics
    /// As [`Self::to_toml`].
    #[must_use]
    pub fn to_commented_toml(&self) -> String {
        let mut text = String::from(
            "# Every parameter of a training: `trainer train --config FILE --seed N --out X.bin`.\n",
        );
        // Each line is a header, a key with its value, or empty.
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
        self.comment_on_what_is_not_randomised(&mut text);
        text
    }

    /// Adds the quantities without a distribution, which have no key, as comments.
    fn comment_on_what_is_not_randomised(&self, text: &mut String) {
        let present = |key: &Key| match key.path.split_once('.') {
            None => self.randomisation.is_some(),
            Some((_, "share")) => true,
            Some((_, name)) => self.randomisation.as_ref().is_some_and(|randomisation| {
                randomisation.parameters().any(|parameter| parameter.key() == name)
            }),
        };
        let absent: Vec<&Key> = randomisation().filter(|key| !present(key)).collect();
        if absent.is_empty() {
            return;
        }
        text.push_str(
            "\n# Not randomised; for example --set \
             'randomisation.mass={ kind = \"uniform\", low = 0.8, high = 1.2 }':\n",
        );
        for key in absent {
            _ = writeln!(text, "# {}: {key}", key.path);
        }
    }

    /// Reads a complete configuration from a TOML file and checks it.
    ///
    /// # Errors
    /// [`ReadError`] with the file, the key, its value and its limit.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let text = read_text(path)?;
        let config: Self = toml::from_str(&text)
            .map_err(|cause| ReadError::Syntax { path: path.into(), cause: Box::new(cause) })?;
        config.check().map_err(|cause| ReadError::Parameter { path: path.into(), cause })?;
        Ok(config)
    }

    /// Returns the configuration with one parameter changed, such as `learning.batch=32`,
    /// `stages.0.length.steps=1000` or `exploration.deviation=[0.01, 0.3]`. The result is not
    /// [checked](Self::check).
    ///
    /// # Errors
    /// [`SetError`] when there is no such key, or the value is of another type.
    ///
    /// # Panics
    /// As [`Self::to_toml`].
    pub fn with(&self, setting: &str) -> Result<Self, SetError> {
        let form = || SetError::Form(setting.into());
        let (path, value) = setting.split_once('=').ok_or_else(form)?;
        // A value that is not TOML is taken as a string.
        let value = toml::from_str::<Table>(&format!("value = {value}"))
            .ok()
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| Value::String(value.trim().into()));
        let table = self.to_toml().parse::<Table>().expect("what was printed");
        let mut root = Value::Table(table);
        let mut at = &mut root;
        let mut reached = String::new();
        for key in path.trim().split('.') {
            reached = if reached.is_empty() { key.into() } else { format!("{reached}.{key}") };
            let inner = match at {
                // A quantity that is not randomised yet has no key, but its name is known.
                Value::Table(table) => {
                    if reached.starts_with(TABLE) && find(&reached).is_some() {
                        Some(table.entry(key).or_insert_with(|| Value::Table(Table::new())))
                    } else {
                        table.get_mut(key)
                    }
                }
                Value::Array(list) => key.parse().ok().and_then(|i: usize| list.get_mut(i)),
                _ => None,
            };
            let missing = || SetError::Key { setting: setting.into(), key: key.into() };
            at = inner.ok_or_else(missing)?;
        }
        *at = value;
        root.try_into().map_err(|cause| SetError::Value {
            setting: setting.into(),
            what: in_plain_words(&cause),
        })
    }

    /// Returns the first key in which this configuration differs from another, with both
    /// values; `None` when they are the same.
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
