//! The log: a CSV file with a row for every episode, under a temporary name until the training
//! is complete.

use super::error::{Purpose, RunError};
use super::with_suffix;
use crate::train::EpisodeRecord;
use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use serde::{Deserialize, Serialize};
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// The length of a log and the checksum of its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogPosition {
    /// Length, bytes.
    pub length: u64,
    /// CRC-32 of these bytes.
    pub crc32: u32,
}

/// An open log, locked against a second training.
pub struct Log {
    rows: csv::Writer<Counted>,
    path: PathBuf,
    part: PathBuf,
}

/// A file with its length and checksum so far.
struct Counted {
    file: File,
    length: u64,
    digest: Digest<'static, u32, Table<16>>,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.length += written as u64;
        self.digest.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Returns the temporary name of a log.
fn part(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}

impl Log {
    /// Creates an empty log.
    ///
    /// # Errors
    /// [`RunError`] when it cannot be written, or another training holds its lock.
    pub fn begin(path: &Path) -> Result<Self, RunError> {
        let unwritten = || RunError::unwritten(path, Purpose::Log);
        if path.is_dir() {
            return Err(unwritten()(io::ErrorKind::IsADirectory.into()));
        }
        let part = part(path);
        let open = File::options().write(true).create(true).truncate(false).open(&part);
        let mut file = open.map_err(unwritten())?;
        lock(&file, &part)?;
        file.set_len(0).and_then(|()| file.rewind()).map_err(unwritten())?;
        Ok(Self::new(path, part, file, 0, CRC.digest()))
    }

    /// Opens the log of a checkpoint and cuts it to the checkpoint's length.
    ///
    /// # Errors
    /// [`RunError`] when it does not exist or has other content, or another training holds its
    /// lock.
    pub fn resume(path: &Path, position: LogPosition) -> Result<Self, RunError> {
        let part = part(path);
        // The process may have been killed after the rename and before the checkpoint was
        // removed.
        let from = if part.exists() || !path.exists() { part.clone() } else { path.to_owned() };
        let wrong = |what: String| RunError::Log { path: from.clone(), what };
        let open = File::options().read(true).write(true).open(&from);
        let mut file = open.map_err(|e| wrong(format!("the log cannot be opened ({e})")))?;
        lock(&file, &from)?;
        let mut digest = CRC.digest();
        let mut bytes = Vec::new();
        let read = (&file).take(position.length).read_to_end(&mut bytes);
        read.map_err(|e| wrong(format!("the log cannot be read ({e})")))?;
        if (bytes.len() as u64) < position.length {
            let what = "the log has only";
            return Err(wrong(format!("{what} {} bytes of {}", bytes.len(), position.length)));
        }
        digest.update(&bytes);
        let crc32 = digest.clone().finalize();
        if crc32 != position.crc32 {
            let what = "this is another log: its checksum is";
            return Err(wrong(format!("{what} {crc32:08x}, expected {:08x}", position.crc32)));
        }
        let unwritten = || RunError::unwritten(path, Purpose::Log);
        if from != part {
            fs::rename(&from, &part).map_err(unwritten())?;
        }
        file.set_len(position.length)
            .and_then(|()| file.seek(SeekFrom::Start(position.length)))
            .map_err(unwritten())?;
        Ok(Self::new(path, part, file, position.length, digest))
    }

    fn new(
        path: &Path,
        part: PathBuf,
        file: File,
        length: u64,
        digest: Digest<'static, u32, Table<16>>,
    ) -> Self {
        let rows = csv::WriterBuilder::new().has_headers(length == 0).from_writer(Counted {
            file,
            length,
            digest,
        });
        Self { rows, path: path.into(), part }
    }

    /// Returns the final name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a row.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn write(&mut self, record: &EpisodeRecord) -> Result<(), RunError> {
        let unwritten = RunError::unwritten(&self.part, Purpose::Log);
        self.rows.serialize(record).map_err(|e| unwritten(e.into()))
    }

    /// Flushes the file and returns its length and checksum.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written.
    pub fn position(&mut self) -> Result<LogPosition, RunError> {
        let unwritten = RunError::unwritten(&self.part, Purpose::Log);
        let flushed = self.rows.flush();
        let counted = self.rows.get_ref();
        flushed.and_then(|()| counted.file.sync_data()).map_err(unwritten)?;
        Ok(LogPosition { length: counted.length, crc32: counted.digest.clone().finalize() })
    }

    /// Renames the log of a completed training to its final name.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written or renamed.
    pub fn finish(&mut self) -> Result<(), RunError> {
        self.position()?;
        // A symbolic link keeps pointing to the log.
        let path = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        fs::rename(&self.part, path).map_err(RunError::unwritten(&self.path, Purpose::Log))
    }
}

fn lock(file: &File, path: &Path) -> Result<(), RunError> {
    match file.try_lock() {
        // Some file systems have no locks; the log is then not protected.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(path.into())),
    }
}
