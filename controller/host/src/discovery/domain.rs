//! Domains: the namespace in which one leg and one controller find each other.
//!
//! Several runs on one machine use different domains and never see each other.
//! A domain owns a folder, `<temporary folder>/spring-leg-<user id>/<name>/`,
//! and every shared-memory object whose name starts with its prefix. Each
//! process in it holds a shared lock. The last process to leave removes all of
//! it, and the first to join removes what killed processes left. The kernel
//! releases a process's lock however the process ends, so this clean-up works
//! even after SIGKILL.

use std::fs::{self, DirBuilder, File, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The domain used when no name is given.
pub const DEFAULT_DOMAIN: &str = "default";
/// Name of the folder of a user's domains, without the user id that follows.
const FOLDER_PREFIX: &str = "spring-leg-";
/// Longest name of a domain, in bytes.
pub const MAX_NAME: usize = 32;

/// The folder in which named shared memory appears as files.
#[cfg(target_os = "linux")]
const SHARED_MEMORY: &str = "/dev/shm";

/// How long to wait while another process cleans up the same domain.
const CLEAN_UP_TIMEOUT: Duration = Duration::from_secs(2);
const RETRY: Duration = Duration::from_millis(2);

/// A domain could not be joined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DomainError {
    /// The name is not valid as part of a file name.
    #[error(
        "`{0}` is not a valid domain name: use 1 to {MAX_NAME} of the characters a-z, A-Z, 0-9, `-`, `_`"
    )]
    Name(String),
    /// The folder of all domains belongs to another user.
    #[error(
        "{} belongs to user {owner}, not to you (user {user}); set TMPDIR to a folder of your own",
        path.display()
    )]
    Foreign {
        /// The folder of all domains.
        path: PathBuf,
        /// User id of its owner.
        owner: u32,
        /// User id of this process.
        user: u32,
    },
    /// Another process has been cleaning up for longer than the limit.
    #[error("another process has been cleaning up {} for {CLEAN_UP_TIMEOUT:?}", path.display())]
    Busy {
        /// The lock file that it holds.
        path: PathBuf,
    },
    /// The file system failed.
    #[error("cannot {action} {}: {cause}", path.display())]
    Io {
        /// The action that failed.
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// Error of the system.
        cause: io::Error,
    },
}

fn io_error<'a>(
    action: &'static str,
    path: &'a Path,
) -> impl FnOnce(io::Error) -> DomainError + 'a {
    move |cause| DomainError::Io { action, path: path.to_owned(), cause }
}

/// Membership of this process in a domain; ends when dropped.
#[derive(Debug)]
pub struct Domain {
    name: String,
    paths: DomainPaths,
    lock: File,
}

/// The paths and the prefix that belong to a domain.
#[derive(Debug)]
struct DomainPaths {
    base: PathBuf,
    lock: PathBuf,
    root: PathBuf,
    prefix: String,
}

impl DomainPaths {
    fn new(base: &Path, name: &str) -> Self {
        let root = base.join(name);
        Self {
            base: base.to_owned(),
            lock: base.join(format!("{name}.lock")),
            // Shared-memory names are global to the machine: a hash of the folder's path
            // distinguishes users, temporary folders and domains.
            prefix: format!("leg-{:016x}.", fnv1a(root.as_os_str().as_encoded_bytes())),
            root,
        }
    }

    /// Opens the lock file and creates it if necessary.
    fn open_lock(&self) -> Result<File, DomainError> {
        File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&self.lock)
            .map_err(io_error("open", &self.lock))
    }

    /// Removes everything that belongs to the domain. The caller must hold its lock
    /// exclusively.
    fn remove_all(&self) {
        // Best effort: the next process to join retries whatever could not be removed.
        let _ = fs::remove_dir_all(&self.root);
        #[cfg(target_os = "linux")]
        for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
            if entry.file_name().as_encoded_bytes().starts_with(self.prefix.as_bytes()) {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(&self.lock);
    }
}

