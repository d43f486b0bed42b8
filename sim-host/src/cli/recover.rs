//! `sim-host recover`.

use std::path::PathBuf;
use std::process::ExitCode;

use leg_process::stdout;

use super::{hint, misuse, unwritable};
use crate::record::recover::{self, RecoverError};

/// Makes a complete recording of what a killed recorder has left: of all messages up to the
/// last complete chunk, with an index. Where the run's end is missing, the recording gets one
/// that states `recovered`. The file that is read stays as it is.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// File that was cut off, such as `run.mcap.part`.
    file: PathBuf,
    /// Recording to write, a new file [default: FILE without `.part`].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let is_part = args.file.extension().is_some_and(|end| end == "part");
    let beside = is_part.then(|| args.file.with_extension(""));
    let Some(output) = args.output.clone().or(beside) else {
        return Err(misuse(format!(
            "{} does not end in `.part`; --output FILE names the recording to write",
            args.file.display()
        )));
    };
    let recovered = recover::recover(&args.file, &output).map_err(|error| match error {
        RecoverError::Write { path, cause } => {
            unwritable(cause, format!("cannot write {}", path.display()))
        }
        error => {
            let hint = match &error {
                RecoverError::Read(cause) => hint::read_error(cause),
                RecoverError::OutputExists(_) => {
                    Some("--output FILE names another file to write".to_owned())
                }
                _ => None,
            };
            misuse(leg_host::cli::hint::with_hint(error, hint))
        }
    })?;
    stdout::print_line(format_args!("{}", recovered.warning))?;
    stdout::print_line(format_args!(
        "{} has {} ticks of it, an index, and an end",
        output.display(),
        recovered.ticks
    ))?;
    Ok(ExitCode::SUCCESS)
}
