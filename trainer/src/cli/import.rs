//! The command `trainer import`.

use super::output::{Target, print};
use super::{Failure, failed, input};
use crate::bridge::imported::{CompleteActor, ImportOptions, ImportedActor};
use crate::bridge::{ImportError, json, onnx, safetensors};
use crate::evaluate::gains::search;
use crate::policy::{PolicyInfo, blob, blob_with_manifest};
use anyhow::{Context, anyhow};
use clap::{Args, value_parser};
use indicatif::{ProgressBar, ProgressStyle};
use leg_control::policy::{GainPoint, Policy};
use leg_process::policy_file::AlignedBytes;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Summary of the layouts; the documentation of `trainer::bridge` is the reference.
const LAYOUT: &str = r#"A safetensors file holds linear layers, such as 0.weight (outputs, inputs) and 0.bias.
The actor is the only module whose layers lead from 3 inputs to 2 outputs; where there
are several, or its layers are in several modules, --layers names them in order. ReLU
between the layers and tanh after the last are assumed.

An ONNX file holds a graph from one input, rows of 3, to rows of 2: Gemm or MatMul and
Add with Relu between, Tanh at the end, and scalings and clips before and after.

The inputs are vx (m/s), y (m) and density ratio rho; the network sees (input - offset)
* scale. The outputs are the touchdown angle alpha (rad) and the elongation speed rs
(m/s), clip(offset + scale * tanh(z), low, high). The options give what the file does
not state. The defaults are unscaled inputs, low and high of pi/10 to pi/1.2 rad and 0 to
2 m/s, and tanh from -1 to 1 spread from low to high, as SB3 does for a Box action.

The gains of the cascade are those of --ki and --feed-forward; else those of the policy
that the file was exported from, if its actor is unchanged; else they are searched, as by
`trainer train`, in some ten seconds.

The JSON layout:
  {"hidden_activation": "relu",
   "output": "clip(output_scale*tanh(z), low, high)",
   "output_scale": 2.617993877991494, "low": [0.314, 0.0], "high": [2.618, 2.0],
   "layers": [{"weights": [[...], ...], "bias": [...]}, ...],
   "test_vectors": [{"observation": [vx, y, rho], "action": [alpha, rs]}, ...]}

Weights are row by output. Test vectors are optional; the imported actor must reproduce
their actions within 1e-5."#;
/// Longest name of a policy, bytes, so that a printed name stays on one line.
const MOST_NAME_BYTES: usize = 64;
/// Largest file that is read, bytes. An actor has at most 135 kB, twice that in double
/// precision, and may come with its critics and optimisers.
const MOST_BYTES: u64 = 64 << 20;
/// Integral gain at every density ratio where only the feed-forward is given.
const KI: f32 = 0.05;

#[derive(Debug, Args)]
#[command(after_help = LAYOUT)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Policy file to write
    #[arg(long)]
    out: PathBuf,
    /// Name of the policy, at most 64 bytes [default: the file's name]
    #[arg(long)]
    name: Option<String>,
    /// Layers of a safetensors file in order, such as mu.0,mu.2,mu.4
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["onnx", "json"])]
    layers: Option<Vec<String>>,
    /// Offset that is subtracted from the inputs: m/s, m, ratio
    #[arg(long, value_name = "VX,Y,RHO", value_parser = numbers::<3>, allow_hyphen_values = true)]
    observation_offset: Option<Numbers<3>>,
    /// Scale that the inputs are then multiplied by
    #[arg(long, value_name = "VX,Y,RHO", value_parser = numbers::<3>, allow_hyphen_values = true)]
    observation_scale: Option<Numbers<3>>,
    /// Offset that is added to the scaled tanh: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_offset: Option<Numbers<2>>,
    /// Scale of the tanh: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_scale: Option<Numbers<2>>,
    /// Lowest action: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_low: Option<Numbers<2>>,
    /// Highest action: rad, m/s
    #[arg(long, value_name = "ALPHA,RS", value_parser = numbers::<2>, allow_hyphen_values = true)]
    action_high: Option<Numbers<2>>,
    /// Integral gain of the velocity cascade at every density ratio [with --feed-forward: 0.05]
    #[arg(long, value_parser = value_parser!(f32))]
    ki: Option<f32>,
    /// Feed-forward of the set-point at every density ratio [with --ki: 0]
    #[arg(long, value_parser = value_parser!(f32))]
    feed_forward: Option<f32>,
}

/// The source of the actor; exactly one is given.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Source {
    /// Safetensors file to import
    #[arg(long, value_name = "FILE")]
    safetensors: Option<PathBuf>,
    /// ONNX file to import
    #[arg(long, value_name = "FILE")]
    onnx: Option<PathBuf>,
    /// JSON file to import, in the layout below
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// `N` numbers, separated by commas.
#[derive(Clone, Copy, Debug)]
struct Numbers<const N: usize>([f32; N]);

fn numbers<const N: usize>(text: &str) -> Result<Numbers<N>, String> {
    let number = |part: &str| {
        let finite = part.trim().parse().ok().filter(|x: &f32| x.is_finite());
        finite.ok_or_else(|| format!("'{part}' is not a finite number"))
    };
    let numbers: Vec<f32> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let count = numbers.len();
    let numbers =
        numbers.try_into().map_err(|_| format!("{count} numbers, expected {N}, by commas"))?;
    Ok(Numbers(numbers))
}

impl Arguments {
    fn path(&self) -> &Path {
        let Source { safetensors, onnx, json } = &self.source;
        let paths = [safetensors, onnx, json];
        paths.into_iter().flatten().next().expect("the group is required")
    }

