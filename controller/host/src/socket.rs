//! The file of a listening unix socket: made, kept apart from others', removed.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Why there is no socket at a path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SocketError {
    /// Somebody listens there.
    #[error("another process listens on {}; end it, or choose another path", .0.display())]
    InUse(PathBuf),
    /// Something else is there.
    #[error("{} is there and is no socket; remove it, or choose another path", .0.display())]
    NoSocket(PathBuf),
    /// The system refused.
    #[error("cannot listen on {}: {cause}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
}

/// A socket's file; removed when dropped, unless another has taken its place.
#[derive(Debug)]
pub struct SocketFile {
    path: PathBuf,
    /// Device and inode number.
    id: (u64, u64),
}

impl SocketFile {
    /// Listens at `path`, in place of a socket that a dead process left there.
    ///
    /// # Errors
    /// [`SocketError`].
    pub fn bind(path: &Path) -> Result<(Self, UnixListener), SocketError> {
        let failed = |cause| SocketError::Io { path: path.to_owned(), cause };
        let bound = match UnixListener::bind(path) {
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let is_socket = fs::symlink_metadata(path).is_ok_and(|m| m.file_type().is_socket());
                if !is_socket {
                    return Err(SocketError::NoSocket(path.to_owned()));
                }
                match UnixStream::connect(path) {
                    Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => (),
                    _ => return Err(SocketError::InUse(path.to_owned())),
                }
                fs::remove_file(path).map_err(failed)?;
                UnixListener::bind(path)
            }
            bound => bound,
        };
        let listener = bound.map_err(failed)?;
        let id = id(path).map_err(failed)?;
        Ok((Self { path: path.to_owned(), id }, listener))
    }
}

fn id(path: &Path) -> io::Result<(u64, u64)> {
    let metadata = fs::symlink_metadata(path)?;
    Ok((metadata.dev(), metadata.ino()))
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if id(&self.path).is_ok_and(|id| id == self.id) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dead_ones_socket_is_replaced_and_a_live_ones_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("socket");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists(), "as a killed process leaves it");
        let (file, _listener) = SocketFile::bind(&path).unwrap();
        assert!(matches!(SocketFile::bind(&path), Err(SocketError::InUse(_))));
        fs::remove_file(&path).unwrap();
        let (another, _listener) = SocketFile::bind(&path).unwrap();
        drop(file);
        assert!(path.exists(), "another process's socket is not removed");
        drop(another);
        assert!(!path.exists());
        fs::write(&path, "precious").unwrap();
        assert!(matches!(SocketFile::bind(&path), Err(SocketError::NoSocket(_))));
        assert_eq!(fs::read(&path).unwrap(), b"precious");
        let nowhere = SocketFile::bind(&dir.path().join("no/where")).unwrap_err().to_string();
        assert!(nowhere.contains("no/where: No such file"), "{nowhere}");
    }
}
