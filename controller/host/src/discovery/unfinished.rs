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

use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

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
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(INTERVAL) {
                remove(unfinished(&folder, &prefix).filter(|path| is_old(path)));
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

fn is_old(path: &Path) -> bool {
    is(path, |metadata| {
        let age = metadata.modified().ok().and_then(|time| time.elapsed().ok());
        age.is_some_and(|age| age >= ABANDONED_AFTER)
    })
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
    use std::fs::File;
    use std::time::SystemTime;

    #[test]
    fn what_a_killed_process_left_unfinished_is_removed_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let nodes = domain.root().join("nodes/1");
        fs::create_dir_all(&nodes).unwrap();
        let memory = |name: &str| Path::new("/dev/shm").join(format!("{}{name}", domain.prefix()));
        let write = |path: PathBuf, bytes: &str, mode: u32, age_s: u64| {
            fs::write(&path, bytes).unwrap();
            let time = SystemTime::now() - Duration::from_secs(age_s);
            File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let old = [
            write(memory("empty.dynamic"), "", 0o600, 10),
            write(memory("unreadable.data"), "x", 0o200, 10),
            write(nodes.join("details"), "x", 0o200, 10),
            write(memory("old.connection"), "", 0o600, 10),
        ];
        let new =
            [write(memory("new.dynamic"), "", 0o600, 0), write(nodes.join("new"), "x", 0o200, 0)];
        let kept = [
            write(memory("whole.data"), "x", 0o600, 10),
            write(memory("new.connection"), "", 0o200, 0),
            write(nodes.join("tag"), "", 0o400, 10),
            write(domain.root().join("leg.role"), "", 0o600, 10),
        ];
        let there = |path: &PathBuf| path.exists();
        remove(unfinished(domain.root(), domain.prefix()).filter(|path| is_old(path)));
        assert!(!old.iter().any(there) && new.iter().all(there) && kept.iter().all(there));
        let lock = domain.lock_creation().unwrap();
        assert!(!new.iter().any(there), "their creator does not hold the lock, so it is dead");
        assert!(kept.iter().all(there), "{kept:?}");
        drop(lock);
    }
}
