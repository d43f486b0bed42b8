//! A domain: the corner of the machine in which one leg and one controller meet.
//!
//! Several runs on one machine use different domains and never see each other.
//! A domain owns a folder, `<temporary folder>/spring-leg-<user id>/<name>/`,
//! and every shared-memory object whose name starts with its prefix. Each
//! process in it holds a shared lock; the last to leave removes all of it, and
//! whoever comes first removes what killed processes left. The kernel releases
//! the lock of a process however it ends, so nothing here depends on manners.

use std::fs::{self, DirBuilder, File, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The domain used when none is named.
pub const DEFAULT_DOMAIN: &str = "default";
/// What the folder of a user's domains is called, before the user's number.
const FOLDER: &str = "spring-leg-";
/// Longest name of a domain, bytes.
pub const MAX_NAME: usize = 32;

/// Where named shared memory shows as files.
#[cfg(target_os = "linux")]
const SHARED_MEMORY: &str = "/dev/shm";

/// How long to wait for another process's clean-up of the same domain.
const PATIENCE: Duration = Duration::from_secs(2);
const RETRY: Duration = Duration::from_millis(2);

/// Why a domain could not be joined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DomainError {
    /// The name cannot be part of a file name.
    #[error(
        "domain `{0}` is not a name: use 1 to {MAX_NAME} of the characters a-z, A-Z, 0-9, `-`, `_`"
    )]
    Name(String),
    /// The folder belongs to somebody else.
    #[error(
        "{} belongs to user {owner}, not to you (user {user}); set TMPDIR to a folder of your own",
        path.display()
    )]
    Foreign {
        /// The folder of all domains.
        path: PathBuf,
        /// Its owner.
        owner: u32,
        /// The user of this process.
        user: u32,
    },
    /// Another process has been cleaning up for too long.
    #[error("another process has been cleaning up {} for {PATIENCE:?}; end it, or use another --domain", path.display())]
    Busy {
        /// The lock that it holds.
        path: PathBuf,
    },
    /// The file system refused.
    #[error("cannot {action} {}: {cause}", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// To which file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
}

fn io_error<'a>(
    action: &'static str,
    path: &'a Path,
) -> impl FnOnce(io::Error) -> DomainError + 'a {
    move |cause| DomainError::Io { action, path: path.to_owned(), cause }
}

/// Membership of a domain; ends when dropped.
#[derive(Debug)]
pub struct Domain {
    name: String,
    place: Place,
    lock: File,
}

/// The names that belong to a domain.
#[derive(Debug)]
struct Place {
    base: PathBuf,
    lock: PathBuf,
    root: PathBuf,
    prefix: String,
}

impl Place {
    fn new(base: &Path, name: &str) -> Self {
        let root = base.join(name);
        Self {
            base: base.to_owned(),
            lock: base.join(format!("{name}.lock")),
            // Shared-memory names are global to the machine: tell apart users,
            // temporary folders and domains by a hash of the folder's path.
            prefix: format!("leg-{:016x}.", fnv1a(root.as_os_str().as_encoded_bytes())),
            root,
        }
    }

    /// Opens and creates the lock file.
    fn open_lock(&self) -> Result<File, DomainError> {
        File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&self.lock)
            .map_err(io_error("open", &self.lock))
    }

    /// Removes everything of the domain. The caller holds its lock exclusively.
    fn sweep(&self) {
        // Best effort: what cannot be removed now is tried again by the next to come.
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

/// FNV-1a, 64 bits: names, not secrets.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Whether `path` still names `file`: it may have been removed, or made anew,
/// between opening and locking.
pub(super) fn still_named(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::metadata(path)) {
        (Ok(held), Ok(named)) => held.ino() == named.ino() && held.dev() == named.dev(),
        _ => false,
    }
}

/// The folder of all domains of this user.
fn base() -> PathBuf {
    let user = rustix::process::getuid().as_raw();
    std::env::temp_dir().join(format!("{FOLDER}{user}"))
}

/// Other users who have domains in the same temporary folder, or had. Their
/// processes and ours never meet.
#[must_use]
pub fn other_users() -> Vec<u32> {
    let own = rustix::process::getuid().as_raw();
    let mut users: Vec<u32> = fs::read_dir(std::env::temp_dir())
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.strip_prefix(FOLDER)?.parse().ok())
        .filter(|user| *user != own)
        .collect();
    users.sort_unstable();
    users
}

