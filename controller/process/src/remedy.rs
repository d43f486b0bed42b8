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

/// What helps where the system cannot start a thread or process.
pub const OF_THREAD: &str = "raise the limit of processes and threads (ulimit -u, a container's \
                             limit of pids) or of memory (ulimit -v)";
