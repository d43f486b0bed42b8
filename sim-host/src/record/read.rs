//! Reading a recording back, also one that was cut off.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;

use super::schema::{
    Apex, Channel, Command, Config, End, Event, Loop, PROFILE, Policy, Sample, State,
};

/// No chunk and no message is longer.
const LONGEST: usize = 1 << 27;
/// Read from the file at once, at least.
const BUFFER: usize = 1 << 18;

/// Why a file is no recording to read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// It cannot be read.
    #[error("cannot read the recording {}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// It is no MCAP file.
    #[error("{} is not an MCAP file", .0.display())]
    NotMcap(PathBuf),
    /// It is an MCAP file of something else.
    #[error(
        "{} is an MCAP file, but not of this leg: its profile is `{profile}`, not `{PROFILE}`; `sim-host run --record FILE` makes one",
        path.display()
    )]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// What it says it is.
        profile: String,
    },
    /// It is compressed, which is not read here.
    #[error("{} is compressed ({how}); `mcap decompress` makes a file that can be read here", path.display())]
    Compressed {
        /// The file.
        path: PathBuf,
        /// How.
        how: String,
    },
    /// It has not what every recording begins with.
    #[error("{}: no {what} in it; the recording was cut off before it began", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
    },
}

/// A message of a recording.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "each is the message of its name")]
pub enum Entry {
    Sample(Sample),
    Command(Command),
    State(State),
    Apex(Apex),
    Event(Event),
    Policy(Policy),
    Config(Config),
    Loop(Loop),
    End(End),
}

impl Entry {
    fn parse(channel: Channel, message: &[u8]) -> Result<Self, prost::DecodeError> {
        Ok(match channel {
            Channel::Sample => Self::Sample(Sample::decode(message)?),
            Channel::Command => Self::Command(Command::decode(message)?),
            Channel::State => Self::State(State::decode(message)?),
            Channel::Apex => Self::Apex(Apex::decode(message)?),
            Channel::Event => Self::Event(Event::decode(message)?),
            Channel::Policy => Self::Policy(Policy::decode(message)?),
            Channel::Config => Self::Config(Config::decode(message)?),
            Channel::Loop => Self::Loop(Loop::decode(message)?),
            Channel::End => Self::End(End::decode(message)?),
        })
    }
}

/// Reads a recording from its beginning, chunk by chunk, each only when its
/// checksum is right.
pub struct Reader {
    path: PathBuf,
    file: File,
    mcap: LinearReader,
    channels: HashMap<u16, Channel>,
    /// Whether the end that a finished file has was seen.
    finished: bool,
    flaw: Option<String>,
}

impl Reader {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ReadError`] when it is none.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file =
            File::open(path).map_err(|cause| ReadError::Io { path: path.to_owned(), cause })?;
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST);
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

    /// The next message; `None` at the end, be it the file's own or where it
    /// was cut off.
    ///
    /// # Errors
    /// [`ReadError`] when the file cannot be read on.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, ReadError> {
        loop {
            match self.step()? {
                Step::Entry(entry) => return Ok(Some(*entry)),
                Step::Header(_) | Step::Other => (),
                Step::End => return Ok(None),
            }
        }
    }

    /// After the end: what was wrong with the file, in words for the user.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let what = match &self.flaw {
            Some(flaw) => format!("it is damaged ({flaw})"),
            None if self.finished => return None,
            None => "it is cut off".to_owned(),
        };
        Some(format!(
            "{}: {what}; read up to the last whole chunk before that",
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
                    let space = self.mcap.insert(least.max(BUFFER));
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
                Some(Err(mcap::McapError::UnsupportedCompression(how))) => {
                    return Err(ReadError::Compressed { path: self.path.clone(), how });
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
    Entry(Box<Entry>),
    Other,
    End,
}

fn step(record: &Record<'_>, channels: &mut HashMap<u16, Channel>) -> Result<Step, String> {
    match record {
        Record::Header(header) => return Ok(Step::Header(header.profile.clone())),
        Record::Channel(found) => {
            let ours = Channel::ALL.into_iter().find(|ours| found.topic == ours.topic());
            // What somebody else has added is none of ours.
            if let Some(ours) = ours.filter(|_| found.message_encoding == "protobuf") {
                channels.insert(found.id, ours);
            }
        }
        Record::Message { header, data } => {
            if let Some(channel) = channels.get(&header.channel_id) {
                let entry = Entry::parse(*channel, data)
                    .map_err(|error| format!("{}: {error}", channel.topic()))?;
                return Ok(Step::Entry(Box::new(entry)));
            }
        }
        Record::DataEnd(_) => return Ok(Step::End),
        _ => (),
    }
    Ok(Step::Other)
}
