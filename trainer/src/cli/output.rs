//! Output files, which appear complete or not at all, and the standard output.

use super::{Failure, failed};
use anyhow::anyhow;
use leg_process::atomic_file::{self, AtomicFile};
use std::path::Path;

/// A file to write, and the option that names it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target<'a> {
    pub(crate) path: &'a Path,
    pub(crate) option: &'static str,
}

impl Target<'_> {
    /// Makes the failure of a file that cannot be written.
    pub(crate) fn unwritten(&self, error: &std::io::Error) -> Failure {
        let (path, option) = (self.path.display(), self.option);
        failed(anyhow!("{path}: cannot be written: {error}; name another place with {option}"))
    }

    /// Creates the file; it gets its name when it is finished.
    pub(crate) fn begin(&self) -> Result<AtomicFile, Failure> {
        AtomicFile::create(self.path).map_err(|e| self.unwritten(&e))
    }

    /// Writes the complete file.
    pub(crate) fn write(&self, content: &[u8]) -> Result<(), Failure> {
        atomic_file::write(self.path, content).map_err(|e| self.unwritten(&e))
    }
}

/// Prints a text and a newline.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    leg_process::stdout::print_line(text).map_err(failed)
}
