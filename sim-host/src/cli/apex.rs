//! `sim-host apex`: the apex map over a table of cases.

use std::f64::consts::TAU;
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use csv::StringRecord;
use leg_plant::{Action, Apex, Hop, Hopper, Leg, Medium, Outcome};
use leg_process::{atomic_file, check_apart};

use super::{Misuse, unwritable};

const COLUMNS: &str = "\
Input columns, in any order, identified by the names in the first line:
  vx     horizontal velocity at the apex, m/s, from -1000 to 1000 (required)
  y      height at the apex, m, above 0 and at most 100000 (required)
  alpha  touchdown angle from the +x axis, rad, from -2 pi to 2 pi (required)
  rs     elongation speed, m/s, from 0 to 1000 (required)
  m      dry mass, kg, above 0 and at most 1e6 (80)
  k      spring stiffness, N/m, above 0 and at most 1e9 (20000)
  g      gravity, m/s2, from 0 to 1000 (9.81)
  rho    density ratio: 1 water, 0 air; from 0 to 100 (0)
Other columns are ignored.

Output columns: m, k, g, rho, vx, y, alpha, rs, then
  outcome                         apex, apex_in_stance or fall
  hops                            stance phases begun
  t_touchdown, x_foot, t_liftoff  of the first stance, s and m
  t_apex, x_apex, vx_next, y_next the next apex
Times and places count from the start; a cell is empty where it does not apply.
Numbers have as many digits as needed to read back the same value.

After an error no output is written. Exit status: 2 for bad input, 1 for another failure.";

/// Computes the hop from one apex to the next for each row of a CSV file.
#[derive(Debug, clap::Args)]
#[command(after_help = COLUMNS)]
pub(super) struct Args {
    /// CSV file of apexes and actions; - reads from standard input.
    #[arg(long, value_name = "FILE", default_value = "-")]
    input: PathBuf,
    /// CSV file for the hops; - writes to standard output.
    #[arg(long, value_name = "FILE", default_value = "-")]
    output: PathBuf,
}

/// An input column: its name, its default if it is absent, and its range.
struct Column {
    name: &'static str,
    default: Option<f64>,
    allowed: Allowed,
}

/// A range of numbers, its ends included, wider than that of any leg that hops.
#[derive(Clone, Copy)]
enum Allowed {
    /// Above 0, up to the value.
    AboveZeroTo(f64),
    /// From 0 to the value.
    ZeroTo(f64),
    /// From the negative of the value to the value.
    UpTo(f64),
    /// Up to a whole turn in either direction.
    Angle,
}

impl Allowed {
    fn contains(self, value: f64) -> bool {
        match self {
            Self::AboveZeroTo(high) => value > 0.0 && value <= high,
            Self::ZeroTo(high) => (0.0..=high).contains(&value),
            Self::UpTo(high) => value.abs() <= high,
            Self::Angle => value.abs() <= TAU,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AboveZeroTo(high) => write!(f, "a finite number above 0 and at most {high}"),
            Self::ZeroTo(high) => write!(f, "a finite number from 0 to {high}"),
            Self::UpTo(high) => write!(f, "a finite number from -{high} to {high}"),
            Self::Angle => f.write_str("a finite number from -2 pi to 2 pi"),
        }
    }
}

/// Returns the input columns in the order of the output.
fn columns() -> [Column; 8] {
    let leg = *Leg::human().parameters();
    let medium = Medium::default();
    let column = |name, default, allowed| Column { name, default, allowed };
    [
        column("m", Some(leg.mass_kg), Allowed::AboveZeroTo(1e6)),
        column("k", Some(leg.stiffness_n_m), Allowed::AboveZeroTo(1e9)),
        column("g", Some(medium.gravity_m_s2()), Allowed::ZeroTo(1000.0)),
        column("rho", Some(medium.density_ratio()), Allowed::ZeroTo(100.0)),
        column("vx", None, Allowed::UpTo(1000.0)),
        column("y", None, Allowed::AboveZeroTo(1e5)),
        column("alpha", None, Allowed::Angle),
        column("rs", None, Allowed::ZeroTo(1000.0)),
    ]
}

const RESULTS: [&str; 9] = [
    "outcome",
    "hops",
    "t_touchdown",
    "x_foot",
    "t_liftoff",
    "t_apex",
    "x_apex",
    "vx_next",
    "y_next",
];

