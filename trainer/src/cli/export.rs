//! The command `trainer export`.

use super::inspect::test_vectors;
use super::output::{Target, print};
use super::{Failure, failed, input};
use crate::bridge::{c, onnx, safetensors};
use anyhow::anyhow;
use clap::{Args, ValueEnum};
use leg_process::policy_file::PolicyFile;
use std::path::PathBuf;

const FORMATS: &str = "\
safetensors  the layers with the names and shapes of a PyTorch nn.Sequential: 0.weight,
             0.bias, 2.weight, …; scalings, gains and origin as JSON under the
             metadata key leg_actor
onnx         a graph from observation, float (batch, 3), to action, float (batch, 2), with
             scalings and clip; opset 13; the same JSON in its metadata_props
c            one C99 file with void leg_actor(const float observation[3], float
             action[2]), which needs no libc and computes the controller's bits;
             --prefix names several that are linked into one program

The observation is vx (m/s), y (m) and density ratio rho; the action is the touchdown
angle alpha (rad) and the elongation speed rs (m/s). The same policy gives the same
file, and `trainer import` restores the policy from the first two formats.";

#[derive(Debug, Args)]
#[command(after_help = FORMATS)]
pub(super) struct Arguments {
    /// Policy file; by default the policy that is shipped with the program
    #[arg(long)]
    policy: Option<PathBuf>,
    /// Format of the file
    #[arg(long, value_enum)]
    to: Format,
    /// What every name in a C file begins with [default: leg]
    #[arg(long)]
    prefix: Option<String>,
    /// File to write
    file: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    Safetensors,
    Onnx,
    C,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let prefix = match (arguments.to, arguments.prefix.as_deref()) {
        (_, None) => c::PREFIX,
        (Format::C, Some(text)) => {
            let wrong = |why| input(anyhow!("--prefix: '{text}': {why}"));
            c::Prefix::new(text).map_err(wrong)?
        }
        (_, Some(_)) => return Err(input(anyhow!("--prefix is for --to c only; leave it out"))),
    };
    let bytes = PolicyFile::load(arguments.policy.as_deref()).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let target = Target { path: &arguments.file, option: "FILE" };
    target.check(arguments.policy.as_deref())?;
    let content = match arguments.to {
        Format::Safetensors => safetensors::export(&policy),
        Format::Onnx => onnx::export(&policy),
        Format::C => {
            let vectors = test_vectors(&policy, bytes.as_slice()).map_err(failed)?;
            c::export(&policy, &vectors, prefix).into_bytes()
        }
    };
    target.write(&content)?;
    print(&format!(
        "{}: {} of CRC-32 {:08x}, {} bytes",
        arguments.file.display(),
        policy.manifest().name,
        policy.crc32(),
        content.len()
    ))
}
