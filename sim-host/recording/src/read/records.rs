//! Reads the records of an MCAP file chunk by chunk and verifies the checksum of each.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, McapResult};

use super::ReadError;
use super::chunk::Chunk;

/// Longest chunk or message accepted, bytes.
const MAX_RECORD_LEN: usize = 1 << 27;
/// Bytes read from the file at once, at least.
const BUFFER_LEN: usize = 1 << 18;

/// The records of a file.
pub(crate) struct Records {
    path: PathBuf,
    file: File,
    mcap: LinearReader,
    /// The decompressed chunk that is being read.
    chunk: Chunk,
    /// The end record of a complete file was read.
    finished: bool,
    flaw: Option<String>,
}

enum Step<T> {
    Header(String),
    Message(T),
    Other,
    End,
}

impl Records {
    /// Opens a file; returns the profile in its header, too.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not an MCAP file.
    pub(crate) fn open(path: &Path) -> Result<(Self, String), ReadError> {
        let io = |cause| ReadError::Io { path: path.to_owned(), cause };
        let file = File::open(path).map_err(io)?;
        let kind = file.metadata().map_err(io)?.file_type();
        if !kind.is_file() && !kind.is_dir() {
            return Err(ReadError::NotRegular(path.to_owned()));
        }
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(MAX_RECORD_LEN);
        let mut records = Self {
            path: path.to_owned(),
            file,
            mcap: LinearReader::new_with_options(options),
            chunk: Chunk::default(),
            finished: false,
            flaw: None,
        };
        match records.step(&mut |_| Ok(None::<()>))? {
            Step::Header(profile) => Ok((records, profile)),
            _ => Err(ReadError::NotMcap(path.to_owned())),
        }
    }

    /// Returns the next message that `take` finds in a record; `None` at the end of the file, or
    /// where it was cut off.
    ///
    /// # Errors
    /// [`ReadError`] if reading fails.
    pub(crate) fn next_message<T>(
        &mut self,
        mut take: impl FnMut(&Record<'_>) -> McapResult<Option<T>>,
    ) -> Result<Option<T>, ReadError> {
        loop {
            match self.step(&mut take)? {
                Step::Message(message) => return Ok(Some(message)),
                Step::Header(_) | Step::Other => (),
                Step::End => return Ok(None),
            }
        }
    }

    /// Returns a description of what was wrong with the file, for the user. It is complete only
    /// after the last message.
    pub(crate) fn warning(&self) -> Option<String> {
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

    fn step<T>(
        &mut self,
        take: &mut impl FnMut(&Record<'_>) -> McapResult<Option<T>>,
    ) -> Result<Step<T>, ReadError> {
        let mut taken = |record: &Record<'_>| match record {
            Record::Header(header) => Ok(Step::Header(header.profile.clone())),
            Record::DataEnd(_) => Ok(Step::End),
            record => Ok(take(record)?.map_or(Step::Other, Step::Message)),
        };
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
                        mcap::parse_record(opcode, data).and_then(|record| taken(&record))
                    }
                    Some(Err(error)) => Err(error),
                }
            } else {
                self.chunk.next_record().and_then(|record| taken(&record))
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
