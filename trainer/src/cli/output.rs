//! Output files, which appear complete or not at all, the standard output, threads.

use super::{Failure, failed};
use crate::threads::Threads;
use anyhow::anyhow;
use leg_process::{atomic_file, check_apart, remedy, stderr};
use rayon::ThreadPool;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A file to write, and the option that names it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target<'a> {
    pub(crate) path: &'a Path,
    pub(crate) option: &'static str,
}

impl Target<'_> {
    fn unwritten(&self, error: &io::Error, more: &str) -> Failure {
        let path = self.path.display();
        let remedy = remedy(error, self.option);
        failed(anyhow!("{path}: cannot be written: {error}{more}; {remedy}"))
    }

    /// Checks before the work whether the file can be written, and is none of `inputs`, which it
    /// would replace. A path that cannot be that of such a file is bad input.
    pub(crate) fn check<'p>(
        &self,
        inputs: impl IntoIterator<Item = &'p Path>,
    ) -> Result<(), Failure> {
        self.check_apart(inputs)?;
        atomic_file::check(self.path).map_err(|error| self.unwritable(&error))
    }

    /// Checks that the file is none of `inputs`, which it would replace.
    pub(crate) fn check_apart<'p>(
        &self,
        inputs: impl IntoIterator<Item = &'p Path>,
    ) -> Result<(), Failure> {
        check_apart(self.path, inputs).map_err(|error| self.unwritable(&error))
    }

    fn unwritable(&self, error: &io::Error) -> Failure {
        match self.unwritten(error, "") {
            Failure::Run(message) if remedy::is_wrong_path(error) => Failure::Input(message),
            failure => failure,
        }
    }

    /// Writes the complete file. Where that fails, the content, which may have taken hours,
    /// is saved among the temporary files.
    pub(crate) fn write(&self, content: &[u8]) -> Result<(), Failure> {
        atomic_file::write(self.path, content).map_err(|error| {
            let saved = save(self.path, content).map(|at| {
                let at = at.display();
                format!("; the complete content is in {at} instead")
            });
            self.unwritten(&error, &saved.unwrap_or_default())
        })
    }
}

/// Returns what helps against an error of a file that `option` names.
pub(crate) fn remedy(error: &io::Error, option: &str) -> String {
    let other = || format!("name another place with {option}");
    remedy::of_write(error).map_or_else(other, str::to_owned)
}

/// Saves content among the temporary files; `None` where that fails, too.
fn save(path: &Path, content: &[u8]) -> Option<PathBuf> {
    let name = path.file_name()?.to_string_lossy();
    let at = std::env::temp_dir().join(format!("{}-{name}", std::process::id()));
    let mut file = File::create_new(&at).ok()?;
    file.write_all(content).and_then(|()| file.sync_all()).ok().map(|()| at)
}

/// Prints a text and a newline.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    leg_process::stdout::print_line(text).map_err(failed)
}

/// Returns the threads to compute on; says so where there are fewer than wanted.
pub(crate) fn pool() -> Result<&'static ThreadPool, Failure> {
    static THREADS: OnceLock<Threads> = OnceLock::new();
    if let Some(threads) = THREADS.get() {
        return Ok(&threads.pool);
    }
    let threads = Threads::start().map_err(failed)?;
    if let Some(shortage) = threads.shortage() {
        stderr::print_line(format_args!("trainer: {shortage}"));
    }
    Ok(&THREADS.get_or_init(|| threads).pool)
}
