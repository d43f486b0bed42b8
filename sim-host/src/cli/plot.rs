//! `sim-host plot`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use super::{hint, misuse, unwritable};
use crate::plot::{PlotData, picture};
use leg_process::{atomic_file, check_apart};

/// Plots a recording over time: height, velocity at each apex and set-point,
/// density, commands, events, and where a safe command was in force; the estimates of
/// a controller, where they are recorded, against the truth.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Recording made by `sim-host run --record`.
    recording: PathBuf,
    /// SVG file to write.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Begin of the plot in simulated time, s [default: the start].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: Option<f64>,
    /// End of the plot in simulated time, s [default: the end].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    until: Option<f64>,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let (from_s, until_s) = (args.from.unwrap_or(0.0), args.until.unwrap_or(f64::INFINITY));
    if !(from_s >= 0.0 && until_s > from_s) {
        return Err(misuse(format!(
            "--from {from_s} --until {until_s}: the first must be 0 or more, the second above it"
        )));
    }
    // A long recording is not read for a picture that cannot be written.
    let cannot_write = || format!("cannot write {}", args.out.display());
    check_apart(&args.out, [args.recording.as_path()])
        .and_then(|()| atomic_file::check(&args.out))
        .map_err(|error| unwritable(error, cannot_write()))?;
    let data = PlotData::read(&args.recording, from_s..until_s).map_err(|error| {
        misuse(leg_host::cli::hint::with_hint(&error, hint::read_error(&error)))
    })?;
    if data.is_empty() {
        return Err(misuse(format!(
            "{}: it has no ticks between --from {from_s} s and --until {until_s} s with a true state \
             (/state), which a recording of `sim-host record` lacks; it ends at {:.3} s",
            args.recording.display(),
            data.end_s
        )));
    }
    hint::print_warnings(&args.recording, &data.warnings, data.is_complete);
    let svg = picture::draw(&data)
        .map_err(|cause| anyhow::anyhow!("cannot draw the picture: {cause}"))?;
    atomic_file::write(&args.out, svg.as_bytes()).with_context(cannot_write)?;
    Ok(ExitCode::SUCCESS)
}