/// A word on [`other_users`] for a message on who is missing; empty without any.
pub(super) fn apart_from(users: &[u32]) -> String {
    if users.is_empty() {
        return String::new();
    }
    let names: Vec<_> = users.iter().map(ToString::to_string).collect();
    format!(
        " (user {} has domains here too; processes of two users do not meet, run both as one)",
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
    /// Joins the domain `name` of this user, making it if need be.
    ///
    /// # Errors
    /// [`DomainError`] when the name is unfit or the file system refuses.
    pub fn join(name: &str) -> Result<Arc<Self>, DomainError> {
        Self::join_in(&base(), name)
    }

    /// The folder of the domain `name` of this user, joined by anybody or not.
    ///
    /// # Errors
    /// [`DomainError::Name`].
    pub fn folder(name: &str) -> Result<PathBuf, DomainError> {
        check_name(name)?;
        Ok(Place::new(&base(), name).root)
    }

    /// As [`Domain::join`], in a folder of the caller's choice.
    ///
    /// # Errors
    /// As [`Domain::join`].
    pub fn join_in(base: &Path, name: &str) -> Result<Arc<Self>, DomainError> {
        check_name(name)?;
        let place = Place::new(base, name);
        let deadline = Instant::now() + PATIENCE;
        loop {
            make_private(base)?;
            let attempt = place.open_lock();
            // The last to leave removes the folder too: then make it again.
            let gone = matches!(&attempt, Err(DomainError::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound);
            if let Some(lock) = if gone { None } else { Some(attempt?) } {
                match lock.try_lock_shared() {
                    Ok(()) if still_named(&lock, &place.lock) => {
                        make_private(&place.root)?;
                        sweep_others(&place);
                        return Ok(Arc::new(Self { name: name.to_owned(), place, lock }));
                    }
                    Ok(()) | Err(TryLockError::WouldBlock) => (),
                    Err(TryLockError::Error(cause)) => {
                        return Err(io_error("lock", &place.lock)(cause));
                    }
                }
            }
            if Instant::now() >= deadline {
                return Err(DomainError::Busy { path: place.lock });
            }
            std::thread::sleep(RETRY);
        }
    }

    /// What the names of all shared memory of a domain start with, joined or not.
    #[must_use]
    pub fn prefix_in(base: &Path, name: &str) -> String {
        Place::new(base, name).prefix
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.place.root
    }

    /// What the names of all its shared memory start with.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.place.prefix
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        if self.lock.try_lock().is_ok() {
            self.place.sweep();
        }
        // Only when no other domain is in it.
        let _ = fs::remove_dir(&self.place.base);
    }
}

/// Makes a folder that only its owner may enter, or checks that it is ours.
fn make_private(path: &Path) -> Result<(), DomainError> {
    match DirBuilder::new().mode(0o700).recursive(true).create(path) {
        Err(cause) if cause.kind() != io::ErrorKind::AlreadyExists => {
            return Err(io_error("make the folder", path)(cause));
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
        // Removed by the last to leave another domain, just now; the caller tries again.
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(cause) => Err(io_error("look at", path)(cause)),
    }
}

/// Removes the other domains in which nobody is left alive.
fn sweep_others(own: &Place) {
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
            Place::new(&own.base, name).sweep();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_to_leave_takes_everything_along() {
        let dir = tempfile::tempdir().unwrap();
        let base = dir.path().join("base");
        let one = Domain::join_in(&base, "a").unwrap();
        let two = Domain::join_in(&base, "a").unwrap();
        let other = Domain::join_in(&base, "a_b").unwrap();
        assert_ne!(one.prefix(), other.prefix());
        fs::write(one.root().join("left"), "x").unwrap();
        drop(one);
        assert!(base.join("a/left").exists(), "somebody is still there");
        drop(two);
        assert!(!base.join("a").exists() && !base.join("a.lock").exists());
        assert!(base.join("a_b").exists());
        drop(other);
        assert!(!base.exists());
    }

    #[test]
    fn what_the_dead_left_is_removed_by_the_next_to_come() {
        let dir = tempfile::tempdir().unwrap();
        // As a killed process leaves it: files, and a lock that nobody holds.
        fs::create_dir(dir.path().join("dead")).unwrap();
        fs::write(dir.path().join("dead/card"), "x").unwrap();
        fs::write(dir.path().join("dead.lock"), "").unwrap();
        let domain = Domain::join_in(dir.path(), "alive").unwrap();
        assert!(!dir.path().join("dead").exists() && !dir.path().join("dead.lock").exists());
        assert!(domain.root().exists());
    }

    #[test]
    fn names_that_are_no_file_names_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["", "a/b", "..", "a.b", "ä", &"x".repeat(MAX_NAME + 1)] {
            let refused = Domain::join_in(dir.path(), name);
            assert!(matches!(refused, Err(DomainError::Name(_))), "{name}");
        }
    }

    #[test]
    fn many_may_come_and_go_at_once() {
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
