//! Room for shared memory and open files: checked before a domain is joined, and memory
//! reserved after it was created.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{FallocateFlags, StatVfsMountFlags, fallocate, statvfs};
use rustix::io::Errno;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Bytes that a domain needs: the messages of a session, for which a recorder has not come yet
/// (4.4 MB), and other shared memory and files of two processes, of a recorder and of a live
/// view, each at least one page of 4 KiB, with as much again for those of killed processes.
const NEEDED_BYTES: u64 = 6 * 1024 * 1024;
/// Files that a domain needs.
const NEEDED_FILES: u64 = 128;

/// Files that a process has open at most: two dozen for shared memory, locks, signals and the
/// recording, and one for each client of its socket.
const NEEDED_OPEN_FILES: u64 = 64;

/// There is no room for the shared memory of a domain.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NoRoom {
    /// Too few bytes are free.
    #[error(
        "{} KiB are free in {} for shared memory, {} are needed: free some, or make it larger \
         (`mount -o remount,size=64M {}`, in a container --shm-size)",
        free / 1024,
        path.display(),
        needed / 1024,
        path.display()
    )]
    Bytes {
        /// The folder of shared memory.
        path: PathBuf,
        /// Free bytes.
        free: u64,
        /// Needed bytes.
        needed: u64,
    },
    /// Too few files can be created.
    #[error(
        "{} has room for {free} more files, {needed} are needed for shared memory: remove some, or \
         allow more (`mount -o remount,nr_inodes=0 {}`)",
        path.display(),
        path.display()
    )]
    Files {
        /// The folder of shared memory.
        path: PathBuf,
        /// Files that can be created.
        free: u64,
        /// Files needed.
        needed: u64,
    },
    /// This process may not open enough files.
    #[error(
        "{allowed} open files are allowed, {needed} are needed: raise the limit (`ulimit -n {needed}`)"
    )]
    OpenFiles {
        /// Files that the process may have open.
        allowed: u64,
        /// Files that it needs.
        needed: u64,
    },
    /// Nothing can be created.
    #[error("{} is read-only, so there can be no shared memory; mount it writable", .0.display())]
    ReadOnly(PathBuf),
    /// The folder cannot be examined, or memory not be reserved.
    #[error("no shared memory: {}: {cause}", path.display())]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// Error of the system.
        cause: io::Error,
    },
}

/// Checks that this process may open enough files; raises its limit to that number if the
/// system permits.
fn check_open_files() -> Result<(), NoRoom> {
    let limit = getrlimit(Resource::Nofile);
    let Some(allowed) = limit.current.filter(|allowed| *allowed < NEEDED_OPEN_FILES) else {
        return Ok(());
    };
    let raised = Rlimit { current: Some(NEEDED_OPEN_FILES), maximum: limit.maximum };
    setrlimit(Resource::Nofile, raised)
        .map_err(|_| NoRoom::OpenFiles { allowed, needed: NEEDED_OPEN_FILES })
}

/// Checks that this process may open enough files, and that the file system of `folder` has
/// room for a domain.
pub(super) fn check(folder: &Path) -> Result<(), NoRoom> {
    check_open_files()?;
    let path = || folder.to_owned();
    let found =
        statvfs(folder).map_err(|cause| NoRoom::Io { path: path(), cause: cause.into() })?;
    if found.f_flag.contains(StatVfsMountFlags::RDONLY) {
        return Err(NoRoom::ReadOnly(path()));
    }
    // A limit of zero blocks or files is none.
    let free = found.f_bavail.saturating_mul(found.f_frsize);
    if found.f_blocks > 0 && free < NEEDED_BYTES {
        return Err(NoRoom::Bytes { path: path(), free, needed: NEEDED_BYTES });
    }
    if found.f_files > 0 && found.f_favail < NEEDED_FILES {
        let free = found.f_favail;
        return Err(NoRoom::Files { path: path(), free, needed: NEEDED_FILES });
    }
    Ok(())
}

/// Reserves all pages of the files at `paths`. One that is gone needs none.
pub(super) fn reserve(paths: impl Iterator<Item = PathBuf>) -> Result<(), NoRoom> {
    for path in paths {
        let reserved = File::options().write(true).open(&path).and_then(|file| {
            let len = file.metadata()?.len();
            if len > 0 {
                fallocate(&file, FallocateFlags::KEEP_SIZE, 0, len)?;
            }
            Ok(())
        });
        match reserved {
            Ok(()) => (),
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => (),
            // A file system without this call has other limits.
            Err(cause) if Errno::from_io_error(&cause) == Some(Errno::OPNOTSUPP) => (),
            Err(cause) => return Err(NoRoom::Io { path, cause }),
        }
    }
    Ok(())
}
