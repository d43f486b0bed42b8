//! `trainer infer`

use super::output::{begin, finish};
use super::{Failure, failed, input};
use anyhow::{Context, anyhow};
use clap::Args;
use controller::actor::Observation;
use controller::host::blob::PolicyBlob;
use controller::policy::Policy;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The policy file
    #[arg(long)]
    policy: PathBuf,
    /// CSV file with columns vx (m/s), y (m) and rho; - for the standard input
    #[arg(long)]
    input: PathBuf,
    /// CSV file to write: the same columns, then alpha (rad) and rs (m/s)
    #[arg(long)]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyBlob::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let from = &arguments.input;
    let source: Box<dyn Read> = if from == Path::new("-") {
        Box::new(std::io::stdin().lock())
    } else {
        let file = std::fs::File::open(from);
        Box::new(file.with_context(|| from.display().to_string()).map_err(input)?)
    };
    match &arguments.output {
        Some(path) => {
            let mut file = begin(path)?;
            infer(&policy, source, from, &mut file)?;
            finish(path, file)
        }
        None => infer(&policy, source, from, std::io::stdout().lock()),
    }
}

fn infer(
    policy: &Policy<'_>,
    source: impl Read,
    from: &Path,
    to: impl Write,
) -> Result<(), Failure> {
    let name = from.display();
    let mut reader = csv::Reader::from_reader(source);
    let headers = reader.headers().with_context(|| name.to_string()).map_err(input)?.clone();
    let column = |wanted: &str| {
        headers.iter().position(|h| h.trim() == wanted).ok_or_else(|| {
            input(anyhow!("{name}: no column {wanted}; the first line must name vx, y and rho"))
        })
    };
    let columns = [("vx", column("vx")?), ("y", column("y")?), ("rho", column("rho")?)];
    let mut writer = csv::Writer::from_writer(to);
    writer.write_record(["vx", "y", "rho", "alpha", "rs"]).map_err(unwritten)?;
    for record in reader.records() {
        let record = record.with_context(|| name.to_string()).map_err(input)?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut values = [0.0_f32; 3];
        for (value, (header, column)) in values.iter_mut().zip(columns) {
            let text = record.get(column).unwrap_or_default().trim();
            let finite = text.parse().ok().filter(|x: &f32| x.is_finite());
            *value = finite.ok_or_else(|| {
                input(anyhow!(
                    "{name}, line {line}, column {header}: '{text}' is not a finite number"
                ))
            })?;
        }
        let [apex_vx_m_s, apex_y_m, density_ratio] = values;
        let action = policy.actor().act(Observation { apex_vx_m_s, apex_y_m, density_ratio });
        let row = [
            apex_vx_m_s,
            apex_y_m,
            density_ratio,
            action.touchdown_angle_rad,
            action.elongation_speed_m_s,
        ];
        writer.write_record(row.map(|x| x.to_string())).map_err(unwritten)?;
    }
    writer.flush().map_err(failed)
}

fn unwritten(error: csv::Error) -> Failure {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => failed(error),
        other => failed(anyhow!("{other:?}")),
    }
}
