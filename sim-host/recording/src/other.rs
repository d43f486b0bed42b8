//! Channels of MCAP files that other programs made.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use mcap::records::Record;

use crate::read::{ReadError, Records};

/// Returns whether a file begins as MCAP files do.
#[must_use]
pub fn is_mcap(first_bytes: &[u8]) -> bool {
    first_bytes.starts_with(mcap::MAGIC)
}

/// Returns the encoding of the messages of each topic in a file, and a description of what was
/// wrong with the file, for the user.
///
/// # Errors
/// [`ReadError`] if the file is not an MCAP file.
pub fn encodings(path: &Path) -> Result<(BTreeMap<String, String>, Option<String>), ReadError> {
    let (mut records, _) = Records::open(path)?;
    let mut found = BTreeMap::new();
    records.next_message(|record| {
        if let Record::Channel(channel) = record {
            found.insert(channel.topic.clone(), channel.message_encoding.clone());
        }
        Ok(None::<()>)
    })?;
    Ok((found, records.warning()))
}

/// Calls `take` with each record of a file up to its end, or up to where it was cut off, whoever
/// wrote it.
///
/// # Errors
/// [`ReadError`] if it is not an MCAP file, and the first error of `take`.
pub fn for_each_record<E: From<ReadError>>(
    path: &Path,
    mut take: impl FnMut(&Record<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let (mut records, _) = Records::open(path)?;
    records.next_message(|record| Ok(take(record).err()))?.map_or(Ok(()), Err)
}

/// A message of a channel, as it is in the file.
#[derive(Clone, Debug)]
pub struct RawMessage {
    /// Log time, ns.
    pub log_time_ns: u64,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Reads the messages of one topic.
pub struct TopicReader {
    records: Records,
    topic: String,
    channels: HashSet<u16>,
}

impl TopicReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`ReadError`] if it is not an MCAP file.
    pub fn open(path: &Path, topic: &str) -> Result<Self, ReadError> {
        let (records, _) = Records::open(path)?;
        Ok(Self { records, topic: topic.to_owned(), channels: HashSet::new() })
    }

    /// Returns the next message; `None` at the end of the file, or where it was cut off.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn next_message(&mut self) -> Result<Option<RawMessage>, ReadError> {
        let Self { records, topic, channels } = self;
        records.next_message(|record| {
            match record {
                Record::Channel(channel) if channel.topic == *topic => {
                    channels.insert(channel.id);
                }
                Record::Message { header, data } if channels.contains(&header.channel_id) => {
                    let log_time_ns = header.log_time;
                    return Ok(Some(RawMessage { log_time_ns, bytes: data.to_vec() }));
                }
                _ => (),
            }
            Ok(None)
        })
    }

    /// Returns a description of what was wrong with the file, for the user. It is complete only
    /// after the last message.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.records.warning()
    }
}
