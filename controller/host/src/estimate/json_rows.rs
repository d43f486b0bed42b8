//! The messages in JSON of a topic of an MCAP file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use leg_recording::other::TopicReader;
use serde_json::{Map, Value};

use super::column::Column;
use super::log::LogError;
use super::row::{Row, shown};

/// The messages in JSON of a topic.
pub(super) struct JsonRows {
    path: PathBuf,
    topic: String,
    pub(super) reader: TopicReader,
    number: u64,
    /// Names of all fields so far.
    pub(super) names: BTreeSet<String>,
}

impl JsonRows {
    /// Opens the file.
    pub(super) fn open(path: &Path, topic: String) -> Result<Self, LogError> {
        let reader = TopicReader::open(path, &topic)?;
        Ok(Self { path: path.to_owned(), topic, reader, number: 0, names: BTreeSet::new() })
    }

    /// Returns the next row, none after the last.
    pub(super) fn next_row(&mut self) -> Result<Option<Row>, LogError> {
        let Some(message) = self.reader.next_message()? else { return Ok(None) };
        self.number += 1;
        let Self { path, topic, number, names, .. } = self;
        let fields: Map<String, Value> =
            serde_json::from_slice(&message.bytes).map_err(|cause| LogError::Json {
                path: path.clone(),
                topic: topic.clone(),
                number: *number,
                cause: shown(&cause.to_string()),
            })?;
        let place = || format!("message {number} of {topic}");
        // Without a time of its own a message has that of the log.
        let mut row = Row::new(message.log_time_ns.into());
        for (name, value) in &fields {
            if !names.contains(name) {
                names.insert(name.clone());
            }
            let Some(column) = Column::named(name) else { continue };
            match value {
                Value::Null => (),
                Value::String(text) => row.set(column, text, path, place)?,
                value => row.set(column, &value.to_string(), path, place)?,
            }
        }
        Ok(Some(row))
    }
}
