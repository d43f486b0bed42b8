//! Reads a recording, also one that was cut off or written anew by another program.

mod chunk;

use std::collections::HashMap;
use std::fs::File;
use std::hash::{DefaultHasher, Hasher};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, McapResult};

use super::schema::{AnyMessage, Channel, PROFILE};
use super::versions::as_of_this_version;
use chunk::Chunk;

/// Longest chunk or message accepted, bytes.
const MAX_RECORD_LEN: usize = 1 << 27;
/// Bytes read from the file at once, at least.
const BUFFER_LEN: usize = 1 << 18;

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

/// Reads a recording chunk by chunk and verifies the checksum of each.
pub struct Reader {
    path: PathBuf,
    file: File,
    mcap: LinearReader,
    profile: String,
    /// The decompressed chunk that is being read.
    chunk: Chunk,
    channels: Channels,
    /// The end record of a complete file was read.
    finished: bool,
    flaw: Option<String>,
}

impl Reader {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not an MCAP file.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file =
            File::open(path).map_err(|cause| ReadError::Io { path: path.to_owned(), cause })?;
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(MAX_RECORD_LEN);
        let mut reader = Self {
            path: path.to_owned(),
            file,
            mcap: LinearReader::new_with_options(options),
            profile: String::new(),
            chunk: Chunk::default(),
            channels: Channels::default(),
            finished: false,
            flaw: None,
        };
        match reader.step()? {
            Step::Header(profile) => reader.profile = profile,
            _ => return Err(ReadError::NotMcap(path.to_owned())),
        }
        Ok(reader)
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
        loop {
            match self.step()? {
                Step::Message(message) => return Ok(Some(*message)),
                Step::Header(_) | Step::Other => (),
                Step::End => return Ok(None),
            }
        }
    }

    /// Returns a description of what was wrong with the file, for the user. It
    /// is complete only after the last message.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let what = match &self.flaw {
            Some(flaw) => format!("it is damaged ({flaw})"),
            None if self.finished => return None,
            None => "it is cut off".to_owned(),
        };
        Some(format!(
            "{}: {what}; it was read up to the last complete chunk before that",
            self.path.display()
        ))
    }

    fn step(&mut self) -> Result<Step, ReadError> {
        loop {
            if self.flaw.is_some() {
                return Ok(Step::End);
            }
            let step = if self.chunk.is_read() {
                match self.mcap.next_event() {
                    None | Some(Err(McapError::UnexpectedEof)) => return Ok(Step::End),
                    Some(Ok(LinearReadEvent::ReadRequest(least))) => {
                        let space = self.mcap.insert(least.max(BUFFER_LEN));
                        let io = |cause| ReadError::Io { path: self.path.clone(), cause };
                        let read = self.file.read(space).map_err(io)?;
                        self.mcap.notify_read(read);
                        continue;
                    }
                    Some(Ok(LinearReadEvent::Record { opcode: op::CHUNK, data })) => {
                        Chunk::open(data, MAX_RECORD_LEN).map(|chunk| {
                            self.chunk = chunk;
                            Step::Other
                        })
                    }
                    Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                        mcap::parse_record(opcode, data)
                            .and_then(|record| self.channels.step(&record))
                    }
                    Some(Err(error)) => Err(error),
                }
            } else {
                self.chunk.next_record().and_then(|record| self.channels.step(&record))
            };
            match step {
                Err(McapError::BytesAfterEndMagic) => {
                    let how = "bytes follow its end".to_owned();
                    return Err(ReadError::Merged { path: self.path.clone(), how });
                }
                // What follows is the index, which is not needed.
                Err(_) if self.finished => return Ok(Step::End),
                Ok(_) if self.finished => (),
                Ok(Step::End) => self.finished = true,
                Ok(step) => return Ok(step),
                Err(McapError::UnsupportedCompression(compression)) => {
                    return Err(ReadError::Compressed { path: self.path.clone(), compression });
                }
                Err(flaw) => self.flaw = Some(flaw.to_string()),
            }
        }
    }
}

enum Step {
    Header(String),
    Message(Box<TimedMessage>),
    Other,
    End,
}

/// The channels of the file that are those of a recording.
#[derive(Debug, Default)]
struct Channels {
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Channel>,
}

impl Channels {
    fn step(&mut self, record: &Record<'_>) -> McapResult<Step> {
        match record {
            Record::Header(header) => return Ok(Step::Header(header.profile.clone())),
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
                    return Ok(Step::Message(Box::new(TimedMessage {
                        log_time_ns,
                        hash,
                        message: as_of_this_version(message),
                    })));
                }
            }
            Record::DataEnd(_) => return Ok(Step::End),
            _ => (),
        }
        Ok(Step::Other)
    }
}