/// Reads all rows, computes the hops and writes them once all have succeeded.
pub(super) fn main(args: &Args) -> anyhow::Result<ExitCode> {
    let name = args.input.display();
    let cannot_write = || format!("cannot write {}", args.output.display());
    if !is_standard(&args.output) {
        check_apart(&args.output, [args.input.as_path()])
            .and_then(|()| atomic_file::check(&args.output))
            .map_err(|error| unwritable(error, cannot_write()))?;
    }
    let hops = if is_standard(&args.input) {
        convert(io::stdin().lock(), "standard input")?
    } else {
        let file = File::open(&args.input)
            .map_err(|error| Misuse(format!("cannot open {name}: {error}")))?;
        convert(BufReader::new(file), &name.to_string())?
    };
    if is_standard(&args.output) {
        match io::stdout().lock().write_all(&hops) {
            // The reader has closed the pipe.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
            result => result.context("cannot write to standard output")?,
        }
    } else {
        atomic_file::write(&args.output, &hops).with_context(cannot_write)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn is_standard(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Converts the input to the output.
fn convert(input: impl Read, name: &str) -> anyhow::Result<Vec<u8>> {
    let columns = columns();
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(input);
    let header = reader.headers().map_err(|error| unreadable(name, &error))?;
    let places = places(&columns, header, name)?;
    let width = header.len();

    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns.iter().map(|c| c.name).chain(RESULTS))?;
    let mut row = StringRecord::new();
    while reader.read_record(&mut row).map_err(|error| unreadable(name, &error))? {
        let line = row.position().map_or(0, csv::Position::line);
        if row.len() != width {
            let message =
                format!("{name}, line {line}: {} cells where the header has {width}", row.len());
            return Err(Misuse(message).into());
        }
        let mut values = [0.0; 8];
        let mut texts: [String; 8] = Default::default();
        for (i, column) in columns.iter().enumerate() {
            (values[i], texts[i]) = match (places[i], column.default) {
                (Some(place), _) => {
                    let text = &row[place];
                    (column.parse(text, name, line)?, text.to_owned())
                }
                (None, default) => {
                    let value = default.unwrap_or_default();
                    (value, format!("{value:?}"))
                }
            };
        }
        let hop = hop(values).with_context(|| format!("{name}, line {line}"))?;
        writer.write_record(texts.into_iter().chain(results(&hop)))?;
    }
    Ok(writer.into_inner()?)
}

/// Finds the position of each column in a row.
fn places(
    columns: &[Column; 8],
    header: &StringRecord,
    name: &str,
) -> Result<[Option<usize>; 8], Misuse> {
    let mut places = [None; 8];
    for (place, column) in places.iter_mut().zip(columns) {
        let mut found = (0..header.len()).filter(|&i| &header[i] == column.name);
        *place = found.next();
        if found.next().is_some() {
            return Err(Misuse(format!("{name}, line 1: more than one column {}", column.name)));
        }
        if place.is_none() && column.default.is_none() {
            return Err(Misuse(format!(
                "{name}, line 1: no column {}; vx, y, alpha and rs are required",
                column.name
            )));
        }
    }
    Ok(places)
}

impl Column {
    fn parse(&self, text: &str, name: &str, line: u64) -> Result<f64, Misuse> {
        match text.parse::<f64>() {
            Ok(value) if self.allowed.contains(value) => Ok(value),
            _ => Err(Misuse(format!(
                "{name}, line {line}, column {}: {text:?}; it must be {}",
                self.name, self.allowed
            ))),
        }
    }
}

/// Computes the hop of one row.
fn hop([m, k, g, rho, vx, y, alpha, rs]: [f64; 8]) -> anyhow::Result<Hop> {
    let mut parameters = *Leg::human().parameters();
    parameters.mass_kg = m;
    parameters.stiffness_n_m = k;
    let misuse = |error: leg_plant::ParameterError| Misuse(error.to_string());
    let leg = Leg::new(parameters).map_err(misuse)?;
    let medium = Medium::new(rho, g).map_err(misuse)?;
    let start = Apex { vx_m_s: vx, y_m: y };
    let action = Action { touchdown_angle_rad: alpha, elongation_speed_m_s: rs };
    Ok(Hopper::new(&leg, medium).hop(start, action))
}

/// Formats the cells of [`RESULTS`].
fn results(hop: &Hop) -> [String; 9] {
    let number = |value: Option<f64>| value.map_or_else(String::new, |x| format!("{x:?}"));
    let (outcome, next) = match hop.outcome {
        Outcome::Apex(next) if next.in_stance => ("apex_in_stance", Some(next)),
        Outcome::Apex(next) => ("apex", Some(next)),
        Outcome::Fall => ("fall", None),
    };
    [
        outcome.to_owned(),
        hop.stance_phases.to_string(),
        number(hop.touchdown.map(|t| t.t_s)),
        number(hop.touchdown.map(|t| t.foot_x_m)),
        number(hop.liftoff_t_s),
        number(next.map(|n| n.t_s)),
        number(next.map(|n| n.x_m)),
        number(next.map(|n| n.vx_m_s)),
        number(next.map(|n| n.y_m)),
    ]
}

fn unreadable(name: &str, error: &csv::Error) -> Misuse {
    Misuse(format!("{name}: {error}"))
}
