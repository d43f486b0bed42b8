//! The command `trainer plot`.

use super::output::{Target, print};
use super::{Failure, failed, input};
use crate::curves::log::Log;
use crate::curves::picture::draw;
use crate::curves::smooth::{Curve, Group, Smoothing, curves, extent, usual_window};
use crate::curves::{By, Zero};
use crate::run::paths::{title, usual_log};
use anyhow::{Context, anyhow};
use clap::Args;
use glob::{Pattern, glob};
use leg_charts::color::SERIES;
use leg_charts::grouped;
use leg_process::policy_file::PolicyFile;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
#[command(after_help = "\
Of several runs, the line is the median and the band lies between the quartiles. A curve
ends where the first of its runs does: of those left over, the median would be another's.
The window does not reach over a change of stage; until it is half full, there is no line.

The paper's learning curves, from eight seeds of each:
  trainer plot water-first='runs/w2a-*.csv' air='runs/air-*.csv' \\
      --by episodes --zero last-stage --out curves.svg")]
pub(super) struct Arguments {
    /// Runs to draw: a log of `trainer train`, a policy file with its log beside it, a folder
    /// with logs at any depth, or a pattern such as 'runs/air-*.csv'. Each log is a curve,
    /// named after the file; logs of the same LABEL, folder or pattern are one curve
    #[arg(value_name = "[LABEL=]RUN", required = true)]
    runs: Vec<String>,
    /// SVG file to write
    #[arg(long)]
    out: PathBuf,
    /// Unit of the horizontal axis
    #[arg(long, value_enum, default_value = "steps")]
    by: By,
    /// Position of zero on the horizontal axis
    #[arg(long, value_enum, default_value = "start")]
    zero: Zero,
    /// Width of the smoothing window, in the unit of the axis [default: a round number, about
    /// a fiftieth of the axis]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    window: Option<u32>,
    /// Number of steps of a full episode [default: that of the longest of each curve]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    full_steps: Option<u64>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let target = Target { path: &arguments.out, option: "--out" };
    target.check(inputs(&arguments.runs)?.iter().map(PathBuf::as_path))?;
    let groups = groups(&arguments.runs)?;
    let x_range = extent(&groups, arguments.by, arguments.zero);
    let how = Smoothing {
        by: arguments.by,
        zero: arguments.zero,
        window: arguments.window.map_or_else(|| usual_window(x_range), f64::from),
        full_steps: arguments.full_steps,
    };
    let curves = curves(&groups, &how);
    if let Some(empty) = curves.iter().find(|c| c.stretches.is_empty()) {
        let (label, window, unit) = (&empty.label, grouped(how.window), how.by.unit());
        return Err(input(anyhow!(
            "{label}: nothing to draw: no place has half a window of {window} {unit} in every run; \
             give a smaller --window, or longer runs"
        )));
    }
    let svg =
        draw(&curves, &how, x_range).map_err(|e| failed(anyhow!("cannot draw the curves: {e}")))?;
    target.write(svg.as_bytes())?;
    print(&summary(&curves, &how, &arguments.out))
}

/// Returns a table of the last values of each curve.
fn summary(curves: &[Curve], how: &Smoothing, out: &Path) -> String {
    let (window, unit) = (grouped(how.window), how.by.unit());
    let widest = curves.iter().map(|c| c.label.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!(
        "{}: mean over the last {window} {unit}; at each curve's end, median [quartiles]:\n\
         {:widest$}  runs  {unit:>9}               reward      full episodes, %",
        out.display(),
        "curve",
    );
    for curve in curves {
        let Some(end) = curve.stretches.last().and_then(|s| s.last()) else { continue };
        let (r, f) = (end.reward, end.full);
        let reward = format!("{:.2} [{:.2}, {:.2}]", r.median, r.low, r.high);
        let [full, low, high] = [f.median, f.low, f.high].map(|share| 100.0 * share);
        let full = format!("{full:.1} [{low:.1}, {high:.1}]");
        let row = format!(
            "\n{:widest$}  {:>4}  {:>9}  {reward:>19}  {:>20}",
            curve.label,
            curve.runs,
            grouped(end.x),
            full,
        );
        text.push_str(&row);
    }
    text
}

/// Returns every file that is named, and every log.
fn inputs(runs: &[String]) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for run in runs {
        let (_, place) = split(run)?;
        found.push(PathBuf::from(place));
        found.extend(logs(place)?);
    }
    Ok(found)
}

