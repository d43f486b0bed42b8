//! Reads a recording, also one that was cut off.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::schema::{AnyMessage, Channel, PROFILE};

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
    /// The file is an MCAP file with another profile.
    #[error(
        "{} is an MCAP file, but not a recording of this leg: its profile is `{profile}`, not `{PROFILE}`",
        path.display()
    )]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// The profile.
        profile: String,
    },
    /// The file is compressed, which this reader does not support.
    #[error("{} is compressed ({compression}), which is not supported; `mcap decompress` converts it", path.display())]
    Compressed {
        /// The file.
        path: PathBuf,
        /// Name of the compression.
        compression: String,
    },
    /// The recording lacks what every recording begins with.
    #[error("{}: the recording was cut off before its first {what}", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// The missing part.
        what: &'static str,
    },
}

/// Reads a recording chunk by chunk and verifies the checksum of each.
pub struct Reader {
    path: PathBuf,
    file: File,
    mcap: LinearReader,
    channels: HashMap<u16, Channel>,
    /// The end record of a complete file was read.
    finished: bool,
    flaw: Option<String>,
}

impl Reader {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a recording.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file =
            File::open(path).map_err(|cause| ReadError::Io { path: path.to_owned(), cause })?;
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_LEN);
        let mut reader = Self {
            path: path.to_owned(),
            file,
            mcap: LinearReader::new_with_options(options),
            channels: HashMap::new(),
            finished: false,
            flaw: None,
        };
        match reader.step()? {
            Step::Header(profile) if profile == PROFILE => Ok(reader),
            Step::Header(profile) => Err(ReadError::NotOurs { path: path.to_owned(), profile }),
            _ => Err(ReadError::NotMcap(path.to_owned())),
        }
    }

    /// Returns the next message; `None` at the end of the file, or where it was
    /// cut off.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub fn next_message(&mut self) -> Result<Option<AnyMessage>, ReadError> {
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
        let io = |cause| ReadError::Io { path: self.path.clone(), cause };
        loop {
            if self.finished || self.flaw.is_some() {
                return Ok(Step::End);
            }
            let step = match self.mcap.next_event() {
                None | Some(Err(mcap::McapError::UnexpectedEof)) => return Ok(Step::End),
                Some(Ok(LinearReadEvent::ReadRequest(least))) => {
                    let space = self.mcap.insert(least.max(BUFFER_LEN));
                    let read = self.file.read(space).map_err(io)?;
                    self.mcap.notify_read(read);
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    match mcap::parse_record(opcode, data) {
                        Ok(record) => step(&record, &mut self.channels),
                        Err(error) => Err(error.to_string()),
                    }
                }
                Some(Err(mcap::McapError::UnsupportedCompression(compression))) => {
                    let path = self.path.clone();
                    return Err(ReadError::Compressed { path, compression });
                }
                Some(Err(error)) => Err(error.to_string()),
            };
            match step {
                Ok(Step::End) => self.finished = true,
                Ok(step) => return Ok(step),
                Err(flaw) => self.flaw = Some(flaw),
            }
        }
    }
}

enum Step {
    Header(String),
    Message(Box<AnyMessage>),
    Other,
    End,
}

fn step(record: &Record<'_>, channels: &mut HashMap<u16, Channel>) -> Result<Step, String> {
    match record {
        Record::Header(header) => return Ok(Step::Header(header.profile.clone())),
        Record::Channel(found) => {
            let ours = Channel::ALL.iter().copied().find(|ours| found.topic == ours.topic());
            // Channels that other programs added are ignored.
            if let Some(ours) = ours.filter(|_| found.message_encoding == "protobuf") {
                channels.insert(found.id, ours);
            }
        }
        Record::Message { header, data } => {
            if let Some(channel) = channels.get(&header.channel_id) {
                let message = AnyMessage::decode(*channel, data)
                    .map_err(|error| format!("{}: {error}", channel.topic()))?;
                return Ok(Step::Message(Box::new(message)));
            }
        }
        Record::DataEnd(_) => return Ok(Step::End),
        _ => (),
    }
    Ok(Step::Other)
}
