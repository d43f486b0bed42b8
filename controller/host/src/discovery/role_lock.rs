//! The lock on a role in a domain: one process plays the leg, one the controller.
//!
//! Each role has a file in the domain's folder, locked by the process that holds the role.
//! The kernel releases the lock however its holder ends. The file contains the process id of
//! the holder, for messages only: in a container a process that is started again has the
//! same one.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::domain::{Domain, still_named};
use crate::link::Role;

/// The process that holds a role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Its process id, in its own container; `None` until it has been written.
    pub pid: Option<u32>,
}

fn path(root: &Path, role: Role) -> PathBuf {
    root.join(format!("{}.role", role.as_str()))
}

/// Returns the process that holds `role` in the domain with this folder. The caller need not
/// have joined it.
pub(crate) fn holder(root: &Path, role: Role) -> io::Result<Option<Holder>> {
    let path = path(root, role);
    match File::open(&path).map(|file| file.try_lock_shared()) {
        Ok(Err(TryLockError::WouldBlock)) => {
            let pid = fs::read_to_string(path).ok().and_then(|pid| pid.trim().parse().ok());
            Ok(Some(Holder { pid }))
        }
        Ok(Err(TryLockError::Error(cause))) => Err(cause),
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(cause),
        Ok(Ok(())) | Err(_) => Ok(None),
    }
}

/// A role held by this process; released when dropped.
#[derive(Debug)]
pub(crate) struct RoleLock {
    file: File,
    path: PathBuf,
}

impl RoleLock {
    /// Acquires `role` in `domain`; returns `None` if another process holds it.
    pub(crate) fn acquire(domain: &Domain, role: Role) -> io::Result<Option<Self>> {
        // A process that looks for the holder locks the file for an instant, so only a lock
        // that persists belongs to a holder.
        const ATTEMPTS: u32 = 10;
        let path = path(domain.root(), role);
        for _ in 0..ATTEMPTS {
            let mut file = File::options().create(true).truncate(false).write(true).open(&path)?;
            match file.try_lock() {
                Ok(()) if still_named(&file, &path) => {
                    file.set_len(0)?;
                    writeln!(file, "{}", std::process::id())?;
                    return Ok(Some(Self { file, path }));
                }
                Ok(()) => (),
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
                Err(TryLockError::Error(cause)) => return Err(cause),
            }
        }
        Ok(None)
    }
}

impl Drop for RoleLock {
    fn drop(&mut self) {
        if still_named(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_has_one_holder_whose_process_id_is_readable() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let held = || holder(domain.root(), Role::Leg).unwrap();
        assert_eq!(held(), None);

        let own = Holder { pid: Some(std::process::id()) };
        let acquire = |role| RoleLock::acquire(&domain, role).unwrap();
        let lock = acquire(Role::Leg).expect("nobody has it");
        assert_eq!(held(), Some(own));
        assert!(acquire(Role::Leg).is_none());
        assert!(acquire(Role::Controller).is_some());
        drop(lock);
        assert_eq!(held(), None);

        // A killed process leaves its file like this.
        fs::write(path(domain.root(), Role::Leg), "77\n").unwrap();
        assert_eq!(held(), None);
        let _lock = acquire(Role::Leg).expect("nobody has it");
        assert_eq!(held(), Some(own));
    }

    /// The folder may be removed under a run, and another process then acquire the role.
    #[test]
    fn releasing_a_role_keeps_the_file_of_another_holder() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        let lock = RoleLock::acquire(&domain, Role::Leg).unwrap();
        fs::remove_file(path(domain.root(), Role::Leg)).unwrap();
        let another = RoleLock::acquire(&domain, Role::Leg).unwrap();
        assert!(lock.is_some() && another.is_some());
        drop(lock);
        assert!(holder(domain.root(), Role::Leg).unwrap().is_some());
    }
}
