//! The log: a CSV row for every episode, under a name of its own until the
//! training is over.

use super::error::RunError;
use super::with_suffix;
use crate::train::EpisodeRecord;
use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use serde::{Deserialize, Serialize};
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// How far the log was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogPosition {
    /// Bytes.
    pub length: u64,
    /// CRC-32 of these.
    pub crc32: u32,
}

/// The log under way, locked against a second training.
pub struct Log {
    rows: csv::Writer<Counted>,
    path: PathBuf,
    part: PathBuf,
}

/// A file, and what is in it so far.
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

/// The log until it is whole.
fn part(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}

impl Log {
    /// An empty log.
    ///
    /// # Errors
    /// When it cannot be written, or another training is writing it.
    pub fn begin(path: &Path) -> Result<Self, RunError> {
        let unwritten = || RunError::unwritten(path, "--log");
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

    /// The log of a checkpoint, cut to where that was.
    ///
    /// # Errors
    /// When it is not there or not the same, or another training is writing it.
    pub fn resume(path: &Path, mark: LogPosition) -> Result<Self, RunError> {
        let part = part(path);
        // Killed after the log got its name, before the checkpoint was gone.
        let from = if part.exists() || !path.exists() { part.clone() } else { path.to_owned() };
        let wrong = |what: String| RunError::Log { path: from.clone(), what };
        let open = File::options().read(true).write(true).open(&from);
        let mut file = open.map_err(|e| wrong(format!("the log cannot be opened ({e})")))?;
        lock(&file, &from)?;
        let mut digest = CRC.digest();
        let mut bytes = Vec::new();
        let read = (&file).take(mark.length).read_to_end(&mut bytes);
        read.map_err(|e| wrong(format!("the log cannot be read ({e})")))?;
        if (bytes.len() as u64) < mark.length {
            let what = "the log has only";
            return Err(wrong(format!("{what} {} bytes of {}", bytes.len(), mark.length)));
        }
        digest.update(&bytes);
        let crc32 = digest.clone().finalize();
        if crc32 != mark.crc32 {
            let what = "this is another log: its checksum is";
            return Err(wrong(format!("{what} {crc32:08x}, expected {:08x}", mark.crc32)));
        }
        let unwritten = || RunError::unwritten(path, "--log");
        if from != part {
            fs::rename(&from, &part).map_err(unwritten())?;
        }
        file.set_len(mark.length)
            .and_then(|()| file.seek(SeekFrom::Start(mark.length)))
            .map_err(unwritten())?;
        Ok(Self::new(path, part, file, mark.length, digest))
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

    /// The name that it will have.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// One more row.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&mut self, record: &EpisodeRecord) -> Result<(), RunError> {
        let unwritten = RunError::unwritten(&self.part, "--log");
        self.rows.serialize(record).map_err(|e| unwritten(e.into()))
    }

    /// How far it is, with all of it in the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn mark(&mut self) -> Result<LogPosition, RunError> {
        let unwritten = RunError::unwritten(&self.part, "--log");
        let flushed = self.rows.flush();
        let counted = self.rows.get_ref();
        flushed.and_then(|()| counted.file.sync_data()).map_err(unwritten)?;
        Ok(LogPosition { length: counted.length, crc32: counted.digest.clone().finalize() })
    }

    /// Gives it its name: the training is over.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(&mut self) -> Result<(), RunError> {
        self.mark()?;
        // A link is followed to what it leads to.
        let path = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        fs::rename(&self.part, path).map_err(RunError::unwritten(&self.path, "--log"))
    }
}

fn lock(file: &File, path: &Path) -> Result<(), RunError> {
    match file.try_lock() {
        // Where files cannot be locked, they are not.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(path.into())),
    }
}
