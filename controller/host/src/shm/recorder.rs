//! Recorders that want every message of a session, from the first on: the controller waits for
//! them before it lets a leg begin.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::discovery::{Domain, DomainError};

/// Beginning of the names of their files; the process id follows.
const PREFIX: &str = "recorder-";

/// Longest wait for recorders before a session: less than the second after which a line that
/// the leg awaits is overdue.
const TIMEOUT: Duration = Duration::from_millis(900);
/// Time between two checks whether they are there.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A recorder that is announced in a domain, which it joins; dropped, it is no longer waited
/// for.
#[derive(Debug)]
pub struct Registration {
    domain: Arc<Domain>,
    path: PathBuf,
    _file: File,
}

impl Registration {
    /// Joins `domain` and announces this process there.
    ///
    /// # Errors
    /// [`DomainError`] if the domain cannot be joined, or the file not be written.
    pub fn of(domain: &str) -> Result<Self, DomainError> {
        let domain = Domain::join(domain)?;
        let path = domain.root().join(format!("{PREFIX}{}", std::process::id()));
        let file = lock(&path).map_err(|cause| DomainError::Io {
            action: "announce a recorder by",
            path: path.clone(),
            cause,
        })?;
        Ok(Self { domain, path, _file: file })
    }

    /// Returns the domain.
    pub(super) fn domain(&self) -> &Arc<Domain> {
        &self.domain
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

fn lock(path: &Path) -> io::Result<File> {
    let mut file = File::options().create(true).truncate(true).write(true).open(path)?;
    file.try_lock()?;
    writeln!(file, "{}", std::process::id())?;
    Ok(file)
}

/// Waits until the recorders that are announced in the domain with this folder are `present` in
/// a new session, so that they miss no message; not long for one that is stopped.
pub(super) fn wait_for_recorders(root: &Path, present: impl Fn() -> usize) {
    let since = Instant::now();
    while present() < registered(root) && since.elapsed() < TIMEOUT {
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns the number of recorders that are announced in the domain with this folder, and live.
fn registered(root: &Path) -> usize {
    let Ok(entries) = fs::read_dir(root) else { return 0 };
    let is_recorder = |entry: &fs::DirEntry| {
        entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX))
            && File::open(entry.path())
                .is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
    };
    entries.flatten().filter(is_recorder).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_recorders_while_they_live() {
        let name = format!("recorders-{}", std::process::id());
        let first = Registration::of(&name).unwrap();
        let root = first.domain().root().to_owned();
        assert_eq!(registered(&root), 1);
        // What a killed one has left.
        fs::write(root.join("recorder-1"), "1").unwrap();
        assert_eq!(registered(&root), 1);
        drop(first);
        assert_eq!(registered(&root), 0);
    }
}
