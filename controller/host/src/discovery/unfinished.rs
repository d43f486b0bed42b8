//! Removes the objects that a process began to create and was killed before it had
//! finished.
//!
//! Whoever opens such an object waits for its creator, in iceoryx2 0.10.0 in one case
//! without limit. A process that is alone in a domain removes everything of its
//! predecessors when it joins. Where others live:
//!
//! - Services and ports are created under a lock. Whoever gets it knows that their
//!   creators are dead, and removes what is unfinished at once.
//! - Connections between ports are created without it, while the loops run. A thread
//!   removes those that have been unfinished for longer than creation can take.

use std::collections::HashMap;
use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::domain::{objects, paths_in};

/// Interval between two searches.
const INTERVAL: Duration = Duration::from_millis(250);
/// Age from which an unfinished object has no living creator: creation takes
/// microseconds, on a busy machine milliseconds.
const ABANDONED_AFTER: Duration = Duration::from_secs(1);

/// A thread that removes unfinished objects of a domain; it ends when dropped.
#[derive(Debug)]
pub(super) struct Sweeper {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Sweeper {
    /// Starts the thread for the domain in `folder`, whose shared memory has `prefix`.
    pub(super) fn start(folder: PathBuf, prefix: String) -> io::Result<Self> {
        let (end, ended) = mpsc::channel();
        let thread = std::thread::Builder::new().name("sweeper".into()).spawn(move || {
            let mut seen = FirstSeen::default();
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(INTERVAL) {
                remove(seen.abandoned(unfinished(&folder, &prefix), Instant::now()));
            }
        })?;
        Ok(Self { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for Sweeper {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Unfinished objects, and when each was seen first. (Their own times are those of the
/// wall clock, which may be set while a run goes on.)
#[derive(Debug, Default)]
struct FirstSeen(HashMap<PathBuf, Instant>);

impl FirstSeen {
    /// Returns the objects among `unfinished` that have been so for longer than creation
    /// takes.
    fn abandoned(
        &mut self,
        unfinished: impl Iterator<Item = PathBuf>,
        now: Instant,
    ) -> impl Iterator<Item = PathBuf> {
        let since = |path: &PathBuf| self.0.get(path).copied().unwrap_or(now);
        self.0 = unfinished.map(|path| (path.clone(), since(&path))).collect();
        let is_old = move |since: &Instant| now.duration_since(*since) >= ABANDONED_AFTER;
        self.0.iter().filter(move |(_, since)| is_old(since)).map(|(path, _)| path.clone())
    }
}

/// Removes the unfinished services and ports of a domain. The caller must hold the lock
/// under which they are created.
pub(super) fn remove_services_and_ports(folder: &Path, prefix: &str) {
    let is_connection =
        |path: &PathBuf| path.extension().is_some_and(|extension| extension == "connection");
    remove(unfinished(folder, prefix).filter(|path| !is_connection(path)));
}

fn remove(paths: impl Iterator<Item = PathBuf>) {
    for path in paths {
        let _ = fs::remove_file(path);
    }
}

/// Returns the paths of the unfinished objects of a domain.
fn unfinished(folder: &Path, prefix: &str) -> impl Iterator<Item = PathBuf> {
    // Shared memory is empty until it has its size. Files may be empty; like memory, they
    // become readable when they are finished.
    let memory = objects(prefix).filter(|path| is(path, |m| m.len() == 0 || !is_readable(m)));
    let folders: Vec<_> = paths_in(folder).filter(|path| path.is_dir()).collect();
    let files = folders.into_iter().flat_map(|folder| walk(&folder));
    memory.chain(files.filter(|path| is(path, |m| !is_readable(m))))
}

fn is(path: &Path, criterion: impl FnOnce(&Metadata) -> bool) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| criterion(&metadata))
}

fn is_readable(metadata: &Metadata) -> bool {
    const OWNER_READS: u32 = 0o400;
    metadata.permissions().mode() & OWNER_READS != 0
}

/// Returns the paths of the files in a folder and in the folders below.
fn walk(folder: &Path) -> Vec<PathBuf> {
    let (folders, mut files): (Vec<_>, Vec<_>) = paths_in(folder).partition(|path| path.is_dir());
    files.extend(folders.iter().flat_map(|folder| walk(folder)));
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discovery::Domain;

    #[test]
    fn what_a_killed_process_left_unfinished_is_removed_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let nodes = domain.root().join("nodes/1");
        fs::create_dir_all(&nodes).unwrap();
        let memory = |name: &str| Path::new("/dev/shm").join(format!("{}{name}", domain.prefix()));
        let write = |path: PathBuf, bytes: &str, mode: u32| {
            fs::write(&path, bytes).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let services_and_ports = [
            write(memory("empty.dynamic"), "", 0o600),
            write(memory("unreadable.data"), "x", 0o200),
            write(nodes.join("details"), "x", 0o200),
        ];
        let connection = write(memory("empty.connection"), "", 0o600);
        let finished = [
            write(memory("whole.data"), "x", 0o600),
            write(nodes.join("tag"), "", 0o400),
            write(domain.root().join("leg.role"), "", 0o600),
        ];
        let _lock = domain.lock_creation().unwrap();
        assert!(!services_and_ports.iter().any(|path| path.exists()), "their creator is dead");
        assert!(connection.exists(), "its creator may live");

        let (mut seen, start) = (FirstSeen::default(), Instant::now());
        let mut abandoned = |after: Duration| -> Vec<PathBuf> {
            seen.abandoned(unfinished(domain.root(), domain.prefix()), start + after).collect()
        };
        assert!(abandoned(Duration::ZERO).is_empty());
        assert!(abandoned(ABANDONED_AFTER / 2).is_empty());
        assert_eq!(abandoned(ABANDONED_AFTER), [connection]);
        assert!(finished.iter().all(|path| path.exists()), "{finished:?}");
    }
}
