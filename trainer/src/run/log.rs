//! The log: a CSV file with a row for every episode, under a temporary name until the training
//! is complete.

use super::error::{Purpose, RunError};
use super::paths::with_suffix;
use crate::train::EpisodeRecord;
use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use leg_process::atomic_file;
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
    /// Creates an empty log. Where there are rows of an interrupted training, `discard`
    /// decides whether they may be lost.
    ///
    /// # Errors
    /// [`RunError`] when it cannot be written, another training holds its lock, and the error
    /// of `discard`.
    pub fn begin(
        path: &Path,
        discard: impl FnOnce(&Path) -> Result<(), RunError>,
    ) -> Result<Self, RunError> {
        let unwritten = || RunError::unwritten(path, Purpose::Log);
        // Before the training: the final name must be writable, too.
        atomic_file::check(path).map_err(unwritten())?;
        let part = part(path);
        let open = File::options().write(true).create(true).truncate(false).open(&part);
        let mut file = open.map_err(unwritten())?;
        lock(&file, &part)?;
        if file.metadata().map_err(unwritten())?.len() > 0 {
            discard(&part)?;
        }
        file.set_len(0).and_then(|()| file.rewind()).map_err(unwritten())?;
        Ok(Self::new(path, part, file, 0, CRC.digest()))
    }

    /// Opens the log of a checkpoint, which is at the first of `paths`, at least one, that
    /// holds the checkpoint's rows, and cuts it to the checkpoint's length.
    ///
    /// # Errors
    /// [`RunError`] when it is at none of them, or another training holds its lock.
    pub fn resume(paths: &[PathBuf], position: LogPosition) -> Result<Self, RunError> {
        // The process may have been killed after the rename and before the checkpoint was
        // removed: then the rows are under the final name.
        let parts = paths.iter().map(|path| (part(path), path));
        let finals = paths.iter().map(|path| (path.clone(), path));
        let finals = finals.filter(|_| position.length > 0);
        let mut mismatch = None;
        for (from, path) in parts.chain(finals) {
            match rows(&from, position) {
                Ok(Some((file, digest))) => {
                    return Self::reopen(path, &from, file, position.length, digest);
                }
                Ok(None) => {}
                Err(what) => _ = mismatch.get_or_insert(RunError::Log { path: from, what }),
            }
        }
        let at: Vec<String> = paths.iter().map(|path| part(path).display().to_string()).collect();
        match mismatch {
            // There are no rows to lose yet.
            None if position.length == 0 => Self::begin(&paths[0], |_| Ok(())),
            None => {
                let more = if at.len() > 1 {
                    format!(", nor {}", at[1..].join(", nor "))
                } else {
                    String::new()
                };
                let what = format!("the log cannot be opened: there is no such file{more}");
                Err(RunError::Log { path: part(&paths[0]), what })
            }
            Some(mismatch) => Err(mismatch),
        }
    }

    /// Continues a log of `length` bytes in `file`, which has the name `from`.
    fn reopen(
        path: &Path,
        from: &Path,
        mut file: File,
        length: u64,
        digest: Digest<'static, u32, Table<16>>,
    ) -> Result<Self, RunError> {
        let unwritten = || RunError::unwritten(path, Purpose::Log);
        lock(&file, from)?;
        atomic_file::check(path).map_err(unwritten())?;
        let part = part(path);
        if from != part {
            fs::rename(from, &part).map_err(unwritten())?;
        }
        file.set_len(length)
            .and_then(|()| file.seek(SeekFrom::Start(length)))
            .map_err(unwritten())?;
        Ok(Self::new(path, part, file, length, digest))
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

    /// Gives the log of a completed training its final name.
    ///
    /// # Errors
    /// [`RunError`] when the file cannot be written or renamed.
    pub fn finish(&mut self) -> Result<(), RunError> {
        self.position()?;
        // A symbolic link keeps pointing to the log.
        let path = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        let renamed = fs::rename(&self.part, &path).or_else(|_| {
            // A file that cannot be replaced, such as a bind mount.
            atomic_file::write(&path, &fs::read(&self.part)?)?;
            fs::remove_file(&self.part)
        });
        renamed.map_err(RunError::unwritten(&self.path, Purpose::Log))
    }
}

/// Returns whether the interrupted log of the final name `path` begins with the rows of
/// `position`; `None` when there is none.
pub(super) fn holds(path: &Path, position: LogPosition) -> Option<bool> {
    match rows(&part(path), position) {
        Ok(Some(_)) => Some(true),
        Ok(None) => None,
        Err(_) => Some(false),
    }
}

/// A file that begins with the rows of a position, and the checksum up to there.
type Rows = (File, Digest<'static, u32, Table<16>>);

/// Opens a file that begins with the rows of `position`; `None` when there is no such file.
///
/// # Errors
/// States how it differs.
fn rows(from: &Path, position: LogPosition) -> Result<Option<Rows>, String> {
    let file = match File::options().read(true).write(true).open(from) {
        Ok(file) => file,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("the log cannot be opened ({e})")),
    };
    let mut bytes = Vec::new();
    let read = (&file).take(position.length).read_to_end(&mut bytes);
    read.map_err(|e| format!("the log cannot be read ({e})"))?;
    if (bytes.len() as u64) < position.length {
        return Err(format!("the log has only {} bytes of {}", bytes.len(), position.length));
    }
    let mut digest = CRC.digest();
    digest.update(&bytes);
    let (crc32, expected) = (digest.clone().finalize(), position.crc32);
    if crc32 != expected {
        return Err(format!(
            "this is another log: its checksum is {crc32:08x}, expected {expected:08x}"
        ));
    }
    Ok(Some((file, digest)))
}

fn lock(file: &File, path: &Path) -> Result<(), RunError> {
    match file.try_lock() {
        // Some file systems have no locks; the log is then not protected.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(path.into())),
    }
}
