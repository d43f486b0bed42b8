//! `trainer import`

use super::output::{print, write_file};
use super::{Failure, failed, input};
use crate::config::Gains;
use crate::import::from_json;
use crate::policy::{About, blob};
use anyhow::Context;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The actor in JSON, in the layout of the documentation of `trainer::import`
    #[arg(long)]
    json: PathBuf,
    /// The policy file to write
    #[arg(long)]
    out: PathBuf,
    /// Its name; by default that of the JSON file
    #[arg(long)]
    name: Option<String>,
    /// Integral gain of the velocity cascade, at every density
    #[arg(long, default_value_t = 0.05)]
    ki: f32,
    /// Feed-forward of the set speed, at every density
    #[arg(long, default_value_t = 0.0)]
    feed_forward: f32,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = arguments.json.display().to_string();
    let text = std::fs::read_to_string(&arguments.json).context(path.clone()).map_err(input)?;
    let frozen = from_json(&text).context(path).map_err(input)?;
    let stem = arguments.json.file_stem().unwrap_or_default().to_string_lossy();
    let gains = Gains {
        density_ratio: 0.0,
        kp: 0.0,
        ki: arguments.ki,
        kd: 0.0,
        feed_forward: arguments.feed_forward,
        limit_m_s: 10.0,
    };
    let about = About {
        name: arguments.name.as_deref().unwrap_or(&stem),
        preset: "import",
        seed: 0,
        steps: 0,
        density_ratio: [0.0, 1.0],
        config: "",
        gains: &[gains],
    };
    let bytes = blob(&frozen, &about).map_err(input)?;
    write_file(&arguments.out, bytes.as_slice())?;
    let widths: Vec<String> = frozen.widths.iter().map(ToString::to_string).collect();
    let out = arguments.out.display();
    print(&format!("{out}: {} from {stem}, {} bytes", widths.join("-"), bytes.as_slice().len()))
        .map_err(|e| match e {
            Failure::Run(e) | Failure::Input(e) => failed(e),
        })
}