/// Reads every run, grouped by label, in the order of the arguments.
fn groups(arguments: &[String]) -> Result<Vec<Group>, Failure> {
    let mut found: Vec<(String, Vec<PathBuf>)> = Vec::new();
    for argument in arguments {
        let (label, place) = split(argument)?;
        let logs = logs(place)?;
        let label = label.map_or_else(|| name(place), str::to_owned);
        if label.chars().any(char::is_control) {
            return Err(input(anyhow!(
                "{label:?}: a label cannot be drawn with control characters"
            )));
        }
        match found.iter_mut().find(|(known, _)| *known == label) {
            Some((_, paths)) => paths.extend(logs),
            None => found.push((label, logs)),
        }
    }
    if found.len() > SERIES.len() {
        return Err(input(anyhow!(
            "{} curves, at most {} are distinguishable; join runs as LABEL=RUN",
            found.len(),
            SERIES.len()
        )));
    }
    found.into_iter().map(|(label, paths)| group(label, paths)).collect()
}

fn group(label: String, mut paths: Vec<PathBuf>) -> Result<Group, Failure> {
    // A log counts once, even under several names.
    let place = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    paths.sort_by_cached_key(place);
    paths.dedup_by_key(|path| place(path));
    let runs = paths.iter().map(|path| Log::read(path)).collect::<Result<_, _>>().map_err(input)?;
    Ok(Group { label, runs })
}

/// Splits an argument into label and path. The name of an existing file may contain `=`.
fn split(argument: &str) -> Result<(Option<&str>, &str), Failure> {
    match argument.split_once('=') {
        Some((label, place)) if !Path::new(argument).exists() => {
            if label.trim().is_empty() || place.is_empty() {
                return Err(input(anyhow!("'{argument}': expected LABEL=RUN")));
            }
            Ok((Some(label.trim()), place))
        }
        _ => Ok((None, argument)),
    }
}

/// Returns the name of runs without a label.
fn name(place: &str) -> String {
    // A folder such as `.` has its name only in its canonical path.
    let folder = Path::new(place).canonicalize().ok().filter(|path| path.is_dir());
    let name = match folder.as_deref().and_then(Path::file_name) {
        Some(name) => name.to_owned(),
        None => title(Path::new(place)),
    };
    name.to_string_lossy().into_owned()
}

/// Returns the logs of a file, folder or pattern; at least one.
fn logs(place: &str) -> Result<Vec<PathBuf>, Failure> {
    let path = Path::new(place);
    if path.is_dir() {
        let all = matches(&format!("{}/**/*.csv", Pattern::escape(place)))?;
        let logs: Vec<PathBuf> = all.into_iter().filter(|path| Log::recognises(path)).collect();
        if logs.is_empty() {
            return Err(input(anyhow!(
                "{place}: no log of a training in this folder, nor below it"
            )));
        }
        return Ok(logs);
    }
    if !path.exists() && place.contains(['*', '?', '[']) {
        let found = matches(place)?;
        if found.is_empty() {
            return Err(input(anyhow!("{place}: no file matches this pattern")));
        }
        return found.iter().map(|path| log_of(path)).collect();
    }
    Ok(vec![log_of(path)?])
}

/// Returns the path of a log, given by its own name or by its policy's.
fn log_of(path: &Path) -> Result<PathBuf, Failure> {
    if !is_policy(path) {
        return Ok(path.to_owned());
    }
    let log = usual_log(path);
    if log.exists() {
        return Ok(log);
    }
    let (path, log) = (path.display(), log.display());
    Err(input(anyhow!("{path}: its log {log} does not exist; name the log itself")))
}

/// Whether a file is a policy rather than a log, by its name or its content.
fn is_policy(path: &Path) -> bool {
    let named = path.extension().is_some_and(|ending| ending == "bin");
    named || PolicyFile::read(path).is_ok_and(|file| file.policy().is_ok())
}

fn matches(pattern: &str) -> Result<Vec<PathBuf>, Failure> {
    let paths = glob(pattern).with_context(|| pattern.to_owned()).map_err(input)?;
    paths.collect::<Result<_, _>>().map_err(input)
}
