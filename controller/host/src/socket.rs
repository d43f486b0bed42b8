//! Unix sockets: the file of a listening one, which is removed at its end, and connecting.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType};

/// Connects to the unix socket at `path`, without waiting: a process that is stopped takes no
/// callers from its queue, and a blocking connect to a full queue has no limit.
///
/// # Errors
/// Returns the error of the system; [`io::ErrorKind::WouldBlock`] when the queue is full.
pub fn connect(path: &Path) -> io::Result<UnixStream> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket.into())
}

/// Why there is no socket at a path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SocketError {
    /// Another process listens there.
    #[error("another process listens on {}; end it, or choose another path", .0.display())]
    InUse(PathBuf),
    /// The path names something else.
    #[error("{} is there and is no socket; remove it, or choose another path", .0.display())]
    NoSocket(PathBuf),
    /// The system refuses.
    #[error("cannot listen on {}: {cause}", path.display())]
    Io {
        /// The path.
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
                match connect(path) {
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
    fn connecting_to_a_process_that_takes_no_callers_fails_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("socket");
        let _listener = UnixListener::bind(&path).unwrap();
        let mut callers = Vec::new();
        let error = loop {
            match connect(&path) {
                Ok(caller) => callers.push(caller),
                Err(error) => break error,
            }
        };
        assert!(!callers.is_empty());
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
    }

    #[test]
    fn replaces_the_socket_of_a_dead_process_and_not_that_of_a_live_one() {
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
