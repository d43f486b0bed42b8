//! What helps against an error of the system, for messages.

use std::io::{self, ErrorKind};

/// Returns what helps against an error that has the same cause wherever a file is written:
/// a limit of file sizes, a quota. `None` for others.
#[must_use]
pub fn of_write(error: &io::Error) -> Option<&'static str> {
    match error.kind() {
        ErrorKind::FileTooLarge => Some("raise the limit of file sizes (ulimit -f)"),
        ErrorKind::QuotaExceeded => Some("free space within the quota"),
        _ => None,
    }
}

/// Returns whether an error means that a path cannot be that of a file, whoever writes it: its
/// folder is missing, something on the way or in the place of a folder is none, it is a folder, or
/// the name is too long.
/// Then the caller has named a wrong path; other errors, such as a full disk or a missing
/// permission, are failures of the system.
#[must_use]
pub fn is_wrong_path(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::NotFound
            | ErrorKind::NotADirectory
            | ErrorKind::AlreadyExists
            | ErrorKind::IsADirectory
            | ErrorKind::InvalidFilename
            | ErrorKind::InvalidInput
    )
}

/// What helps where the system cannot start a thread or process.
pub const OF_THREAD: &str = "raise the limit of processes and threads (ulimit -u, a container's \
                             limit of pids) or of memory (ulimit -v)";
