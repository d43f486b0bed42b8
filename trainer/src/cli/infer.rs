//! The command `trainer infer`.

use super::output::{Target, print};
use super::{Failure, columns, failed, input};
use anyhow::Context;
use clap::Args;
use leg_control::actor::Observation;
use leg_control::policy::Policy;
use leg_process::policy_file::PolicyFile;
use std::io::Read;
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
    let output = arguments.output.as_deref().filter(|&path| path != Path::new("-"));
    let target = output.map(|path| Target { path, option: "--output" });
    let inputs = || [&arguments.policy, &arguments.input].map(PathBuf::as_path);
    target.iter().try_for_each(|target| target.check(inputs()))?;
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
    match target {
        Some(target) => target.write(&actions),
        None => print(&String::from_utf8_lossy(&actions)),
    }
}

fn infer(policy: &Policy<'_>, source: &[u8], from: &Path) -> Result<Vec<u8>, Failure> {
    let rows = columns::read(source, &from.display().to_string(), ["vx", "y", "rho"])?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["vx", "y", "rho", "alpha", "rs"]).map_err(failed)?;
    for (_, [apex_vx_m_s, apex_y_m, density_ratio]) in rows {
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
