//! Output files that appear complete or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

/// Numbers the temporary files of this process.
static NEXT: AtomicU32 = AtomicU32::new(0);

/// A file that is written under a temporary name in the target's folder and
/// renamed by [`AtomicFile::finish`].
///
/// A reader sees either the old file or the complete new one. Dropping the value
/// before `finish` removes the temporary file.
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<File>,
    temporary: Temporary,
    path: PathBuf,
}

/// The path of a temporary file, which is removed on drop.
#[derive(Debug)]
struct Temporary(PathBuf);

impl Temporary {
    /// Creates a file under a name that nothing else in the folder has. It is as readable as
    /// any new file.
    fn create_in(folder: &Path) -> io::Result<(File, Self)> {
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let path = folder.join(format!(".tmp{}-{number}", process::id()));
            match File::create_new(&path) {
                Ok(file) => return Ok((file, Self(path))),
                // A process of the same id on another host, or one that was killed.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After the rename there is nothing to remove.
        _ = fs::remove_file(&self.0);
    }
}

impl AtomicFile {
    /// Creates the temporary file. If `path` is a symbolic link, its target will be
    /// replaced.
    ///
    /// # Errors
    /// Returns the system's error when `path` is a folder or its folder is not
    /// writable. The message does not name the temporary file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let (file, temporary) = Temporary::create_in(folder)?;
        Ok(Self { file: BufWriter::new(file), temporary, path })
    }

    /// Flushes the file to disk and renames it to its final path.
    ///
    /// # Errors
    /// Returns the system's error; an existing file is then unchanged.
    pub fn finish(self) -> io::Result<()> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        fs::rename(&self.temporary.0, &self.path)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes `content` to `path` by an [`AtomicFile`]. A device or a pipe is written
/// to directly.
///
/// # Errors
/// Returns the system's error; an existing file is then unchanged.
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    if path.exists() && !path.is_file() && !path.is_dir() {
        return fs::write(path, content);
    }
    let mut file = AtomicFile::create(path)?;
    file.write_all(content)?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unfinished_file_leaves_the_old_one_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        write(&path, b"old").unwrap();
        let mut unfinished = AtomicFile::create(&path).unwrap();
        unfinished.write_all(b"half of the new").unwrap();
        drop(unfinished);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
        assert!(write(folder.path(), b"a folder is no file").is_err());
        let error = write(&folder.path().join("no/such/folder"), b"").unwrap_err();
        assert_eq!(error.to_string(), "No such file or directory (os error 2)");
    }
}
