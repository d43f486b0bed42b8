//! `sim-host robustness`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use leg_process::stdout;

use super::study::{Study, StudyArgs};
use super::{checked_policy, misuse, unwritable};
use crate::robustness::{Comparison, Report, Size, picture, sweep};
use leg_process::atomic_file::AtomicFile;
use leg_process::policy_file::PolicyFile;

/// Plays a policy under faults of growing level, one kind at a time, and with sensors of every
/// kind, in each medium, from seeded starts. Prints and plots the share of runs that still hop
/// after 30 hops, also beside those of another policy or build.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    study: StudyArgs,
    /// Another policy, or the --json output of an earlier sweep: its shares are shown beside these,
    /// with the 95 % intervals of the differences.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Directory for robustness.svg and robustness.csv.
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let Study { policy: blob, runs, media, pool } = args.study.study()?;
    let policy = blob.policy().map_err(misuse)?;
    let other = args.against.as_deref().map(Other::read).transpose()?;
    // Opened before the sweep, so that an unwritable directory is reported at once.
    let (svg, csv) = (begin(&args.out, "robustness.svg")?, begin(&args.out, "robustness.csv")?);
    let size = Size { runs, media };
    let mut report = pool.install(|| sweep(&policy, &size))?;
    if let (Some(other), Some(path)) = (other, &args.against) {
        let theirs = match other {
            Other::Report(report) => report,
            Other::Policy(blob) => {
                let policy = blob.policy().map_err(misuse)?;
                pool.install(|| sweep(&policy, &size))?
            }
        };
        let compared = Comparison::new(&report, &theirs);
        report.against = Some(compared.map_err(|cause| {
            misuse(format!("cannot compare with --against {}: {cause}", path.display()))
        })?);
    }
    // Printed first, so that it is not lost where a file cannot be written.
    if args.study.json {
        stdout::print_line(serde_json::to_string(&report)?)?;
    } else {
        stdout::print_line(&report)?;
    }
    finish(csv, &report.csv())?;
    let drawn = picture::draw(&report)
        .map_err(|cause| anyhow::anyhow!("cannot draw the picture: {cause}"))?;
    finish(svg, &drawn)?;
    if !args.study.json {
        let picture = args.out.join("robustness.svg");
        stdout::print_line(format_args!("  picture: {}", picture.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What a sweep is compared with.
enum Other {
    Policy(PolicyFile),
    Report(Report),
}

impl Other {
    /// Reads a file, which is a report if it begins as JSON does.
    fn read(path: &Path) -> anyhow::Result<Self> {
        let bytes = fs::read(path).map_err(|cause| {
            misuse(format!("--against {}: the file cannot be read: {cause}", path.display()))
        })?;
        if bytes.trim_ascii_start().starts_with(b"{") {
            serde_json::from_slice(&bytes).map(Self::Report).map_err(|cause| {
                let what = "the file is JSON, but no report of `sim-host robustness --json`";
                misuse(format!("--against {}: {what}: {cause}", path.display()))
            })
        } else {
            checked_policy(Some(path)).map(Self::Policy)
        }
    }
}

fn begin(folder: &Path, name: &str) -> anyhow::Result<(AtomicFile, PathBuf)> {
    let path = folder.join(name);
    let pending = fs::create_dir_all(folder)
        .and_then(|()| AtomicFile::create(&path))
        .map_err(|error| unwritable(error, cannot_write(&path)))?;
    Ok((pending, path))
}

fn finish((mut file, path): (AtomicFile, PathBuf), text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    file.write_all(text.as_bytes())
        .and_then(|()| file.finish())
        .with_context(|| cannot_write(&path))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}; --out chooses another folder", path.display())
}
