//! `sim-host export`.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use leg_control::serial::message::Estimator;
use leg_host::law;
use leg_host::recorded::RecordedError;
use leg_process::atomic_file::AtomicFile;
use leg_process::{check_apart, stdout};

use super::{hint, misuse, unwritable};
use crate::export::{self, ExportError, Exported};

/// Writes the readings of a recording, and the truth, as a CSV log for `controller estimate`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Recording made by `sim-host run --record`.
    recording: PathBuf,
    /// CSV file to write.
    #[arg(long, value_name = "FILE")]
    csv: PathBuf,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let Args { recording, csv } = args;
    let cannot_write = || format!("cannot write {}", csv.display());
    let mut file = check_apart(csv, [recording.as_path()])
        .and_then(|()| AtomicFile::create(csv))
        .map_err(|error| unwritable(error, cannot_write()))?;
    let exported = export::export(recording, &mut file).map_err(|error| match error {
        ExportError::Write(cause) => anyhow::Error::new(cause).context(cannot_write()),
        error => misuse(leg_host::cli::hint::with_hint(&error, hint_on(&error))),
    })?;
    file.finish().with_context(cannot_write)?;
    hint::print_warnings(recording, &exported.warning, exported.warning.is_none());
    stdout::print_line(format!(
        "{} rows; the estimator of the run reads them by\n{}",
        exported.rows,
        command(&quoted(csv.as_os_str()), &exported)
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn hint_on(error: &ExportError) -> Option<String> {
    match error {
        ExportError::Read(cause) | ExportError::Recorded(RecordedError::Read(cause)) => {
            hint::read_error(cause)
        }
        _ => None,
    }
}

/// Returns the command that estimates what the controller did; of one by its readings that which
/// chooses an estimator.
fn command(csv: &str, exported: &Exported) -> String {
    let command = format!("controller estimate --input {csv}");
    let (name, noise) = law::parts(exported.estimator);
    if exported.estimator == Estimator::Readings {
        return command;
    }
    let noise: Vec<_> = noise.iter().map(|(name, x)| format!("{name}={x}")).collect();
    let stale_ms = exported.stale_limit_ns as f64 / 1e6;
    format!(
        "{command} --estimator {name} --estimator-noise {} --stale-limit {stale_ms}",
        noise.join(",")
    )
}

/// Returns a word as a shell takes it.
fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=,:@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
