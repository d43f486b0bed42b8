//! The command line. Exit status: 0 on success, 1 if the run failed, 2 if an argument
//! cannot be used.

use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

use leg_process::{atomic_file, remedy, signals, stderr, stdout};
use trainer::threads::{Threads, redraw};

use crate::{
    Claim, Extent, Figure, FigureContext, FiguresError, Reference, RenderedFigure, all, report,
};

/// Where the authors' data is looked for by default.
const USUAL_REFERENCE: &str = "../shared/reference";
/// What helps if a file cannot be written.
const OUT_HINT: &str = "try another folder with --out";

/// Compute and draw the paper's figures, and test its claims
#[derive(Debug, Parser)]
#[command(
    name = "paper-figures",
    version,
    about,
    after_help = "\
The results of each step are cached in DIR/cache and used again if the step's inputs are the
same: an interrupted run resumes. The authors' data (doi 10.5281/zenodo.4607469) is drawn beside
ours if its folder is found: --reference, else the environment variable LEG_REFERENCE_DATA, else
../shared/reference."
)]
struct Arguments {
    /// Folder to write: an SVG and a CSV file for each figure, and report.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Render these figures only, such as 3,7,11 or beyond
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    only: Vec<String>,
    /// Take about a minute instead of several: coarser grids, fewer seeds
    #[arg(long)]
    quick: bool,
    /// Folder with the authors' data
    #[arg(long, value_name = "DIR")]
    reference: Option<PathBuf>,
}

/// A reason to end early.
#[derive(Debug)]
enum Failure {
    /// An argument cannot be used: exit status 2.
    Input(anyhow::Error),
    /// The run failed: exit status 1.
    Run(anyhow::Error),
}

fn input(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Input(error.into())
}

fn failed(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Run(error.into())
}

impl From<FiguresError> for Failure {
    fn from(error: FiguresError) -> Self {
        match error {
            FiguresError::Reference { .. } => input(error),
            FiguresError::Write { ref cause, .. } => {
                let hint = remedy::of_write(cause).unwrap_or(OUT_HINT);
                let message = anyhow!("{error}; {hint}");
                if remedy::is_wrong_path(cause) { input(message) } else { failed(message) }
            }
            _ => failed(error),
        }
    }
}

/// Runs the program and returns its exit status.
#[must_use]
pub fn main() -> ExitCode {
    signals::report_size_limit();
    let (error, status) = match run(&Arguments::parse()) {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Input(error)) => (error, 2),
        Err(Failure::Run(error)) => (error, 1),
    };
    stderr::print_line(format_args!("paper-figures: {}", leg_process::chain(error.as_ref())));
    ExitCode::from(status)
}

fn unwritten(path: &Path) -> impl FnOnce(io::Error) -> Failure {
    |cause| FiguresError::Write { path: path.into(), cause }.into()
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    atomic_file::write(path, text.as_bytes()).map_err(unwritten(path))
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let threads = Threads::start().map_err(failed)?;
    if let Some(shortage) = threads.shortage() {
        stderr::print_line(format_args!("paper-figures: {shortage}"));
    }
    threads.pool.install(|| render(arguments))
}

fn render(arguments: &Arguments) -> Result<(), Failure> {
    let began = Instant::now();
    let extent = if arguments.quick { Extent::Quick } else { Extent::Full };
    let figures = chosen(&arguments.only)?;
    let reference = reference(arguments.reference.as_deref())?;
    let costs: Vec<f64> = figures.iter().map(|figure| figure.cost_s(extent)).collect();
    let bar = bar(costs.iter().sum());
    let ctx = FigureContext::open(extent, reference, &arguments.out.join("cache"), bar.clone())?;

    let path = arguments.out.join("report.html");
    // Before the figures: the results must be writable.
    atomic_file::check(&path).map_err(unwritten(&path))?;
    let mut rendered: Vec<(&dyn Figure, RenderedFigure)> = Vec::new();
    let mut until_s = 0.0;
    for (figure, cost_s) in figures.iter().zip(costs) {
        let figure = figure.as_ref();
        bar.set_message(figure.title());
        let result = figure.render(&ctx)?;
        for (extension, text) in [("svg", &result.svg), ("csv", &result.csv)] {
            write(&arguments.out.join(figure.id()).with_extension(extension), text)?;
        }
        rendered.push((figure, result));
        until_s += cost_s;
        ctx.finish_figure(until_s);
        if !io::stderr().is_terminal() {
            let took_s = began.elapsed().as_secs_f64();
            stderr::print_line(format_args!("{}: {} ({took_s:.0} s)", figure.id(), figure.title()));
        }
    }
    bar.finish_and_clear();

    write(&path, &report(&rendered, &provenance(&ctx, began.elapsed())))?;
    stdout::print_line(summary(&rendered, &path, began.elapsed())).map_err(failed)
}

