//! Removes the shared memory that an observer began to create and was killed before it had
//! finished.
//!
//! Whoever opens such an object waits for its creator, in iceoryx2 0.10.0 in one case
//! without limit. Leg and controller create and open theirs in turns, and a session whose
//! other end is lost is not opened any more; but observers come and go while the loops run.
//! A thread removes what has been unfinished for longer than creation can take.

use std::collections::HashMap;
use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::domain::objects;

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
    /// Starts the thread for shared memory whose names start with `prefix`.
    pub(super) fn start(prefix: String) -> io::Result<Self> {
        let (end, ended) = mpsc::channel();
        let thread = std::thread::Builder::new().name("sweeper".into()).spawn(move || {
            let mut seen = FirstSeen::default();
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(INTERVAL) {
                for path in seen.abandoned(unfinished(&prefix), Instant::now()) {
                    let _ = fs::remove_file(path);
                }
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

/// Returns the paths of the unfinished objects whose names start with `prefix`: empty until
/// they have their size, then unreadable until they have their contents.
fn unfinished(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let is_unfinished = |found: Metadata| found.len() == 0 || !is_readable(&found);
    objects(prefix).filter(move |path| fs::symlink_metadata(path).is_ok_and(is_unfinished))
}

fn is_readable(metadata: &Metadata) -> bool {
    const OWNER_READS: u32 = 0o400;
    metadata.permissions().mode() & OWNER_READS != 0
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::discovery::Domain;

    #[test]
    fn what_a_killed_process_left_unfinished_is_removed_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let write = |name: &str, bytes: &str, mode: u32| {
            let path = Path::new("/dev/shm").join(format!("{}{name}", domain.prefix()));
            fs::write(&path, bytes).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let mut left = [write("a.dynamic", "", 0o600), write("b.connection", "x", 0o200)];
        let finished = write("whole.data", "x", 0o600);
        let (mut seen, start) = (FirstSeen::default(), Instant::now());
        let mut abandoned = |after: Duration| -> Vec<PathBuf> {
            let mut paths: Vec<_> =
                seen.abandoned(unfinished(domain.prefix()), start + after).collect();
            paths.sort_unstable();
            paths
        };
        left.sort_unstable();
        assert!(abandoned(Duration::ZERO).is_empty(), "their creator may live");
        assert!(abandoned(ABANDONED_AFTER / 2).is_empty());
        assert_eq!(abandoned(ABANDONED_AFTER), left);

        let deadline = Instant::now() + Duration::from_secs(20);
        while left.iter().any(|path| path.exists()) {
            assert!(Instant::now() < deadline, "the thread removes them");
            std::thread::sleep(INTERVAL);
        }
        assert!(finished.exists());
    }
}