    fn given(&self) -> ImportOptions {
        ImportOptions {
            observation_offset: self.observation_offset.map(|f| f.0),
            observation_scale: self.observation_scale.map(|f| f.0),
            action_offset: self.action_offset.map(|f| f.0),
            action_scale: self.action_scale.map(|f| f.0),
            action_low: self.action_low.map(|f| f.0),
            action_high: self.action_high.map(|f| f.0),
        }
    }

    /// Reads the actor from the content of the source.
    fn imported_actor(&self, bytes: &[u8]) -> Result<ImportedActor, ImportError> {
        match &self.source {
            Source { safetensors: Some(_), .. } => {
                safetensors::import(bytes, self.layers.as_deref())
            }
            Source { onnx: Some(path), .. } => {
                let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
                onnx::import(bytes, Some(folder.unwrap_or(Path::new("."))))
            }
            _ => json::import(bytes),
        }
    }

    /// Returns the gains of the options, which hold at every density ratio; `None` without any.
    fn gains(&self) -> Option<Vec<GainPoint>> {
        (self.ki.is_some() || self.feed_forward.is_some()).then(|| {
            vec![GainPoint {
                density_ratio: 0.0,
                kp: 0.0,
                ki: self.ki.unwrap_or(KI),
                kd: 0.0,
                feed_forward: self.feed_forward.unwrap_or(0.0),
                limit_m_s: 10.0,
            }]
        })
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = arguments.path();
    let name = |stem: &str| check_name(arguments.name.as_deref().unwrap_or(stem));
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let file = || path.display().to_string();
    let bytes = read(path)?;
    let imported =
        arguments.imported_actor(&bytes).and_then(|actor| actor.complete(&arguments.given()));
    let imported = imported.map_err(hinted).with_context(file).map_err(input)?;
    let target = Target { path: &arguments.out, option: "--out" };
    // Before the search: the output must be writable, and the controller must accept the actor.
    drop(target.begin()?);
    let (policy, gains) = if let Some(mut card) = imported.card.clone() {
        card.name = name(&card.name)?;
        if let Some(gains) = arguments.gains() {
            card.gains = gains;
        }
        let manifest = card.manifest(&imported.actor);
        let gains = if arguments.gains().is_some() { "given" } else { "the policy's own" };
        (
            blob_with_manifest(&manifest, &imported.actor.weights)
                .with_context(file)
                .map_err(input)?,
            gains,
        )
    } else {
        let name = name(&stem)?;
        let given = arguments.gains();
        let any = given.clone().unwrap_or_else(|| vec![GainPoint::default()]);
        let checked = foreign(&imported, &name, &any).with_context(file).map_err(input)?;
        if given.is_some() {
            (checked, "given")
        } else {
            let gains = searched(&imported);
            (foreign(&imported, &name, &gains).map_err(failed)?, "found by search")
        }
    };
    target.write(policy.as_slice())?;
    report(arguments, &imported, &policy, gains)
}

/// Adds the options that help to an error.
fn hinted(error: ImportError) -> anyhow::Error {
    match &error {
        ImportError::Stated { name } => {
            let option = name.replace(' ', "-");
            anyhow!("{error}; leave --{option} out")
        }
        ImportError::NoActor { .. } => {
            anyhow!("{error}; name the layers in order, such as --layers fc1,fc2,mu")
        }
        ImportError::Ambiguous { .. } => anyhow!("{error}; choose one with --layers"),
        _ => error.into(),
    }
}

/// Writes a policy of unknown origin.
fn foreign(
    imported: &CompleteActor,
    name: &str,
    gains: &[GainPoint],
) -> Result<AlignedBytes, ImportError> {
    let info = PolicyInfo {
        name,
        preset: "import",
        seed: 0,
        steps: 0,
        density_ratio: [0.0, 1.0],
        config: "",
        gains,
    };
    Ok(blob(&imported.actor, &info)?)
}

/// Searches the gains, with a spinner on a terminal.
fn searched(imported: &CompleteActor) -> Vec<GainPoint> {
    let style = ProgressStyle::with_template("{spinner} {msg}  {elapsed}").expect("a template");
    let spinner = ProgressBar::new_spinner().with_style(style);
    spinner.set_message("searching the cascade's gains…");
    spinner.enable_steady_tick(Duration::from_millis(200));
    let gains = search(&imported.actor.actor());
    spinner.finish_and_clear();
    gains
}

fn report(
    arguments: &Arguments,
    imported: &CompleteActor,
    policy: &AlignedBytes,
    gains: &str,
) -> Result<(), Failure> {
    let crc32 = Policy::parse(policy.as_slice()).map_err(failed)?.crc32();
    let widths: Vec<String> = imported.actor.widths.iter().map(ToString::to_string).collect();
    let mut text = format!(
        "{}: {} from {}, {} bytes, CRC-32 {crc32:08x}; gains {gains}",
        arguments.out.display(),
        widths.join("-"),
        arguments.path().display(),
        policy.as_slice().len()
    );
    if !imported.assumed.is_empty() {
        text += "\nAssumed: ";
        text += &imported.assumed.join("; ");
    }
    print(&text)
}

fn check_name(name: &str) -> Result<String, Failure> {
    if name.len() > MOST_NAME_BYTES {
        return Err(input(anyhow!(
            "--name: '{name}' has {} bytes, at most {MOST_NAME_BYTES} may be; shorten it",
            name.len()
        )));
    }
    Ok(name.to_owned())
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let file = || path.display().to_string();
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut bytes))
        .with_context(file)
        .map_err(input)?;
    if bytes.len() as u64 > MOST_BYTES {
        let error = anyhow!("more than {MOST_BYTES} bytes, which no actor needs; save it alone");
        return Err(input(error.context(file())));
    }
    Ok(bytes)
}
