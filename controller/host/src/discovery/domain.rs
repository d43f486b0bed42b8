//! Domains: the namespace in which one leg and one controller find each other.
//!
//! Several runs on one machine use different domains and never see each other.
//! A domain is a folder, `/dev/shm/spring-leg-<user id>/<name>/`, and every object
//! of shared memory whose name starts with its prefix. Three properties make it safe:
//!
//! - The folder lies beside the shared memory, so whoever sees one sees the other,
//!   whatever its environment, container or temporary folder.
//! - Each process holds a shared lock on the folder. The first to come and the last to
//!   leave know that they are alone, and remove what killed processes left. The kernel
//!   releases a lock however its holder ends.
//! - The prefix contains the folder's inode number, which no other folder can have while
//!   a process has this one open. So if the folder is removed under a run, nobody else
//!   can name the memory of that run: not to connect to it, and not to remove it.

use std::fs::{self, DirBuilder, File, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::room::{self, NoRoom};
use super::session::Session;
use super::unfinished::Sweeper;

/// The domain used when no name is given.
pub const DEFAULT_DOMAIN: &str = "default";
/// Longest name of a domain, in bytes.
pub const MAX_NAME: usize = 32;

/// The folder in which named shared memory appears as files.
pub(super) const SHARED_MEMORY: &str = "/dev/shm";
/// Name of the folder of a user's domains, without the user id that follows.
pub(super) const BASE_PREFIX: &str = "spring-leg-";

/// How long to wait while another process joins or leaves the same domain.
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
        "{} belongs to user {owner}, not to you (user {user}); have it removed",
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
    /// There is no room for shared memory.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
    /// Another process has been joining or leaving for longer than the limit.
    #[error(
        "another process that joins or leaves has locked {} for {waited:?}; is it stopped?",
        path.display()
    )]
    Busy {
        /// The folder or file that it has locked.
        path: PathBuf,
        /// How long this process has waited.
        waited: Duration,
    },
    /// The folder of the domain was removed while this process used it.
    #[error(
        "{} was removed while this process used it, by hand or by the system (systemd does so when a \
         user logs out, unless logind.conf has RemoveIPC=no); no other process can connect any more: \
         start both again",
        path.display()
    )]
    Removed {
        /// The folder.
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

pub(super) fn io_error<'a>(
    action: &'static str,
    path: &'a Path,
) -> impl FnOnce(io::Error) -> DomainError + 'a {
    move |cause| DomainError::Io { action, path: path.to_owned(), cause }
}

/// Membership of this process in a domain; ends when dropped.
#[derive(Debug)]
pub struct Domain {
    name: String,
    base: PathBuf,
    folder: Folder,
    // Stops when the domain is dropped.
    _sweeper: Sweeper,
}

/// The open folder of a domain. The lock on it is released when it is closed.
#[derive(Debug)]
struct Folder {
    path: PathBuf,
    file: File,
    prefix: String,
}

impl Folder {
    /// Opens the folder of a domain, if there is one.
    fn open(base: &Path, name: &str) -> Result<Option<Self>, DomainError> {
        let path = base.join(name);
        match File::open(&path).and_then(|file| Ok((file.metadata()?, file))) {
            Ok((metadata, file)) => {
                let prefix = format!("{}{:x}.", family(metadata.uid(), name), metadata.ino());
                Ok(Some(Self { path, file, prefix }))
            }
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(cause) => Err(io_error("open", &path)(cause)),
        }
    }

    /// Locks the folder with `lock`, which must not wait. Returns whether this process has
    /// the lock and the folder still its name.
    fn lock(
        &self,
        lock: impl FnOnce(&File) -> Result<(), TryLockError>,
    ) -> Result<bool, DomainError> {
        match lock(&self.file) {
            Ok(()) => Ok(self.has_its_name()),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(cause)) => Err(io_error("lock", &self.path)(cause)),
        }
    }

    fn has_its_name(&self) -> bool {
        still_named(&self.file, &self.path)
    }

    /// Removes everything that belongs to the domain. The caller must hold the lock
    /// exclusively.
    fn clear(&self) {
        // Best effort: the next process to join retries whatever could not be removed.
        if self.has_its_name() {
            for path in paths_in(&self.path) {
                let _ =
                    if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
            }
        }
        for path in objects(&self.prefix) {
            let _ = fs::remove_file(path);
        }
    }
}

/// Returns what the prefixes of all folders of a domain start with, past ones too.
fn family(user: u32, name: &str) -> String {
    format!("leg-{user}-{name}-")
}

