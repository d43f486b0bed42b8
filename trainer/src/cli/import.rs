//! `trainer import`

use super::output::{Target, print};
use super::{Failure, failed, input};
use crate::import::from_json;
use crate::policy::{About, blob};
use anyhow::{Context, anyhow};
use clap::Args;
use controller::policy::GainPoint;
use std::path::PathBuf;

/// The layout, in short; the documentation of `trainer::import` is the reference.
const LAYOUT: &str = r#"The JSON layout:
  {"hidden_activation": "relu",
   "output": "clip(output_scale*tanh(z), low, high)",
   "output_scale": 2.617993877991494, "low": [0.314, 0.0], "high": [2.618, 2.0],
   "layers": [{"weights": [[...], ...], "bias": [...]}, ...],
   "test_vectors": [{"observation": [vx, y, rho], "action": [alpha, rs]}, ...]}

Weights are row by output, from the inputs vx (m/s), y (m) and density ratio rho to
the actions alpha (rad) and rs (m/s), which low and high clip, in this order. Test
vectors may be absent; where they are there, the imported actor must give their
actions within 1e-5."#;
/// Longest name of a policy, bytes: what is printed of it stays on one line.
const MOST_NAME_BYTES: usize = 64;

#[derive(Debug, Args)]
#[command(after_help = LAYOUT)]
pub(super) struct Arguments {
    /// The actor in JSON, in the layout below
    #[arg(long)]
    json: PathBuf,
    /// The policy file to write
    #[arg(long)]
    out: PathBuf,
    /// Its name, at most 64 bytes; by default that of the JSON file
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
    let name = arguments.name.as_deref().unwrap_or(&stem);
    if name.len() > MOST_NAME_BYTES {
        return Err(input(anyhow!(
            "--name: '{name}' has {} bytes, at most {MOST_NAME_BYTES} may be; shorten it",
            name.len()
        )));
    }
    let gains = GainPoint {
        density_ratio: 0.0,
        kp: 0.0,
        ki: arguments.ki,
        kd: 0.0,
        feed_forward: arguments.feed_forward,
        limit_m_s: 10.0,
    };
    let about = About {
        name,
        preset: "import",
        seed: 0,
        steps: 0,
        density_ratio: [0.0, 1.0],
        config: "",
        gains: &[gains],
    };
    let bytes = blob(&frozen, &about).map_err(input)?;
    Target { path: &arguments.out, option: "--out" }.write(bytes.as_slice())?;
    let widths: Vec<String> = frozen.widths.iter().map(ToString::to_string).collect();
    let out = arguments.out.display();
    print(&format!("{out}: {} from {stem}, {} bytes", widths.join("-"), bytes.as_slice().len()))
        .map_err(|e| match e {
            Failure::Run(e) | Failure::Input(e) => failed(e),
        })
}
