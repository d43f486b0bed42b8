//! The program that runs, to start it again as another process.

use std::io;
use std::path::PathBuf;

/// Returns a path that starts the running program, of the same build.
///
/// The file may have been removed or replaced by a new build since this process started;
/// the kernel still has the old one, at `/proc/self/exe` of this process and its children.
///
/// # Errors
/// Returns the error of the system, for example when `/proc` is not mounted.
pub fn current() -> io::Result<PathBuf> {
    let path = std::env::current_exe()?;
    Ok(if path.exists() { path } else { "/proc/self/exe".into() })
}