/// Returns whether there is shared memory of a folder of this domain that was removed.
pub(super) fn has_orphans(base: &Path, name: &str) -> bool {
    let own = Folder::open(base, name).ok().flatten();
    let is_own = |object: &Path| {
        own.as_ref().is_some_and(|own| objects(&own.prefix).any(|path| path == object))
    };
    // The inode number ends at the dot; a domain whose name is longer has a `-` before it.
    let family = family(rustix::process::getuid().as_raw(), name);
    objects(&family).any(|path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let inode = file[family.len()..].split('.').next().unwrap_or_default();
        !inode.contains('-') && !is_own(&path)
    })
}

/// Returns the paths of the files and folders in a folder.
pub(super) fn paths_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

/// Returns the paths of the objects of shared memory whose names start with `prefix`.
pub(super) fn objects(prefix: &str) -> impl Iterator<Item = PathBuf> {
    paths_in(Path::new(SHARED_MEMORY)).filter(move |path| {
        let name = path.file_name().unwrap_or_default();
        name.as_encoded_bytes().starts_with(prefix.as_bytes())
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
    Path::new(SHARED_MEMORY).join(format!("{BASE_PREFIX}{user}"))
}

pub(super) fn check_name(name: &str) -> Result<(), DomainError> {
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
    /// Returns [`DomainError`] when the name is invalid, there is no room for shared
    /// memory, or the file system fails.
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
        Ok(base().join(name))
    }

    /// Returns the prefix of the shared memory of a domain, and its session if there is one,
    /// without joining it; `None` while it has no folder.
    ///
    /// # Errors
    /// Returns [`DomainError`] when the name is invalid or the folder cannot be opened.
    pub(crate) fn prefix_and_session(
        name: &str,
    ) -> Result<Option<(String, Option<Session>)>, DomainError> {
        check_name(name)?;
        Ok(Folder::open(&base(), name)?.map(|Folder { path, prefix, .. }| {
            let session = Session::in_folder(&path, &prefix);
            (prefix, session)
        }))
    }

    /// As [`Domain::join`], with the domains in the folder `base`.
    ///
    /// # Errors
    /// As [`Domain::join`].
    pub fn join_in(base: &Path, name: &str) -> Result<Arc<Self>, DomainError> {
        check_name(name)?;
        room::check(Path::new(SHARED_MEMORY))?;
        let path = base.join(name);
        let deadline = Instant::now() + CLEAN_UP_TIMEOUT;
        loop {
            make_private(base)?;
            make_private(&path)?;
            // The last process to leave removes the folder; then create it again.
            let folder = Folder::open(base, name)?;
            let is_there = folder.is_some();
            if let Some(folder) = folder {
                if folder.lock(File::try_lock)? {
                    folder.clear();
                }
                let _ = folder.file.unlock();
                if folder.lock(File::try_lock_shared)? {
                    remove_abandoned(base, name);
                    let (name, base) = (name.to_owned(), base.to_owned());
                    let sweeper = Sweeper::start(folder.prefix.clone())
                        .map_err(io_error("start a thread that watches", &path))?;
                    return Ok(Arc::new(Self { name, base, folder, _sweeper: sweeper }));
                }
            }
            if Instant::now() >= deadline && is_there {
                return Err(DomainError::Busy { path, waited: CLEAN_UP_TIMEOUT });
            } else if Instant::now() >= deadline {
                let cause = io::Error::new(
                    io::ErrorKind::NotFound,
                    "it is not there after it was created; is it, or the folder above, a link to nowhere?",
                );
                return Err(io_error("use", &path)(cause));
            }
            std::thread::sleep(RETRY);
        }
    }

    /// Returns the name of the domain.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the folder of the domain.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.folder.path
    }

    /// Returns the prefix of the names of its shared memory.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.folder.prefix
    }

    /// Checks that the folder of the domain is still there.
    ///
    /// # Errors
    /// Returns [`DomainError::Removed`] when it is not, or another has taken its place.
    pub fn check(&self) -> Result<(), DomainError> {
        if self.folder.has_its_name() {
            Ok(())
        } else {
            Err(DomainError::Removed { path: self.root().to_owned() })
        }
    }

    /// Checks that there is room for a session.
    ///
    /// # Errors
    /// Returns [`DomainError::NoRoom`] when there is not.
    pub fn check_room(&self) -> Result<(), DomainError> {
        Ok(room::check(Path::new(SHARED_MEMORY))?)
    }

    /// Reserves pages for all objects of shared memory that the domain has now.
    ///
    /// Shared memory gets its pages when it is first written to, and a process that finds
    /// none is killed by SIGBUS in the middle of its run; this makes it an error before.
    ///
    /// # Errors
    /// Returns [`DomainError::NoRoom`] when there are not enough.
    pub fn reserve(&self) -> Result<(), DomainError> {
        Ok(room::reserve(objects(self.prefix()))?)
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        // A lock is not upgraded in one step; whoever gets it in between cleans up as well.
        let _ = self.folder.file.unlock();
        if self.folder.file.try_lock().is_ok() {
            self.folder.clear();
            if self.folder.has_its_name() {
                let _ = fs::remove_dir(self.root());
            }
        }
        // This succeeds only when the folder holds no other domain.
        let _ = fs::remove_dir(&self.base);
    }
}