/// Returns the figures named by `--only`, or all, in the order of the paper.
fn chosen(only: &[String]) -> Result<Vec<Box<dyn Figure>>, Failure> {
    let all = all();
    let names = |figure: &dyn Figure| {
        let id = figure.id().to_owned();
        let short = id.trim_start_matches("fig").trim_start_matches('0').to_owned();
        [id, short]
    };
    for name in only {
        if !all.iter().any(|figure| names(figure.as_ref()).contains(name)) {
            let known: Vec<String> = all.iter().map(|f| names(f.as_ref())[1].clone()).collect();
            return Err(input(anyhow!(
                "--only {name}: no such figure; the figures are {}",
                known.join(", ")
            )));
        }
    }
    let wanted = |figure: &dyn Figure| {
        only.is_empty() || names(figure).iter().any(|name| only.contains(name))
    };
    Ok(all.into_iter().filter(|figure| wanted(figure.as_ref())).collect())
}

fn reference(given: Option<&Path>) -> Result<Option<Reference>, Failure> {
    let named = std::env::var_os("LEG_REFERENCE_DATA").map(PathBuf::from);
    match given {
        Some(folder) => Reference::at(folder)
            .map(Some)
            .ok_or_else(|| input(anyhow!("--reference {}: no such folder", folder.display()))),
        None => Ok(Reference::at(&named.unwrap_or_else(|| USUAL_REFERENCE.into()))),
    }
}

fn bar(cost_s: f64) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = "{bar:30} {percent:>3} %  {elapsed}, {eta} to go  {msg}";
    let bar = ProgressBar::new(FigureContext::units(cost_s));
    bar.set_style(ProgressStyle::with_template(style).expect("a valid template"));
    redraw(&bar, Duration::from_millis(250));
    bar
}

/// Returns how the report came about: rows of what, and value.
fn provenance(ctx: &FigureContext, took: Duration) -> Vec<(String, String)> {
    let row = |what: &str, value: String| (what.to_owned(), value);
    let extent = match ctx.extent {
        Extent::Full => "full",
        Extent::Quick => "quick: coarser grids and fewer seeds, so the verdicts are preliminary",
    };
    let mut rows = vec![
        row("program", format!("paper-figures {}", env!("CARGO_PKG_VERSION"))),
        row("extent", extent.to_owned()),
        row(
            "the authors' data",
            match &ctx.reference {
                Some(_) => "found (doi 10.5281/zenodo.4607469) and drawn beside ours".to_owned(),
                None => "not found: the figures show only our own results".to_owned(),
            },
        ),
    ];
    rows.extend(
        ctx.policies().into_iter().map(|(name, origin)| (format!("policy: {name}"), origin)),
    );
    rows.push(row("machine", machine()));
    let time = format!("{:.0} s, without steps cached by earlier runs", took.as_secs_f64());
    rows.push(row("time", time));
    rows
}

fn machine() -> String {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or(std::env::consts::ARCH, |(_, model)| model);
    format!("{model}, {} threads", rayon::current_num_threads())
}

/// Returns a line for each claim, and where the report is.
fn summary(figures: &[(&dyn Figure, RenderedFigure)], report: &Path, took: Duration) -> String {
    let claims = figures.iter().flat_map(|(figure, rendered)| {
        rendered.claims.iter().map(|Claim { statement, measured, verdict }| {
            format!("{:<7} {:<14} {statement}: {measured}\n", figure.id(), verdict.text())
        })
    });
    claims.collect::<String>() + &format!("{} ({:.0} s)", report.display(), took.as_secs_f64())
}
