//! The command `trainer infer`.

use super::output::Target;
use super::{Failure, failed, input};
use crate::lines::line_of;
use anyhow::{Context, anyhow};
use clap::Args;
use leg_control::actor::Observation;
use leg_control::policy::Policy;
use leg_process::policy_file::PolicyFile;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Policy file
    #[arg(long)]
    policy: PathBuf,
    /// CSV file with columns vx (m/s), y (m) and rho; - for the standard input
    #[arg(long)]
    input: PathBuf,
    /// CSV file to write, with the same columns, then alpha (rad) and rs (m/s) [default: -, the
    /// standard output]
    #[arg(long)]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyFile::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let from = &arguments.input;
    let source = if from == Path::new("-") {
        let mut text = Vec::new();
        std::io::stdin().read_to_end(&mut text).map(|_| text)
    } else {
        std::fs::read(from)
    };
    let source = source.with_context(|| from.display().to_string()).map_err(input)?;
    // The whole input is converted first, so that nothing is written if a row is bad.
    let actions = infer(&policy, &source, from)?;
    match arguments.output.as_deref() {
        Some(path) if path != Path::new("-") => Target { path, option: "--output" }.write(&actions),
        _ => {
            let mut stdout = std::io::stdout().lock();
            stdout.write_all(&actions).and_then(|()| stdout.flush()).map_err(failed)
        }
    }
}

fn infer(policy: &Policy<'_>, source: &[u8], from: &Path) -> Result<Vec<u8>, Failure> {
    let name = from.display();
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(source);
    let headers = reader.headers().with_context(|| name.to_string()).map_err(input)?.clone();
    let column = |wanted: &str| {
        let mut found = (0..headers.len()).filter(|&i| headers[i].trim() == wanted);
        match (found.next(), found.next()) {
            (Some(column), None) => Ok(column),
            (None, _) => Err(input(anyhow!(
                "{name}: no column {wanted}; the first line must name vx, y and rho"
            ))),
            (Some(_), Some(_)) => Err(input(anyhow!(
                "{name}: more than one column {wanted}; the first line must name vx, y and rho once each"
            ))),
        }
    };
    let columns = [("vx", column("vx")?), ("y", column("y")?), ("rho", column("rho")?)];
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["vx", "y", "rho", "alpha", "rs"]).map_err(failed)?;
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).with_context(|| name.to_string()).map_err(input)? {
        let line = || line_of(source, record.position().map_or(0, csv::Position::byte));
        let mut values = [0.0_f32; 3];
        for (value, (header, column)) in values.iter_mut().zip(columns) {
            let bad = |what: &str| {
                let place = format!("{name}, line {}, column {header}", line());
                input(anyhow!("{place}: {what} a finite number, of magnitude below 3.4e38"))
            };
            let text = record.get(column).unwrap_or_default().trim();
            if text.is_empty() {
                return Err(bad("the value is missing; give"));
            }
            let finite = text.parse().ok().filter(|x: &f32| x.is_finite());
            *value = finite.ok_or_else(|| bad(&format!("'{text}' is not")))?;
        }
        if record.len() > headers.len() {
            return Err(input(anyhow!(
                "{name}, line {}: {} values, but the first line names {}; remove the rest",
                line(),
                record.len(),
                headers.len()
            )));
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
        writer.write_record(row.map(|x| x.to_string())).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| failed(e.into_error()))
}
