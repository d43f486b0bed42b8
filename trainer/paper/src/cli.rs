//! The command line: exit status 0, 1 when something failed, 2 when what was given
//! cannot be used.

use std::fs;
use std::io::{IsTerminal, stderr};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

use leg_process::atomic_file;
use leg_process::stdout;

use crate::{Claim, Extent, Figure, FiguresError, Made, Reference, Workshop, all, page};

/// Where the authors' data lies when nothing says otherwise.
const USUAL_REFERENCE: &str = "../shared/reference";

/// Draws the paper's figures, computed anew, and judges its claims.
#[derive(Debug, Parser)]
#[command(
    name = "paper-figures",
    version,
    about,
    after_help = "\
Parts that are done are kept in DIR/parts and used again for as long as what they were made
from is the same: a run that was cut goes on. The authors' data (doi 10.5281/zenodo.4607469)
is drawn beside ours where its folder is found: --reference, else the variable
LEG_REFERENCE_DATA, else ../shared/reference."
)]
struct Arguments {
    /// The folder for the pictures, their CSV files, and report.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only these figures, such as 3,7,11 or beyond
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    only: Vec<String>,
    /// A few seconds instead of a few minutes: coarser, and from fewer seeds
    #[arg(long)]
    quick: bool,
    /// Where the authors' data lies
    #[arg(long, value_name = "DIR")]
    reference: Option<PathBuf>,
}

/// Why the program ends early.
#[derive(Debug)]
enum Failure {
    /// The caller can put it right: exit status 2.
    Input(anyhow::Error),
    /// It went wrong all the same: exit status 1.
    Run(anyhow::Error),
}

fn input(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Input(error.into())
}

fn failed(error: impl Into<anyhow::Error>) -> Failure {
    Failure::Run(error.into())
}

/// Runs the program; returns its exit status.
#[must_use]
pub fn main() -> ExitCode {
    let (error, status) = match run(&Arguments::parse()) {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Input(error)) => (error, 2),
        Err(Failure::Run(error)) => (error, 1),
    };
    eprintln!("paper-figures: {error:#}");
    ExitCode::from(status)
}

/// Writes a whole file, or says which one could not be written and what to do.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    atomic_file::write(path, text.as_bytes()).map_err(|cause| {
        failed(anyhow!(
            "{}: cannot be written: {cause}; name another place with --out",
            path.display()
        ))
    })
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let began = Instant::now();
    let extent = if arguments.quick { Extent::Quick } else { Extent::Full };
    let figures = chosen(&arguments.only)?;
    let reference = reference(arguments.reference.as_deref())?;
    let costs: Vec<f64> = figures.iter().map(|figure| figure.cost_s(extent)).collect();
    let bar = bar(costs.iter().sum());
    let parts = arguments.out.join("parts");
    let shop = Workshop::open(extent, reference, &parts, bar.clone()).map_err(failed)?;

    let mut made: Vec<(&dyn Figure, Made)> = Vec::new();
    let mut until_s = 0.0;
    for (figure, cost_s) in figures.iter().zip(costs) {
        bar.set_message(figure.title());
        let done = figure.make(&shop).map_err(|error| match error {
            FiguresError::Reference { .. } => input(error),
            error => failed(error),
        })?;
        let file = |end: &str| arguments.out.join(format!("{}.{end}", figure.id()));
        for (path, text) in [(file("svg"), &done.svg), (file("csv"), &done.csv)] {
            write(&path, text)?;
        }
        made.push((figure.as_ref(), done));
        until_s += cost_s;
        shop.reached(until_s);
        if !stderr().is_terminal() {
            eprintln!(
                "{}: {} ({:.0} s)",
                figure.id(),
                figure.title(),
                began.elapsed().as_secs_f64()
            );
        }
    }
    bar.finish_and_clear();

    let provenance = provenance(&shop, began.elapsed());
    let pairs: Vec<(&dyn Figure, &Made)> = made.iter().map(|(f, m)| (*f, m)).collect();
    let report = arguments.out.join("report.html");
    write(&report, &page(&pairs, &provenance))?;
    stdout::print_line(summary(&pairs, &report, began.elapsed())).map_err(failed)
}

/// The figures that were asked for, in their order.
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
                "--only {name}: there is no such figure; there are {}",
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
        Some(folder) => Reference::at(folder).map(Some).ok_or_else(|| {
            input(anyhow!("--reference {}: there is no such folder", folder.display()))
        }),
        None => Ok(Reference::at(&named.unwrap_or_else(|| USUAL_REFERENCE.into()))),
    }
}

fn bar(cost_s: f64) -> ProgressBar {
    if !stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = "{bar:30} {percent:>3} %  {elapsed}, {eta} to go  {msg}";
    let bar = ProgressBar::new(Workshop::units(cost_s));
    bar.set_style(ProgressStyle::with_template(style).expect("a valid template"));
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// What the page says of how it came about.
fn provenance(shop: &Workshop, took: Duration) -> Vec<(String, String)> {
    let row = |what: &str, value: String| (what.to_owned(), value);
    let extent = match shop.extent {
        Extent::Full => "full",
        Extent::Quick => "quick: coarser, and from fewer seeds; read the verdicts with care",
    };
    let mut rows = vec![
        row("program", format!("paper-figures {}", env!("CARGO_PKG_VERSION"))),
        row("extent", extent.to_owned()),
        row(
            "the authors' data",
            match &shop.reference {
                Some(_) => "found (doi 10.5281/zenodo.4607469), and drawn beside ours".to_owned(),
                None => "not found: the figures show ours alone".to_owned(),
            },
        ),
    ];
    rows.extend(shop.policies().into_iter().map(|(name, from)| (format!("policy: {name}"), from)));
    rows.push(row("machine", machine()));
    let time = format!("{:.0} s, less what was found from earlier runs", took.as_secs_f64());
    rows.push(row("time", time));
    rows
}

fn machine() -> String {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or(std::env::consts::ARCH, |(_, model)| model);
    format!("{model}, {} threads", rayon::current_num_threads())
}

fn summary(figures: &[(&dyn Figure, &Made)], report: &Path, took: Duration) -> String {
    let claims = figures.iter().flat_map(|(figure, made)| {
        made.claims.iter().map(|claim| {
            let Claim { says, measured, verdict } = claim;
            format!("{:<7} {:<14} {says}: {measured}\n", figure.id(), verdict.words())
        })
    });
    claims.collect::<String>() + &format!("{} ({:.0} s)", report.display(), took.as_secs_f64())
}
