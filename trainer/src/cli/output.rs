//! Files that appear whole or not at all, and the standard output.

use super::{Failure, failed};
use anyhow::Context;
use sim_host::output::{Pending, replace};
use std::io::Write;
use std::path::Path;

/// Says which file could not be written.
fn at<T>(path: &Path, result: std::io::Result<T>) -> Result<T, Failure> {
    result.with_context(|| format!("{}: cannot be written", path.display())).map_err(failed)
}

/// Begins a file that gets its name when it is [`finish`]ed.
pub(crate) fn begin(path: &Path) -> Result<Pending, Failure> {
    at(path, Pending::create(path))
}

/// Gives a file its name.
pub(crate) fn finish(path: &Path, file: Pending) -> Result<(), Failure> {
    at(path, file.finish())
}

/// Writes a whole file.
pub(crate) fn write_file(path: &Path, content: &[u8]) -> Result<(), Failure> {
    at(path, replace(path, content))
}

/// Prints a text and a newline.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    writeln!(std::io::stdout().lock(), "{text}").map_err(failed)
}