/// Creates a folder that only its owner may enter, or checks that this user owns it.
fn make_private(path: &Path) -> Result<(), DomainError> {
    match DirBuilder::new().mode(0o700).recursive(true).create(path) {
        Ok(()) => (),
        Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => (),
        // The last process to leave another domain has just removed the folder above; the
        // caller retries.
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(cause) => return Err(io_error("create the folder", path)(cause)),
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
fn remove_abandoned(base: &Path, own: &str) {
    for path in paths_in(base) {
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        if name == own || check_name(name).is_err() {
            continue;
        }
        if let Ok(Some(folder)) = Folder::open(base, name)
            && folder.lock(File::try_lock).is_ok_and(|locked| locked)
        {
            folder.clear();
            let _ = fs::remove_dir(path);
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
        assert_eq!(one.prefix(), two.prefix());
        let other = Domain::join_in(&base, "a_b").unwrap();
        assert_ne!(one.prefix(), other.prefix());
        fs::write(one.root().join("left"), "x").unwrap();
        drop(one);
        assert!(base.join("a/left").exists(), "one process is still in the domain");
        drop(two);
        assert!(!base.join("a").exists());
        assert!(base.join("a_b").exists());
        drop(other);
        assert!(!base.exists());
    }

    #[test]
    fn the_first_process_to_join_removes_what_killed_ones_left() {
        let dir = tempfile::tempdir().unwrap();
        // A killed process leaves files, memory, and a folder that no process has locked.
        let left = |name: &str| {
            fs::create_dir(dir.path().join(name)).unwrap();
            fs::write(dir.path().join(name).join("leg.role"), "x").unwrap();
            let prefix = Folder::open(dir.path(), name).unwrap().unwrap().prefix;
            let memory = Path::new(SHARED_MEMORY).join(format!("{prefix}data"));
            fs::write(&memory, "x").unwrap();
            memory
        };
        let (own, other) = (left("own"), left("other"));
        let domain = Domain::join_in(dir.path(), "own").unwrap();
        assert!(!own.exists() && !domain.root().join("leg.role").exists());
        assert!(!other.exists() && !dir.path().join("other").exists());
        assert!(domain.root().exists());
    }

    #[test]
    fn the_memory_of_a_removed_folder_is_out_of_the_reach_of_others() {
        let dir = tempfile::tempdir().unwrap();
        let living = Domain::join_in(dir.path(), "d").unwrap();
        let memory = Path::new(SHARED_MEMORY).join(format!("{}data", living.prefix()));
        fs::write(&memory, "x").unwrap();
        living.check().unwrap();
        fs::remove_dir_all(living.root()).unwrap();
        let message = living.check().unwrap_err().to_string();
        assert!(message.contains("/d was removed") && message.contains("RemoveIPC"), "{message}");

        let newcomer = Domain::join_in(dir.path(), "d").unwrap();
        assert_ne!(newcomer.prefix(), living.prefix());
        assert!(living.check().is_err(), "another folder has taken the place");
        assert!(has_orphans(dir.path(), "d"));
        drop(newcomer);
        assert!(memory.exists(), "the memory of the living is not swept");
        let newcomer = Domain::join_in(dir.path(), "d").unwrap();
        drop(living);
        assert!(!memory.exists(), "the last process to leave removes it");
        assert!(!has_orphans(dir.path(), "d"));
        newcomer.check().expect("the folder of the newcomer is not removed");
    }

    #[test]
    fn a_link_to_nowhere_is_named_and_no_other_process_blamed() {
        let dir = tempfile::tempdir().unwrap();
        let base = dir.path().join("base");
        std::os::unix::fs::symlink("/nowhere/at/all", &base).unwrap();
        let message = Domain::join_in(&base, "d").unwrap_err().to_string();
        assert!(message.contains("base/d") && message.contains("link to nowhere"), "{message}");
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
                    for _ in 0..300 {
                        let domain = Domain::join_in(base, ["a", "b"][i % 2]).unwrap();
                        domain.check().unwrap();
                    }
                });
            }
        });
        assert!(!base.exists());
    }
}
