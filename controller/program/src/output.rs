//! Files that are there whole, or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

/// A file under a temporary name beside its own, until it is finished: a reader
/// sees the old file or the whole new one. Dropped before, it leaves no trace.
#[derive(Debug)]
pub struct Pending {
    file: BufWriter<File>,
    temporary: TempPath,
    path: PathBuf,
}

impl Pending {
    /// Begins a file. A link is followed to what it leads to.
    ///
    /// # Errors
    /// When the folder cannot be written to: the system's reason, which does not
    /// name the temporary file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Made the usual way, so as readable as any file. (Errors of the methods of a
        // `NamedTempFile` name the temporary file, which means nothing to a user.)
        let made = tempfile::Builder::new().make_in(folder, |path| File::create_new(path))?;
        let (file, temporary) = made.into_parts();
        Ok(Self { file: BufWriter::new(file), temporary, path })
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// When it cannot be written; an old file is then as it was.
    pub fn finish(self) -> io::Result<()> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        self.temporary.persist(&self.path).map_err(|error| error.error)?;
        Ok(())
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Puts a file in place in one go. A device or a pipe is written to as it is.
///
/// # Errors
/// As [`Pending`].
pub fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    if path.exists() && !path.is_file() && !path.is_dir() {
        return fs::write(path, content);
    }
    let mut file = Pending::create(path)?;
    file.write_all(content)?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_there_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        replace(&path, b"old").unwrap();
        let mut pending = Pending::create(&path).unwrap();
        pending.write_all(b"half of the new").unwrap();
        drop(pending);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        replace(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
        assert!(replace(folder.path(), b"a folder is no file").is_err());
        let error = replace(&folder.path().join("no/such/folder"), b"").unwrap_err();
        assert_eq!(error.to_string(), "No such file or directory (os error 2)");
    }
}
