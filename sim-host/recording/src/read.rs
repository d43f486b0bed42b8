//! Reads a recording, also one that was cut off or written anew by another program.

mod chunk;
mod records;

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hasher};
use std::io;
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::{McapError, McapResult};

use super::schema::{AnyMessage, Channel, PROFILE};
use super::versions::as_of_this_version;
pub(crate) use records::Records;

/// Why a file cannot be read as a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// Opening or reading the file failed.
    #[error("cannot read the recording {}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
    /// The path is that of a pipe or a device, which cannot be read twice.
    #[error("{} is no regular file, but is to be read several times; write it to one first", .0.display())]
    NotRegular(PathBuf),
    /// The file is not an MCAP file.
    #[error("{} is not an MCAP file", .0.display())]
    NotMcap(PathBuf),
    /// The file is an MCAP file without any message of a recording.
    #[error(
        "{} is an MCAP file, but not a recording of this leg: its profile is `{profile}`, not \
         `{PROFILE}`, and it has no message of a recording",
        path.display()
    )]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// The profile.
        profile: String,
    },
    /// A chunk is compressed by a method that this reader does not know.
    #[error(
        "{} is compressed by `{compression}`, which cannot be read here; `lz4` and `zstd` can, and \
         so can an uncompressed file",
        path.display()
    )]
    Compressed {
        /// The file.
        path: PathBuf,
        /// Name of the compression.
        compression: String,
    },
    /// The recording lacks a part.
    #[error("{} contains no {what} (topic {}): {}", path.display(), topic.topic(), missing(*is_cut))]
    Missing {
        /// The file.
        path: PathBuf,
        /// The missing part.
        what: &'static str,
        /// Its channel.
        topic: Channel,
        /// Whether the file is cut off or damaged.
        is_cut: bool,
    },
    /// The file holds several recordings.
    #[error(
        "{} holds more than one run ({how}), as when recordings are merged or joined; use each \
         recording by itself",
        path.display()
    )]
    Merged {
        /// The file.
        path: PathBuf,
        /// How that shows.
        how: String,
    },
    /// The messages are not in order, and too many to be sorted.
    #[error(
        "the {messages} messages of {} are not in order of time, and more than {limit} cannot be \
         sorted here; sort them by another program, such as `mcap sort`",
        path.display()
    )]
    TooManyToSort {
        /// The file.
        path: PathBuf,
        /// Its number of messages.
        messages: u64,
        /// The most that can be sorted.
        limit: u64,
    },
}

/// Returns the cause of a missing part.
fn missing(is_cut: bool) -> &'static str {
    if is_cut {
        "it was cut off or damaged before the first one"
    } else {
        "none was recorded, or another program has removed them"
    }
}

/// A message with the time and hash by which messages can be ordered and compared.
#[derive(Clone, Debug)]
pub struct TimedMessage {
    /// Log time, ns since 1970.
    pub log_time_ns: u64,
    /// Hash of the encoded message.
    pub hash: u64,
    /// The message.
    pub message: AnyMessage,
}

/// Reads a recording message by message.
pub struct Reader {
    records: Records,
    profile: String,
    channels: Channels,
}

impl Reader {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not an MCAP file.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let (records, profile) = Records::open(path)?;
        Ok(Self { records, profile, channels: Channels::default() })
    }

    /// Returns the profile in the file's header; other programs may drop it.
    #[must_use]
    pub fn profile(&self) -> &str {
        &self.profile
    }

    /// Returns the next message; `None` at the end of the file, or where it was
    /// cut off.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn next_message(&mut self) -> Result<Option<TimedMessage>, ReadError> {
        let Self { records, channels, .. } = self;
        let message = records.next_message(|record| channels.step(record))?;
        Ok(message.map(|message| *message))
    }

    /// Returns a description of what was wrong with the file, for the user. It
    /// is complete only after the last message.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.records.warning()
    }
}

/// The channels of the file that are those of a recording.
#[derive(Debug, Default)]
struct Channels {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Channel>,
}

impl Channels {
    /// Returns the message in a record, if it has one of a recording.
    fn step(&mut self, record: &Record<'_>) -> McapResult<Option<Box<TimedMessage>>> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name.clone());
            }
            Record::Channel(found) => {
                // Channels that other programs added are ignored.
                let schema = self.schemas.get(&found.schema_id);
                let is_ours = |ours: &Channel| {
                    found.topic == ours.topic()
                        && found.message_encoding == "protobuf"
                        && schema.is_none_or(|name| *name == ours.schema())
                };
                if let Some(ours) = Channel::ALL.iter().copied().find(is_ours) {
                    self.channels.insert(found.id, ours);
                }
            }
            Record::Message { header, data } => {
                if let Some(channel) = self.channels.get(&header.channel_id) {
                    let message = AnyMessage::decode(*channel, data).map_err(|error| {
                        McapError::DecompressionError(format!("{}: {error}", channel.topic()))
                    })?;
                    let mut hasher = DefaultHasher::new();
                    hasher.write(data);
                    let hash = hasher.finish();
                    let log_time_ns = header.log_time;
                    let message = as_of_this_version(message);
                    return Ok(Some(Box::new(TimedMessage { log_time_ns, hash, message })));
                }
            }
            _ => (),
        }
        Ok(None)
    }
}
