//! Completes a recording whose recorder was killed.

use std::collections::HashMap;
use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use leg_process::atomic_file::AtomicFile;
use leg_recording::other;
use mcap::records::{MessageHeader, Record};
use prost::Message;

use super::contents::Contents;
use super::file::{PROTOBUF, RecordingFile};
use super::read::ReadError;
use super::schema::{Channel, DESCRIPTORS, End};

/// Why a file cannot be completed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecoverError {
    /// The file has nothing to recover, or cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file is complete.
    #[error("{} is complete: it has its index, and every program can read it as it is", .0.display())]
    IsComplete(PathBuf),
    /// A recorder is writing the file.
    #[error("a recorder is still writing {}; end its run first", .0.display())]
    InUse(PathBuf),
    /// There is a file of the output's name.
    #[error("{} exists already, and is not overwritten", .0.display())]
    OutputExists(PathBuf),
    /// The output cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The output.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
}

/// What was recovered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Ticks in the recording.
    pub ticks: u64,
    /// How the file ends, for the user.
    pub warning: String,
}

/// Writes a complete recording of all messages that the file at `part` has whole to `output`, in
/// order of time within each chunk. Where the run's end is missing, it gets one as
/// [`End::recovered`] describes it. The file at `part` stays as it is.
///
/// # Errors
/// [`RecoverError`]; then there is no file at `output`.
pub fn recover(part: &Path, output: &Path) -> Result<Recovered, RecoverError> {
    if output.symlink_metadata().is_ok() {
        return Err(RecoverError::OutputExists(output.to_owned()));
    }
    let contents = Contents::of(part)?;
    // Until the end: the next recorder of this name would empty the file.
    let _lock = lock(part)?;
    contents.config()?;
    contents.first()?;
    let Some(warning) = contents.warning() else {
        return Err(RecoverError::IsComplete(part.to_owned()));
    };
    let write = |cause| RecoverError::Write { path: output.to_owned(), cause };
    let file = AtomicFile::create(output).and_then(RecordingFile::begin).map_err(write)?;
    let mut copy = Copy::to(file);
    other::for_each_record(part, |record| copy.add(record).map_err(write))?;
    if !contents.has_end() {
        copy.add_end(contents.ticks).map_err(write)?;
    }
    copy.file.finish().and_then(|(_, file)| file.finish()).map_err(write)?;
    Ok(Recovered { ticks: contents.ticks, warning })
}

/// Locks a file that no recorder is writing.
fn lock(part: &Path) -> Result<File, RecoverError> {
    let failed = |cause| RecoverError::Read(ReadError::Io { path: part.to_owned(), cause });
    let file = File::open(part).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(RecoverError::InUse(part.to_owned())),
        Err(TryLockError::Error(cause)) => Err(failed(cause)),
    }
}

/// A recording that receives the records of another file.
struct Copy<W: Write> {
    file: RecordingFile<W>,
    /// Numbers of schemas and channels: those of the other file, and those here.
    schemas: HashMap<u16, u16>,
    channels: HashMap<u16, u16>,
    last_ns: u64,
}

impl<W: Write> Copy<W> {
    fn to(file: RecordingFile<W>) -> Self {
        // No schema has the number 0, there as here.
        Self { file, schemas: HashMap::from([(0, 0)]), channels: HashMap::new(), last_ns: 0 }
    }

    fn add(&mut self, record: &Record<'_>) -> io::Result<()> {
        match record {
            Record::Schema { header, data } => {
                let id = self.file.add_schema(&header.name, &header.encoding, data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                if let Some(schema) = self.schemas.get(&channel.schema_id) {
                    let encoding = &channel.message_encoding;
                    let id = self.file.add_channel(*schema, &channel.topic, encoding)?;
                    self.channels.insert(channel.id, id);
                }
            }
            Record::Message { header, data } => {
                if let Some(&channel_id) = self.channels.get(&header.channel_id) {
                    self.last_ns = self.last_ns.max(header.log_time);
                    self.file.add(MessageHeader { channel_id, ..*header }, data)?;
                }
            }
            _ => (),
        }
        Ok(())
    }

    fn add_end(&mut self, ticks: u64) -> io::Result<()> {
        let schema = self.file.add_schema(&Channel::End.schema(), PROTOBUF, DESCRIPTORS)?;
        let channel_id = self.file.add_channel(schema, Channel::End.topic(), PROTOBUF)?;
        let (log_time, publish_time) = (self.last_ns, self.last_ns);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        self.file.add(header, &End::recovered(ticks).encode_to_vec())
    }
}