/// Computes the 64-bit FNV-1a hash. It makes names, so it need not be cryptographic.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Returns whether `path` still names `file`. Another process may have removed or
/// recreated it between opening and locking.
pub(super) fn still_named(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::metadata(path)) {
        (Ok(held), Ok(named)) => held.ino() == named.ino() && held.dev() == named.dev(),
        _ => false,
    }
}

/// Returns the folder of all domains of this user.
fn base() -> PathBuf {
    let user = rustix::process::getuid().as_raw();
    std::env::temp_dir().join(format!("{FOLDER_PREFIX}{user}"))
}

/// Returns the ids of other users who have, or had, domains in the same temporary
/// folder. Processes of different users cannot connect.
#[must_use]
pub fn other_users() -> Vec<u32> {
    let own = rustix::process::getuid().as_raw();
    let mut users: Vec<u32> = fs::read_dir(std::env::temp_dir())
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.strip_prefix(FOLDER_PREFIX)?.parse().ok())
        .filter(|user| *user != own)
        .collect();
    users.sort_unstable();
    users
}

/// Formats a note on [`other_users`] for the message about a missing peer; empty if
/// there are none.
#[must_use]
pub fn other_users_note(users: &[u32]) -> String {
    if users.is_empty() {
        return String::new();
    }
    let names: Vec<_> = users.iter().map(ToString::to_string).collect();
    format!(
        " (user {} has domains here too; processes of two users cannot connect, run both as one user)",
        names.join(", ")
    )
}

fn check_name(name: &str) -> Result<(), DomainError> {
    let fit = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if name.is_empty() || name.len() > MAX_NAME || !name.bytes().all(fit) {
        return Err(DomainError::Name(name.to_owned()));
    }
    Ok(())
}

impl Domain {
    /// Joins the domain `name` of this user and creates it if necessary.
    ///
    /// # Errors
    /// Returns [`DomainError`] when the name is invalid or the file system fails.
    pub fn join(name: &str) -> Result<Arc<Self>, DomainError> {
        Self::join_in(&base(), name)
    }

    /// Returns the folder of the domain `name` of this user, whether or not any
    /// process has joined it.
    ///
    /// # Errors
    /// Returns [`DomainError::Name`] when the name is invalid.
    pub fn folder(name: &str) -> Result<PathBuf, DomainError> {
        check_name(name)?;
        Ok(DomainPaths::new(&base(), name).root)
    }

    /// As [`Domain::join`], with the domains in the folder `base`.
    ///
    /// # Errors
    /// As [`Domain::join`].
    pub fn join_in(base: &Path, name: &str) -> Result<Arc<Self>, DomainError> {
        check_name(name)?;
        let paths = DomainPaths::new(base, name);
        let deadline = Instant::now() + CLEAN_UP_TIMEOUT;
        loop {
            make_private(base)?;
            let attempt = paths.open_lock();
            // The last process to leave removes the folder too; then create it again.
            let gone = matches!(&attempt, Err(DomainError::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound);
            if let Some(lock) = if gone { None } else { Some(attempt?) } {
                match lock.try_lock_shared() {
                    Ok(()) if still_named(&lock, &paths.lock) => {
                        make_private(&paths.root)?;
                        remove_abandoned(&paths);
                        return Ok(Arc::new(Self { name: name.to_owned(), paths, lock }));
                    }
                    Ok(()) | Err(TryLockError::WouldBlock) => (),
                    Err(TryLockError::Error(cause)) => {
                        return Err(io_error("lock", &paths.lock)(cause));
                    }
                }
            }
            if Instant::now() >= deadline {
                return Err(DomainError::Busy { path: paths.lock });
            }
            std::thread::sleep(RETRY);
        }
    }

    /// Returns the prefix of the names of all shared memory of a domain, whether or not
    /// any process has joined it.
    #[must_use]
    pub fn prefix_in(base: &Path, name: &str) -> String {
        DomainPaths::new(base, name).prefix
    }

    /// Returns the name of the domain.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the folder of the domain.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.paths.root
    }

