//! Files that appear whole or not at all, and the standard output.

use super::{Failure, failed};
use anyhow::Context;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file under a temporary name beside its own, until it is finished.
pub(crate) struct Pending {
    writer: Option<BufWriter<File>>,
    temporary: PathBuf,
    path: PathBuf,
}

impl Pending {
    /// Opens it.
    pub(crate) fn create(path: &Path) -> Result<Self, Failure> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".partial-{}", std::process::id()));
        let temporary = path.with_file_name(name);
        let file = File::create(&temporary)
            .with_context(|| format!("{}: cannot be written", path.display()))
            .map_err(failed)?;
        Ok(Self { writer: Some(BufWriter::new(file)), temporary, path: path.into() })
    }

    /// Gives it its name.
    pub(crate) fn finish(mut self) -> Result<(), Failure> {
        let writer = self.writer.take();
        let close = || -> std::io::Result<()> {
            if let Some(writer) = writer {
                writer.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
            }
            std::fs::rename(&self.temporary, &self.path)
        };
        let closed = close();
        closed
            .with_context(|| format!("{}: cannot be written", self.path.display()))
            .map_err(failed)
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.writer.as_mut().map_or(Ok(0), |w| w.write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        // Given up, or renamed already: then there is nothing to remove.
        let _ = std::fs::remove_file(&self.temporary);
    }
}

/// Writes a whole file.
pub(crate) fn write_file(path: &Path, content: &[u8]) -> Result<(), Failure> {
    let mut file = Pending::create(path)?;
    file.write_all(content)
        .with_context(|| format!("{}: cannot be written", path.display()))
        .map_err(failed)?;
    file.finish()
}

/// Prints a text and a newline.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    writeln!(std::io::stdout().lock(), "{text}").map_err(failed)
}