    /// Returns the prefix of the names of its shared memory.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.paths.prefix
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        if self.lock.try_lock().is_ok() {
            self.paths.remove_all();
        }
        // This succeeds only when the folder holds no other domain.
        let _ = fs::remove_dir(&self.paths.base);
    }
}

/// Creates a folder that only its owner may enter, or checks that this user owns it.
fn make_private(path: &Path) -> Result<(), DomainError> {
    match DirBuilder::new().mode(0o700).recursive(true).create(path) {
        Err(cause) if cause.kind() != io::ErrorKind::AlreadyExists => {
            return Err(io_error("create the folder", path)(cause));
        }
        _ => (),
    }
    match fs::symlink_metadata(path) {
        Ok(found) => {
            let user = rustix::process::getuid().as_raw();
            if found.uid() == user {
                Ok(())
            } else {
                Err(DomainError::Foreign { path: path.to_owned(), owner: found.uid(), user })
            }
        }
        // The last process to leave another domain has just removed it; the caller retries.
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(cause) => Err(io_error("inspect", path)(cause)),
    }
}

/// Removes the other domains that no live process has joined.
fn remove_abandoned(own: &DomainPaths) {
    for entry in fs::read_dir(&own.base).into_iter().flatten().flatten() {
        let path = entry.path();
        let Some(name) = path.file_stem().and_then(|stem| stem.to_str()) else {
            continue;
        };
        if path.extension().is_none_or(|extension| extension != "lock") || path == own.lock {
            continue;
        }
        if let Ok(lock) = File::options().read(true).write(true).open(&path)
            && lock.try_lock().is_ok()
            && still_named(&lock, &path)
        {
            DomainPaths::new(&own.base, name).remove_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_process_to_leave_removes_the_domain() {
        let dir = tempfile::tempdir().unwrap();
        let base = dir.path().join("base");
        let one = Domain::join_in(&base, "a").unwrap();
        let two = Domain::join_in(&base, "a").unwrap();
        let other = Domain::join_in(&base, "a_b").unwrap();
        assert_ne!(one.prefix(), other.prefix());
        fs::write(one.root().join("left"), "x").unwrap();
        drop(one);
        assert!(base.join("a/left").exists(), "one process is still in the domain");
        drop(two);
        assert!(!base.join("a").exists() && !base.join("a.lock").exists());
        assert!(base.join("a_b").exists());
        drop(other);
        assert!(!base.exists());
    }

    #[test]
    fn a_join_removes_the_domains_of_killed_processes() {
        let dir = tempfile::tempdir().unwrap();
        // A killed process leaves files and a lock that no process holds.
        fs::create_dir(dir.path().join("dead")).unwrap();
        fs::write(dir.path().join("dead/leg.card"), "x").unwrap();
        fs::write(dir.path().join("dead.lock"), "").unwrap();
        let domain = Domain::join_in(dir.path(), "alive").unwrap();
        assert!(!dir.path().join("dead").exists() && !dir.path().join("dead.lock").exists());
        assert!(domain.root().exists());
    }

    #[test]
    fn rejects_names_that_are_not_file_names() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["", "a/b", "..", "a.b", "ä", &"x".repeat(MAX_NAME + 1)] {
            let result = Domain::join_in(dir.path(), name);
            assert!(matches!(result, Err(DomainError::Name(_))), "{name}");
        }
    }

    #[test]
    fn processes_may_join_and_leave_concurrently() {
        let dir = tempfile::tempdir().unwrap();
        let base = dir.path().join("base");
        std::thread::scope(|scope| {
            for i in 0..4 {
                let base = &base;
                scope.spawn(move || {
                    for _ in 0..100 {
                        let domain = Domain::join_in(base, ["a", "b"][i % 2]).unwrap();
                        assert!(domain.root().exists());
                    }
                });
            }
        });
        assert!(!base.exists());
    }
}
